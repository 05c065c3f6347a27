"""The server: this machine alone, its own pages alone, and with a token where it is exposed."""

import asyncio
import json
import logging
import re
import shutil
import socket
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bokeh.server.views.ws import WSHandler
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClosedError, websocket_connect

from gateway.errors import BadInput
from gateway.monitor import MonitorOptions
from gateway.studio import pages
from gateway.studio.live_history import LiveHistory
from gateway.studio.page import PageEntry, StudioContext
from gateway.studio.page_faults import is_fault, quieten_logs
from gateway.studio.pages import PAGES, known_pages
from gateway.studio.serve import (
    DEMO_VESSEL,
    StudioOptions,
    origins_of,
    server_of,
    session_of,
)
from tests.conftest import ROOT

GROUP = "shadow.studio_pages"


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Served:
    """A server without any recording, and a client that asks it."""

    def __init__(self, folder: Path, token: str | None) -> None:
        self.options = StudioOptions(folders=(folder,), port=free_port(), out=folder)
        self.session = session_of(self.options)
        live = LiveHistory(MonitorOptions("tcp/127.0.0.1:1"))  # not watching
        self.context = StudioContext(self.session, live, self.options.settings, known_pages())
        self.server = server_of(self.context, self.options, token)
        self.at = f"127.0.0.1:{self.options.port}"

    def get(self, path: str, **more):
        client = AsyncHTTPClient()
        request = HTTPRequest(f"http://{self.at}/{path}", follow_redirects=False, **more)
        return IOLoop.current().run_sync(lambda: client.fetch(request, raise_error=False), 30.0)

    def websocket(self, origin: str, path: str = "compare/ws", **headers: str):
        request = HTTPRequest(
            f"ws://{self.at}/{path}", headers={"Origin": origin} | headers, connect_timeout=10.0
        )
        return IOLoop.current().run_sync(lambda: websocket_connect(request), 30.0)

    def open_page(self, path: str):
        """The websocket of a page, as its scripts open it."""
        token = re.search(rb'"token":"([^"]+)"', self.get(path).body).group(1).decode()
        request = HTTPRequest(f"ws://{self.at}/{path}/ws", headers={"Origin": f"http://{self.at}"})
        return IOLoop.current().run_sync(
            lambda: websocket_connect(request, subprotocols=["bokeh", token]), 30.0
        )

    def close(self) -> None:
        self.server.stop()
        self.session.close()


@pytest.fixture
def open_server(tmp_path):
    made = []

    def opened(token: str | None = None) -> Served:
        made.append(Served(tmp_path, token))
        return made[-1]

    yield opened
    for one in made:
        one.close()


def test_every_page_answers_and_listens_here_alone(open_server):
    served = open_server()
    for page in PAGES:
        answer = served.get(page.path)
        assert answer.code == 200, page
        assert f"{page.title} – Shadow studio".encode() in answer.body
        for other in PAGES:
            assert f'<a href="{other.path}"'.encode() in answer.body
        assert b"https://" not in answer.body.replace(b"https://github.com", b"")
        assert b"Traceback" not in answer.body
    address = served.server._http._sockets
    assert {one.getsockname()[0] for one in address.values()} == {"127.0.0.1"}


def test_the_root_leads_to_the_first_page_and_keeps_what_stands_behind_it(open_server):
    served = open_server()
    for path, leads_to in (("", "/compare"), ("?token=secret", "/compare?token=secret")):
        answer = served.get(path)
        assert answer.code == 302
        assert answer.headers["Location"] == leads_to


def test_open_pages_can_tell_one_run_of_the_server_from_the_next(open_server):
    served = open_server("secret-token")
    first = served.get("alive")
    assert first.code == 200
    assert first.headers["Cache-Control"] == "no-store"
    assert b"secret" not in first.body
    page = served.get("compare?token=secret-token")
    assert first.body in page.body
    assert first.body != session_of(served.options).run.encode()


def test_pages_of_others_get_no_websocket(open_server):
    served = open_server()
    for origin in ("http://evil.example", "http://evil.example:5006", "null"):
        with pytest.raises(HTTPClientError, match="403"):
            served.websocket(origin)


def test_a_name_that_is_not_our_own_gets_nothing(open_server):
    """DNS rebinding: the name of another site leads here, its pages ask under their own origin."""
    served = open_server()
    port = served.options.port
    for name in (f"evil:{port}", "evil", "127.0.0.1:1", f"127.0.0.1.evil:{port}"):
        for path in ("compare", "", "static/js/bokeh.min.js", "refused", "nothing"):
            answer = served.get(path, headers={"Host": name})
            assert answer.code == 403, (name, path)
            assert b"--origin" in answer.body
        posted = served.get("compare", headers={"Host": name}, method="POST", body="x")
        assert posted.code == 403, name
        with pytest.raises(HTTPClientError, match="403"):
            served.websocket(f"http://{name}", Host=name)
    for own in (served.at, f"localhost:{served.options.port}", f"LOCALHOST:{served.options.port}"):
        assert served.get("compare", headers={"Host": own}).code == 200


def test_an_exposed_websocket_without_a_token_is_refused_without_a_word(open_server, capfd):
    served = open_server("secret-token")
    for path in ("compare/ws", "compare/ws?token=no", "compare/ws?bokeh-session-id=%ff"):
        with pytest.raises(HTTPClientError, match=r"40[013]"):
            served.websocket(f"http://{served.at}", path)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("address", "port", "says"),
    [
        ("nonsense.invalid", 5006, "--expose nonsense.invalid: no address of this machine"),
        ("a b", 5006, "--expose a b: no address of this machine"),
        ("", 5006, "--expose: expected an address of this machine"),
        ("192.0.2.1", 5006, "not an address of this machine"),
        ("127.0.0.1", 99999, "--port 99999: expected 0 to 65535"),
    ],
)
def test_where_it_cannot_be_exposed_is_one_line(open_server, address, port, says):
    served = open_server()
    with pytest.raises(BadInput, match=says):
        server_of(served.context, replace(served.options, expose=address, port=port))


def test_an_exposed_page_wants_the_token_and_remembers_it(open_server):
    served = open_server("secret-token")
    assert served.get("compare").code == 302
    assert served.get("compare?token=wrong").code == 302
    refused = served.get("refused")
    assert refused.code == 403
    assert b"token" in refused.body
    welcome = served.get("compare?token=secret-token")
    assert welcome.code == 200
    cookie = welcome.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert served.get("compare", headers={"Cookie": "shadow_studio=secret-token"}).code == 200
    assert served.get("compare", headers={"Cookie": "shadow_studio=no"}).code == 302


def test_origins_are_our_own_names_and_those_that_were_given():
    local = origins_of(StudioOptions(port=5006))
    assert local == ["127.0.0.1:5006", "localhost:5006"]
    named = StudioOptions(port=5006, expose="10.0.0.5", origins=("boat.lan:80",))
    assert origins_of(named)[2:] == ["10.0.0.5:5006", "boat.lan:80"]


def test_a_port_that_is_taken_is_one_line(open_server):
    served = open_server()
    with pytest.raises(BadInput, match="another studio"):
        server_of(served.context, served.options)


def test_files_that_are_not_there_are_bad_input(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        session_of(StudioOptions(logs=(tmp_path / "no.tlog",)))


def test_without_arguments_it_opens_on_the_demo():
    session = session_of(StudioOptions())
    session.close()
    assert [log.name for log in session.logs] == ["voyage_1.tlog", "voyage_2.tlog"]
    assert session.vessel_file == DEMO_VESSEL


def test_a_page_closed_while_something_went_to_it_is_no_fault_and_anything_else_is():
    for error, fault in ((WebSocketClosedError(), False), (KeyError("x"), True)):
        record = logging.LogRecord("asyncio", logging.ERROR, "", 0, "never retrieved", (),
                                   (type(error), error, None))  # fmt: skip
        assert is_fault(record) is fault


@pytest.mark.parametrize("found", [True, False])
def test_a_page_that_a_ping_found_closed_before_it_said_so_is_no_fault(open_server, caplog, found):
    quieten_logs()
    served = open_server()
    page = served.open_page("compare")
    run = IOLoop.current().run_sync
    assert "ACK" in run(page.read_message, 30.0)
    (connection,) = served.server._tornado._clients
    told = asyncio.Event()

    def on_close() -> None:
        IOLoop.current().call_later(0.1, told.set)
        if not found:
            raise KeyError("a fault of its own")
        WSHandler.on_close(connection._socket)

    connection._socket.on_close = on_close
    if found:
        served.server._tornado.client_lost(connection)  # as its ping does
    header = {"msgid": "1", "msgtype": "PATCH-DOC"}
    for part in (header, {}, {"events": []}):  # its last message
        run(partial(page.write_message, json.dumps(part)), 30.0)
    page.close()
    run(told.wait, 30.0)
    faults = [record.name for record in caplog.records if record.levelno >= logging.ERROR]
    assert faults == ([] if found else ["tornado.application"])


@pytest.mark.parametrize(
    ("kind", "attribute", "value"),
    [("CheckboxGroup", "active", "abc"), ("CheckboxGroup", "active", [1, 2]),
     ("CheckboxGroup", "active", {"type": "nonsense"}), ("CustomSelect", "value", "abc")],
)  # fmt: skip
def test_what_a_page_sends_wrongly_is_one_line(
    open_server, caplog, tmp_path, kind, attribute, value
):
    quieten_logs()
    shutil.copy(DEMO_VESSEL, tmp_path)  # for a choice that is not among some
    served, run = open_server(), IOLoop.current().run_sync
    page = served.open_page("recordings")
    assert "ACK" in run(page.read_message, 30.0)
    apps = served.server._tornado._applications.values()
    (document,) = (session.document for app in apps for session in app.sessions)
    (model,) = (one for one in document.models if type(one).__name__ == kind)
    change = {"kind": "ModelChanged", "model": {"id": model.id}, "attr": attribute, "new": value}
    for part in ({"msgid": "1", "msgtype": "PATCH-DOC"}, {}, {"events": [change]}):
        run(partial(page.write_message, json.dumps(part)), 30.0)
    run(partial(asyncio.sleep, 0.5))
    (told,) = (record for record in caplog.records if record.levelno >= logging.ERROR)
    assert told.getMessage().startswith("studio: a page sent what cannot be used: ")
    assert told.exc_info is None
    page.close()


def test_a_fault_of_ours_while_a_message_is_taken_is_logged_whole() -> None:
    def apply_json_patch() -> None:  # as the library's, and not of it
        raise ValueError("a fault of ours")

    try:
        apply_json_patch()
    except ValueError as error:
        given = (type(error), error, error.__traceback__)
    record = logging.LogRecord("panel.reactive", logging.ERROR, "", 0, "failed", (), given)
    assert is_fault(record)
    assert record.exc_info == given


def plug_in(monkeypatch, entry: PageEntry) -> None:
    """An installed package that registers a page."""
    point = SimpleNamespace(load=lambda: entry)
    monkeypatch.setattr(pages, "entry_points", lambda group: [point] * (group == GROUP))


def test_the_page_of_a_plug_in_as_the_docs_show_it_is_served_in_its_order(
    open_server, monkeypatch, capsys
):
    text = (ROOT / "docs/studio.md").read_text("utf-8")
    example: dict[str, Any] = {}
    exec(text.partition("```python\n")[2].partition("```")[0], example)
    entry = example["PAGE"]
    plug_in(monkeypatch, replace(entry, order=15))
    served = open_server()
    assert [page.path for page in served.context.pages][:3] == ["compare", "notes", "diagnose"]
    answer = served.get("notes")
    assert answer.code == 200
    assert f'content="{entry.description}"'.encode() in answer.body
    assert b'<a href="notes"' in served.get("compare").body
    assert "Traceback" not in capsys.readouterr().err
    body = example["NotesPage"](served.context).body()
    assert body.objects


def test_two_pages_of_one_address_are_refused(monkeypatch):
    plug_in(monkeypatch, replace(PAGES[0], title="Mine"))
    with pytest.raises(BadInput, match="studio page compare"):
        known_pages()


@pytest.mark.slow
def test_the_server_answers_before_what_single_pages_and_fits_need_is_imported() -> None:
    """Each of them takes a fifth to a third of the whole start."""
    slow = "{'pandas', 'scipy.signal', 'scipy.stats', 'scipy.interpolate'}"
    code = f"import sys, gateway.studio.serve; print(*sorted({slow} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
