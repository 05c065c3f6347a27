"""The server: pages on one desk, on this machine alone unless it is told otherwise."""

import logging
import os
import signal
import socket
import sys
import traceback
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import panel as pn
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.websocket import WebSocketClosedError

from gateway.bus import DEFAULT_ENDPOINT
from gateway.config import StudioSettings
from gateway.errors import BadInput
from gateway.monitor.watcher import MonitorOptions
from gateway.shipped import RECORDINGS, VESSELS
from gateway.studio.access import Folders, Guard, new_token
from gateway.studio.live_history import LiveHistory
from gateway.studio.page import Page
from gateway.studio.pages.compare import Compare
from gateway.studio.pages.diagnose import Diagnose
from gateway.studio.pages.live import Live
from gateway.studio.pages.recordings import Recordings
from gateway.studio.pages.vessel import VesselPage
from gateway.studio.session import Session
from gateway.studio.widgets import dress
from gateway.studio.worker import BUG

DEMO_LOGS = (RECORDINGS / "voyage_1.tlog", RECORDINGS / "voyage_2.tlog")
DEMO_VESSEL = VESSELS / "demo_boat.toml"
LOCAL = "127.0.0.1"
PORT = 5006


@dataclass(frozen=True)
class StudioOptions:
    """What `shadow studio` is told.

    expose    an address of this machine to be reached at from others; None: from nowhere else
    origins   names under which others reach it, HOST:PORT
    """

    logs: tuple[Path, ...] = ()
    vessel: Path | None = None
    folders: tuple[Path, ...] = ()
    out: Path = Path("shadow-out")
    effects: tuple[Path, ...] = ()
    port: int = PORT
    browser: bool = True
    expose: str | None = None
    origins: tuple[str, ...] = ()
    connect: str = DEFAULT_ENDPOINT
    settings: StudioSettings = field(default_factory=StudioSettings)


def studio(options: StudioOptions, tell: Callable[[str], None]) -> None:
    """Serve until interrupted."""
    quiet()
    dress()
    desk = desk_of(options)
    token = new_token() if options.expose else None
    try:
        with LiveHistory(MonitorOptions(options.connect)) as book:
            server = server_of(desk, book, options, token)
            address = f"http://{options.expose or LOCAL}:{server.port}/compare"
            address += f"?token={token}" if token else ""
            tell(f"studio: {address}  (Ctrl-C ends)")
            if options.browser:
                IOLoop.current().call_later(0.2, lambda: webbrowser.open(address))
            PeriodicCallback(desk.look_around, 250).start()  # also while no page is open
            _run_until_stopped(server)
    finally:
        desk.close()


def desk_of(options: StudioOptions) -> Session:
    """The desk with what was given; with the demo recordings where nothing was."""
    logs, vessel = options.logs, options.vessel
    if not logs and not options.folders and vessel is None and DEMO_VESSEL.is_file():
        logs, vessel = tuple(log for log in DEMO_LOGS if log.is_file()), DEMO_VESSEL
    for file in (*logs, *options.effects, *([vessel] if vessel else [])):
        if not file.is_file():
            raise BadInput(f"{file}: no such file")
    given = [*logs, *([vessel] if vessel else [])]
    folders = Folders.of(given, options.folders or (() if given else (Path.cwd(),)), options.out)
    desk = Session(folders, (), None, tuple(str(file) for file in options.effects))
    if vessel is not None:
        desk.take_vessel(vessel)
    desk.take_logs(logs)
    desk.look_around()  # the comparison begins before the first page is open
    return desk


def server_of(
    desk: Session, book: LiveHistory, options: StudioOptions, token: str | None = None
) -> Any:
    """The server, listening already; BadInput where the port is taken."""
    pages: dict[str, Callable[[], Page]] = {
        "compare": lambda: Compare(desk, options.settings), "diagnose": lambda: Diagnose(desk),
        "vessel": lambda: VesselPage(desk), "live": lambda: Live(desk, book, options.settings),
        "recordings": lambda: Recordings(desk),
    }  # fmt: skip
    apps: dict[str, Callable[[], Any]] = {name: _app(make) for name, make in pages.items()}
    more = {"auth_provider": Guard(token)} if token else {}
    address = options.expose or LOCAL
    _check_port(address, options.port)
    server = pn.io.server.get_server(
        apps, port=options.port, address=address, show=False, start=False,
        websocket_origin=origins_of(options), index=None, use_index=True,
        redirect_root=True, keep_alive_milliseconds=10_000, **more,
    )  # fmt: skip
    server.start()
    return server


def _check_port(address: str, port: int) -> None:
    """One line where the server could not listen."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((address, port))
        except OSError as error:
            raise BadInput(
                f"{address}:{port}: {error.strerror}: is another studio there? give --port"
            ) from None


def origins_of(options: StudioOptions) -> list[str]:
    """Hosts whose pages may open a websocket to us: our own."""
    hosts = [LOCAL, "localhost", *([options.expose] if options.expose else [])]
    return [*(f"{host}:{options.port}" for host in hosts), *options.origins]


def _app(make: Callable[[], Page]) -> Callable[[], Any]:
    """A page, or a line that it could not be made: what went wrong stands in the log."""

    def opened() -> Any:
        try:
            return make().show()
        except Exception:  # the outermost loop of a page that opens
            print(traceback.format_exc(), file=sys.stderr, flush=True)
            return pn.pane.HTML(f"<p>{BUG}</p>")

    return opened


def quiet() -> None:
    """The server's own chatter is of no use to who looks at the page."""
    os.environ.setdefault("BOKEH_RESOURCES", "server")
    for name in ("bokeh", "tornado.access", "panel"):
        logging.getLogger(name).setLevel(logging.ERROR)
    logging.getLogger("asyncio").addFilter(is_news)


def is_news(record: logging.LogRecord) -> bool:
    """Whether it belongs in the log: that a page was closed while something went to it does not."""
    return not (record.exc_info and isinstance(record.exc_info[1], WebSocketClosedError))


def _run_until_stopped(server: Any) -> None:
    loop = IOLoop.current()
    signal.signal(signal.SIGTERM, lambda *_: loop.add_callback_from_signal(loop.stop))
    try:
        loop.start()
    except KeyboardInterrupt:
        pass
    finally:
        server.stop()
