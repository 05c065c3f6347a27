"""`shadow monitor`: show the vessels a few times a second; once, until interrupted, or as JSON."""

import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import orjson
from rich.live import Live

from gateway.errors import BadInput, ShadowError
from gateway.monitor import BusWatcher, MonitorOptions, VesselStatus
from gateway.terminal.console import SafeConsole
from gateway.terminal.monitor import monitor_view, show_once, waiting_view

PERIOD_S = 0.25
SETTLE_S = 3.0  # for a vessel's slow topics, once it is there
QUIET_S = 0.4  # without another topic: all last values are there
COMPLETE = frozenset(("measured", "shadow", "residual", "health"))


def run_monitor(options: MonitorOptions, once: bool, json: bool) -> None:
    """Show until interrupted; with `once` one status, or ShadowError where no vessel is there."""
    if options.vessel != "*" and any(letter in options.vessel for letter in "/*$?#@"):
        raise BadInput(f"{options.vessel}: no name of a vessel: give it as in shadow/NAME/…")
    with ExitStack() as scope:
        watcher = BusWatcher(options, scope)
        if once:
            statuses = _first_statuses(watcher, options)
            _print_lines(statuses, {}) if json else show_once(statuses)
            return
        with _until_interrupted():
            _lines(watcher, options) if json else _screen(watcher, options)


def _first_statuses(watcher: BusWatcher, options: MonitorOptions) -> tuple[VesselStatus, ...]:
    """Wait for a vessel, then until its slow topics are there too."""
    end = time.monotonic() + options.patience_s
    while not any(status.alive for status in watcher.statuses()):
        if time.monotonic() > end:
            raise ShadowError(_absence(watcher, options))
        time.sleep(0.05)
    statuses, grown = watcher.statuses(), time.monotonic()
    end, count = grown + SETTLE_S, 0
    while (now := time.monotonic()) < end:
        if (topics := sum(len(s.latest) for s in statuses)) != count:
            grown, count = now, topics
        if now - grown > QUIET_S and all(COMPLETE <= set(s.latest) for s in statuses):
            break
        time.sleep(0.05)
        statuses = watcher.statuses()
    return statuses


def _absence(watcher: BusWatcher, options: MonitorOptions) -> str:
    vessel = "vessel" if options.vessel == "*" else f"vessel {options.vessel}"
    found = f"zenoh answers, but no {vessel} is there" if watcher.connected else "nobody answers"
    return f"{options.where}: {found}: start `shadow live` or `shadow replay --speed 1` first"


def _screen(watcher: BusWatcher, options: MonitorOptions) -> None:
    console = SafeConsole()
    if not console.is_terminal:
        raise BadInput("standard output is no terminal: use --once or --json")
    with Live(console=console, screen=True, auto_refresh=False) as live:
        for statuses in _poll(watcher):
            if statuses:
                live.update(monitor_view(statuses, console.width, console.height), refresh=True)
            else:
                live.update(waiting_view(options.where, watcher.connected), refresh=True)


def _lines(watcher: BusWatcher, options: MonitorOptions) -> None:
    """A line for each vessel with a new message, or that came or went."""
    printed: dict[str, VesselStatus] = {}
    if not watcher.statuses() and not watcher.connected:
        print(f"{options.where}: nobody answers yet, waiting", file=sys.stderr)
    for statuses in _poll(watcher):
        _print_lines([s for s in statuses if _is_new(s, printed.get(s.name))], printed)


def _is_new(status: VesselStatus, before: VesselStatus | None) -> bool:
    if before is None or status.alive != before.alive:
        return True
    return status.messages() != before.messages()


def _print_lines(statuses: Sequence[VesselStatus], printed: dict[str, VesselStatus]) -> None:
    """Each vessel as a line, with the events since the one in `printed`, which is replaced."""
    for status in statuses:
        before = printed.get(status.name)
        line = status.to_dict(before.event_count if before else 0)
        sys.stdout.buffer.write(orjson.dumps(line, option=orjson.OPT_APPEND_NEWLINE))
        printed[status.name] = status
    sys.stdout.buffer.flush()


def _poll(watcher: BusWatcher) -> Iterator[tuple[VesselStatus, ...]]:
    """The vessels as they are, a few times a second."""
    while True:
        yield watcher.statuses()
        time.sleep(PERIOD_S)


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
