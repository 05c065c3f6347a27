"""`shadow monitor`: look a few times a second and show; once, on and on, or as lines of JSON."""

import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import orjson
from rich.console import Console
from rich.live import Live

from gateway.bus import DEFAULT_ENDPOINT
from gateway.errors import BadInput, ShadowError
from gateway.monitor.vessel_view import VesselPicture
from gateway.monitor.watcher import Watcher, join
from gateway.terminal.monitor import monitor_view, show_once, waiting_view

PERIOD_S = 0.25
RETRY_S = 1.0  # between attempts to join where nobody answers
SETTLE_S = 3.0  # for a vessel's slow topics, once it is seen
QUIET_S = 0.4  # without another topic: all last values are there
COMPLETE = frozenset(("measured", "shadow", "residual", "health"))


@dataclass(frozen=True)
class MonitorOptions:
    """Where and whom to watch."""

    endpoint: str = DEFAULT_ENDPOINT
    config_file: Path | None = None
    vessel: str = "*"
    patience_s: float = 5.0  # of `once`

    @property
    def where(self) -> str:
        """The place in words."""
        return str(self.config_file) if self.config_file else self.endpoint


class BusWatcher:
    """Joins as soon as somebody answers, and watches from then on."""

    def __init__(self, options: MonitorOptions, scope: ExitStack) -> None:
        self._options, self._scope = options, scope
        self._watcher: Watcher | None = None
        self._next_try = -float("inf")

    @property
    def connected(self) -> bool:
        """Has anybody answered?"""
        return self._watcher is not None

    def pictures(self) -> tuple[VesselPicture, ...]:
        """All vessels known now."""
        if self._watcher is None and time.monotonic() >= self._next_try:
            self._join()
            self._next_try = time.monotonic() + RETRY_S
        return () if self._watcher is None else self._watcher.pictures()

    def _join(self) -> None:
        session = join(self._options.endpoint, self._options.config_file)
        if session is not None:
            self._scope.enter_context(session)
            self._watcher = self._scope.enter_context(Watcher(session, self._options.vessel))


def monitor(options: MonitorOptions, once: bool, json: bool) -> None:
    """Show until interrupted; with `once` one picture, or ShadowError where nobody is there."""
    if options.vessel != "*" and any(letter in options.vessel for letter in "/*$?#@"):
        raise BadInput(f"{options.vessel}: no name of a vessel: give it as in shadow/NAME/…")
    with ExitStack() as scope:
        eyes = BusWatcher(options, scope)
        if once:
            found = _first_picture(eyes, options)
            _print_lines(found, {}) if json else show_once(found)
            return
        with _until_interrupted():
            _lines(eyes, options) if json else _screen(eyes, options)


def _first_picture(eyes: BusWatcher, options: MonitorOptions) -> tuple[VesselPicture, ...]:
    """Wait for a vessel, then a moment more for what it says less often."""
    end = time.monotonic() + options.patience_s
    while not any(picture.alive for picture in eyes.pictures()):
        if time.monotonic() > end:
            raise ShadowError(_nobody(eyes, options))
        time.sleep(0.05)
    found, grown = eyes.pictures(), time.monotonic()
    end, count = grown + SETTLE_S, 0
    while (now := time.monotonic()) < end:
        if (topics := sum(len(p.latest) for p in found)) != count:
            grown, count = now, topics
        if now - grown > QUIET_S and all(COMPLETE <= set(p.latest) for p in found):
            break
        time.sleep(0.05)
        found = eyes.pictures()
    return found


def _nobody(eyes: BusWatcher, options: MonitorOptions) -> str:
    who = "vessel" if options.vessel == "*" else f"vessel {options.vessel}"
    found = f"zenoh answers, but no {who} is there" if eyes.connected else "nobody answers"
    return f"{options.where}: {found}: start `shadow live` or `shadow replay --speed 1` first"


def _screen(eyes: BusWatcher, options: MonitorOptions) -> None:
    console = Console()
    if not console.is_terminal:
        raise BadInput("standard output is no terminal: use --once or --json")
    with Live(console=console, screen=True, auto_refresh=False) as live:
        for found in _looks(eyes):
            view = monitor_view(found, console.width, console.height)
            live.update(
                view if found else waiting_view(options.where, eyes.connected), refresh=True
            )


def _lines(eyes: BusWatcher, options: MonitorOptions) -> None:
    """A line for each vessel that says something new, or that came or went."""
    told: dict[str, VesselPicture] = {}
    if not eyes.pictures() and not eyes.connected:
        print(f"{options.where}: nobody answers yet, waiting", file=sys.stderr)
    for found in _looks(eyes):
        fresh = [p for p in found if p.name not in told or p.says() != told[p.name].says()]
        _print_lines(fresh, told)


def _print_lines(found: Sequence[VesselPicture], told: dict[str, VesselPicture]) -> None:
    """Each vessel as a line; `told` remembers what was printed of it."""
    for one in found:
        before = told.get(one.name)
        line = one.to_dict(before.told if before else 0)
        sys.stdout.buffer.write(orjson.dumps(line, option=orjson.OPT_APPEND_NEWLINE))
        told[one.name] = one
    sys.stdout.buffer.flush()


def _looks(
    eyes: BusWatcher, sleep: Callable[[float], None] = time.sleep
) -> Iterator[tuple[VesselPicture, ...]]:
    """What there is to see, a few times a second."""
    while True:
        yield eyes.pictures()
        sleep(PERIOD_S)


@contextmanager
def _until_interrupted() -> Iterator[None]:
    """Ctrl-C and SIGTERM end the block as its normal end, so that the terminal is put in order."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
