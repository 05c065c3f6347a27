"""The server of the studio: its pages on one session, for this machine alone by default.

Beside its pages it answers: is it there, where does `/` lead, a map's tiles. An open page asks
`alive` about once a second. The answer is the name of this run of the server, so that a page knows
when another one has taken its place, whose sessions it does not share.
"""

import errno
import os
import signal
import socket
import sys
import traceback
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import panel as pn
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.routing import PathMatches, Rule
from tornado.web import RedirectHandler, RequestHandler

from gateway.bus import DEFAULT_ENDPOINT
from gateway.config import CREDIT, StudioSettings
from gateway.errors import BadInput
from gateway.files import RECORDINGS, VESSELS
from gateway.long_running import other_ends
from gateway.monitor import MonitorOptions
from gateway.studio.access import Folders, OtherHost, OtherHostHandler, TokenAuth, new_token
from gateway.studio.live_history import LiveHistory
from gateway.studio.map_tiles import TileFile, TileHandler, open_tiles
from gateway.studio.page import PageEntry, StudioContext, set_style
from gateway.studio.page_faults import quieten_logs
from gateway.studio.pages import known_pages
from gateway.studio.session import Session
from gateway.studio.worker import BUG, TABLE, FleetReader
from gateway.user_effects import EffectFile
from sim.state import Progress

ALIVE = "alive"


class AliveHandler(RequestHandler):  # type: ignore[misc]
    """The name of this run of the server; nothing that a stranger could use."""

    def initialize(self, run: str) -> None:
        """As tornado hands it over."""
        self._run = run

    def get(self) -> None:
        """Answer a request; never from a cache."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(self._run)


def routes(
    run: str, first_page: str, tiles: TileFile | None = None,
    allowed: Callable[[Any], bool] = lambda handler: True,
) -> list[Any]:  # fmt: skip
    """Rules that go before those of the pages; a token in the address is kept on the way.

    tiles    a map's file; `allowed`: may the sender of a request see it?
    """
    more = {"file": tiles, "allowed": allowed}
    place = PathMatches(r"/tiles/(\d{1,2})/(\d{1,8})/(\d{1,8})")
    return [
        *([Rule(place, TileHandler, more)] if tiles is not None else []),
        Rule(PathMatches(f"/{ALIVE}"), AliveHandler, {"run": run}),
        Rule(PathMatches("/"), RedirectHandler, {"url": f"/{first_page}", "permanent": False}),
    ]


DEMO_LOGS = (RECORDINGS / "voyage_1.tlog", RECORDINGS / "voyage_2.tlog")
DEMO_VESSEL = VESSELS / "demo_boat.toml"
LOCAL = "127.0.0.1"
PORT = 5006


@dataclass(frozen=True)
class StudioOptions:
    """The options of `shadow studio`.

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
    fleet: Path | None = None  # folder of a table of `shadow fleet`
    mapping: Path | None = None  # what the columns of .csv tables mean


def run_studio(options: StudioOptions, progress: Progress) -> None:
    """Serve until interrupted."""
    os.environ.setdefault("BOKEH_RESOURCES", "server")
    quieten_logs()
    set_style()
    fleet = FleetReader(fleet_folder(options))
    session = session_of(options)
    token = new_token() if options.expose is not None else None
    try:
        with LiveHistory(MonitorOptions(options.connect)) as live:
            settings = settings_of_file(options.settings)
            context = StudioContext(session, live, settings, known_pages(), fleet)
            server = server_of(context, options, token)
            address = (
                f"http://{_in_url(options.expose or LOCAL)}:{server.port}/{context.pages[0].path}"
            )
            address += f"?token={token}" if token else ""
            progress(f"studio: {address}  (Ctrl-C ends)")
            if options.browser:
                IOLoop.current().call_later(0.2, lambda: webbrowser.open(address))
            PeriodicCallback(session.update, 250).start()  # also while no page is open
            _run_until_stopped(server)
    finally:
        session.close()
        fleet.worker.cancel()


def fleet_folder(options: StudioOptions) -> Path | None:
    """The one given, BadInput where it has no table; else where `shadow fleet` writes."""
    folder = options.fleet or options.out / "fleet"
    if (folder / TABLE).is_file():
        return folder.resolve()
    if options.fleet is not None:
        raise BadInput(f"--fleet {folder}: no {TABLE} in it: shadow fleet writes it")
    return None


def session_of(options: StudioOptions) -> Session:
    """The session with what was given; with the demo recordings where nothing was."""
    logs, vessel = options.logs, options.vessel
    if not logs and not options.folders and vessel is None and DEMO_VESSEL.is_file():
        logs, vessel = tuple(log for log in DEMO_LOGS if log.is_file()), DEMO_VESSEL
    given = [*logs, *([vessel] if vessel else [])]
    mapping = [options.mapping] if options.mapping is not None else []
    for file in (*given, *options.effects, *mapping):
        if not file.is_file():
            raise BadInput(f"{file}: no such file")
    folders = Folders.of(given, options.folders or (() if given else (Path.cwd(),)), options.out)
    session = Session(folders, (), None, tuple(EffectFile(str(file)) for file in options.effects))
    session.mapping = None if options.mapping is None else str(options.mapping)
    if vessel is not None:
        session.set_vessel(vessel)
    session.set_logs(logs)
    session.update()  # the comparison begins before the first page is open
    return session


def server_of(context: StudioContext, options: StudioOptions, token: str | None = None) -> Any:
    """The server, listening already; BadInput where the port is taken."""
    apps = {entry.path: _app(entry, context) for entry in context.pages}
    titles = {entry.path: f"{entry.title} – Shadow studio" for entry in context.pages}
    auth = TokenAuth(token) if token else None
    more = {"auth_provider": auth} if auth else {}
    address = LOCAL if options.expose is None else options.expose
    tiles = open_tiles(context.settings.file) if context.settings.file is not None else None
    _check_port(address, options.port)
    server = pn.io.server.get_server(
        apps, port=options.port, address=address, show=False, start=False, title=titles,
        websocket_origin=origins_of(options), use_index=False,
        keep_alive_milliseconds=10_000, **more,
    )  # fmt: skip
    # before all other routes, of pages and websockets and files
    strangers = Rule(OtherHost(origins_of(options)), OtherHostHandler)
    server._tornado.default_router.rules[:0] = [
        strangers,
        *routes(context.session.run, context.pages[0].path, tiles,
                lambda handler: auth is None or auth.get_user(handler) is not None),
    ]  # fmt: skip
    server.start()
    return server


def settings_of_file(settings: StudioSettings) -> StudioSettings:
    """Where tiles come from a file: no deeper than it goes, its own credit unless one is given."""
    if settings.file is None:
        return settings
    file = open_tiles(settings.file)
    whose = file.attribution if settings.attribution == CREDIT else settings.attribution
    return replace(settings, deepest=min(settings.deepest, file.deepest), attribution=whose)


def _check_port(address: str, port: int) -> None:
    """BadInput where the server could not listen."""
    if not address:
        raise BadInput("--expose: expected an address of this machine, as 192.168.1.20 or 0.0.0.0")
    if not 0 <= port <= 65535:
        raise BadInput(f"--port {port}: expected 0 to 65535")
    try:
        family, *_, place = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.bind(place)
    except (socket.gaierror, UnicodeError):
        raise BadInput(f"--expose {address}: no address of this machine") from None
    except OSError as error:
        advice = (
            "not an address of this machine"
            if error.errno == errno.EADDRNOTAVAIL
            else "is another studio there? give --port"
        )
        raise BadInput(f"{address}:{port}: {error.strerror}: {advice}") from None


def _in_url(address: str) -> str:
    """An address as it stands in a URL: one of IPv6 in brackets."""
    return f"[{address}]" if ":" in address else address


def origins_of(options: StudioOptions) -> list[str]:
    """Names under which the server answers, and whose pages may open a websocket."""
    hosts = [LOCAL, "localhost", *([_in_url(options.expose)] if options.expose else [])]
    return [*(f"{host}:{options.port}" for host in hosts), *options.origins]


def _app(entry: PageEntry, context: StudioContext) -> Callable[[], Any]:
    """A page, or a line that it could not be made: what went wrong stands in the log."""

    def open_page() -> Any:
        try:
            return entry.page(context).show(entry)
        except Exception:  # the outermost loop of a page that opens
            print(traceback.format_exc(), file=sys.stderr, flush=True)
            return pn.pane.HTML(f"<p>{BUG}</p>")

    return open_page


def _run_until_stopped(server: Any) -> None:
    loop = IOLoop.current()
    for number in other_ends():
        signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
    try:
        loop.start()
    except KeyboardInterrupt:
        pass
    finally:
        server.stop()
