"""`shadow monitor`: vessels on the bus, in full where there is room, else a line each; as JSON.

Whether each model is right stands in sentences of its own. Below come events, in the lines that are
left: warnings and what bears on the model first, answers to requests last.
"""

import io
import math
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import orjson
from rich.console import Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gateway.errors import BadInput, ShadowError, one_line
from gateway.figures import SURGE, SWAY, YAW_RATE
from gateway.long_running import other_ends
from gateway.monitor import (
    HIGH_LOSS,
    HIGH_NIS,
    LINK_SILENT_S,
    SILENT_S,
    BusWatcher,
    Message,
    MonitorOptions,
    VesselStatus,
    time_of_day,
)
from gateway.terminal import SafeConsole
from gateway.terminal.standing import Standing, Verdict, standing_of
from gateway.topics import HORIZONS_S, RATED

KNOT_MPS = 1852.0 / 3600.0
WIDE = 110  # columns from which link and rates stand beside the motion
MOTION_COLUMNS = 74
EVENT_LINES = 6  # where the terminal does not say how many there are
LEAST_EVENT_LINES = 2  # of each of several vessels in full
FRAME_LINES, FRAME_COLUMNS = 2, 4
CLOCK_COLUMNS = 9
ROUTINE = frozenset(("rate_request",))  # events that come last
BEARING = ("model_", "sensor_")  # so begin kinds of events that come first, as warnings do
SIGNIFICANT = 3.0  # standard deviations from which a missing force is marked
LARGE_STD = 99.9  # has no digits behind the point: it would run into the unit
SAME_TIME_NS = 5e8  # boat and shadow further apart are not compared
LOOP_LATE_S = 0.1  # marked from there on

AXES = (  # field, how many of the unit shown make one of its unit, digits
    ("surge_mps", SURGE.factor, 2), ("sway_mps", SWAY.factor, 2),
    ("yaw_rate_radps", YAW_RATE.factor, 1),
)  # fmt: skip
FORCES = ("missing_surge_n", "missing_sway_n", "missing_yaw_nm")
GOOD, BAD, WARN, FAINT = "green", "bold red", "yellow", "bright_black"
STYLES = {"debug": FAINT, "info": "", "warning": WARN, "error": BAD}


def monitor_view(
    statuses: Sequence[VesselStatus], width: int, height: int | None = None
) -> RenderableType:
    """All vessels; `height` in lines where they must fit, None where they need not."""
    inside = width - FRAME_COLUMNS
    bodies = [_body(status, width) for status in statuses]
    free = EVENT_LINES * len(bodies)
    if height is not None:
        free = height - sum(_lines_of(body, inside) + FRAME_LINES for body in bodies)
        if len(bodies) > 1 and free < LEAST_EVENT_LINES * len(bodies):
            return _overview(statuses, width, height)
    panels = []
    for left, (status, body) in enumerate(zip(statuses, bodies, strict=True)):
        events = _events([status], inside, max(free, 0) // (len(bodies) - left))
        free -= _lines_of(events, inside)
        title = Text.assemble((status.name, "bold"), "  ", _state(status))
        panels.append(Panel(Group(body, events), title=title, title_align="left"))
    return Group(*panels)


def waiting_view(where: str, connected: bool) -> RenderableType:
    """The line that stands there while there is no vessel."""
    state = "no vessel there yet" if connected else "nobody answers yet"
    return Text(f"{where}: {state}; waiting (Ctrl-C ends)", style=WARN)


def show_once(statuses: Sequence[VesselStatus]) -> None:
    """All vessels as they are now, on standard output."""
    out = SafeConsole()
    out.print(monitor_view(statuses, out.width))


def _lines_of(shown: RenderableType, width: int) -> int:
    """How many lines of that width it takes."""
    console = SafeConsole(file=io.StringIO(), width=width)
    return len(console.render_lines(shown, pad=False))


def _body(status: VesselStatus, width: int) -> Group:
    """All of a vessel but its events."""
    motion, link = _motion(status), _link(status.message("health"))
    body: list[RenderableType] = [motion, *link]
    if width >= WIDE:
        beside = Table.grid(padding=(0, 2))
        beside.add_column(width=MOTION_COLUMNS)
        beside.add_row(motion, Group(*link))
        body = [beside]
    return Group(*_where(status), *_judgement(standing_of(status)), *body)


def _judgement(standing: Standing) -> list[Text]:
    """Whether the model is right, and why that cannot be judged just now."""
    verdict, says, unfit = standing
    style = {Verdict.RIGHT: GOOD, Verdict.WRONG: f"bold {WARN}"}.get(verdict, FAINT)
    if not unfit:
        return [Text(one_line(says), style=style)]
    before = [] if verdict is Verdict.OPEN else [Text(f"before: {one_line(says)}", style=style)]
    return [Text(one_line(unfit), style=WARN), *before]


def _state(status: VesselStatus) -> Text:
    """Alive, diverging or gone, what the shadow follows, how often news comes."""
    if not status.alive:
        return Text("○ gone", style=BAD)
    health, standing = status.message("health"), standing_of(status)
    words = Text("● alive", style=GOOD)
    if standing.verdict is Verdict.WRONG:
        words = Text("● model wrong", style=f"bold {WARN}")
    if health is not None and health["unfit"]:
        words = Text("● cannot judge", style=WARN)
    if health is not None and health["diverging"]:
        words = Text("● diverges", style=BAD)
    reference, age = status.message("reference"), status.age_s()
    if reference is not None:
        model = reference["source"] == "model"
        words.append(", follows the model's prediction" if model else ", follows the measurement",
                     style=WARN if model else GOOD)  # fmt: skip
    if age is None or age > SILENT_S:
        since = "" if age is None else f" for {age:.0f} s"
        words.append(f", nothing new{since}", style=WARN)
    else:
        words.append(f", {status.rate_hz:.0f} Hz")
    return words


def _motion(status: VesselStatus) -> Table:
    """Three axes: boat, shadow, how they differ, the model's errors, the missing force."""
    table = Table.grid()
    table.add_column(width=14)
    for _ in AXES:
        table.add_column(width=17)
    table.add_column(width=9, style=FAINT)
    table.add_row("", *(f"{name:>10}" for name in ("ahead", "starboard", "turn right")))
    boat, shadow = status.message("measured"), status.message("shadow")
    residual = status.message("residual")
    rows = [("boat", boat, "{}", True), ("shadow", shadow, "{}", False),
            ("boat − shadow", _difference(boat, shadow), "{}", False)]  # fmt: skip
    rows += [(f"error at {h} s", residual, f"error_{{}}_{h}s", False) for h in HORIZONS_S]
    for label, message, field, stds in rows:
        table.add_row(label, *_axes(message, field, stds), " m/s, °/s")
    table.add_row("missing force", *_forces(residual), " N, N m")
    return table


def _axes(message: Message | None, field: str, stds: bool) -> list[Text]:
    """u, v, r of a message in the units people read; `field` names them, `{}` being the axis."""
    if message is None:
        return [_cell("·")] * len(AXES)
    return [
        _cell(
            _number(message[field.format(name)] * scale, digits),
            _spread(message[f"{name}_std"] * scale, digits) if stds else "",
        )
        for name, scale, digits in AXES
    ]


def _forces(residual: Message | None) -> list[Text]:
    """The missing force with its standard deviations, marked where it is significant."""
    if residual is None:
        return [_cell("·")] * len(FORCES)
    cells = []
    for name in FORCES:
        value, std = residual[name], residual[f"{name}_std"]
        style = f"bold {WARN}" if abs(value) > SIGNIFICANT * std else ""
        cells.append(_cell(_number(value, 1), _spread(std, 1), style))
    return cells


def _cell(value: str, std: str = "", style: str = "") -> Text:
    """A value, and its standard deviation so that values stand below each other."""
    spread = f" ±{std}" if std else ""
    return Text.assemble((f"{value:>10}", style), (f"{spread:<7}", FAINT))


def _difference(boat: Message | None, shadow: Message | None) -> Message | None:
    """Boat − shadow, where both are of the same time; a boat that is silent is not compared."""
    if boat is None or shadow is None:
        return None
    if abs(boat["vehicle_time_ns"] - shadow["vehicle_time_ns"]) > SAME_TIME_NS:
        return None
    names = (*(name for name, _, _ in AXES), "north_m", "east_m")
    return {name: boat[name] - shadow[name] for name in names}


def _where(status: VesselStatus) -> list[Text]:
    """Speed, heading and place in words."""
    boat = status.motion()
    if boat is None:
        return [Text("no estimate yet", style=FAINT)]
    line = Text(f"{_number(_knots(boat), 2)} kn, heading {_heading(boat['yaw_rad'])}°")
    off = _difference(status.message("measured"), status.message("shadow"))
    if off is not None:
        line.append(f", shadow {_number(math.hypot(off['north_m'], off['east_m']), 2)} m away")
    place = status.message("position")
    if place is not None:
        line.append(
            f", {_degrees(place['boat_latitude_deg'], 'NS')}"
            f" {_degrees(place['boat_longitude_deg'], 'EW')}",
            style=FAINT,
        )
    return [line]


def _link(health: Message | None) -> list[Text]:
    """State of link, filter and gateway; what is not well is marked."""
    if health is None:
        return [Text("link: no health message yet", style=FAINT)]
    h = health
    link = _words(
        "link",
        (f"silent for {_number(h['link_age_s'], 1)} s", h["link_age_s"] > LINK_SILENT_S),
        (f"{_number(h['rate_hz'], 0)} messages/s", False),
        (f"loss {_number(100 * h['loss'], 1)} %", h["loss"] > HIGH_LOSS),
        (f"clock offset {_number(h['clock_offset_s'], 3)} s", False),
    )
    inside = _words(
        "filter",
        (f"NIS {_number(h['nis'], 2)}", h["nis"] > HIGH_NIS),
        (f"gated {h['gated']}", False),
        (f"late {h['late']}", False),
        (f"diverged {h['divergences']}", h["diverging"] > 0),
        (f"loop {_number(1000 * h['loop_lateness_s'], 1)} ms", h["loop_lateness_s"] > LOOP_LATE_S),
        (f"to record {h['recorder_backlog']}", False),
        (f"not recorded {h['recorder_drops']}", h["recorder_drops"] > 0),
    )
    rates = [
        (f"{name.replace('_', ' ')} {_number(h[f'rate_{name}_hz'], 0)}", False)
        for name in RATED
        if h[f"rate_{name}_hz"] > 0.0
    ]
    return [link, inside, _words("rates", *rates)]


def _words(head: str, *parts: tuple[str, bool]) -> Text:
    """Parts on one line or two, those with True in the colour of a warning."""
    line = Text(f"{head}: ", style="")
    for number, (text, bad) in enumerate(parts):
        line.append(", " if number else "")
        line.append(text, style=WARN if bad else "")
    return line


def _events(statuses: Sequence[VesselStatus], width: int, lines: int) -> Table:
    """As many events as fit into so many lines, in their order: those that matter most and
    the newest first; what stands above as the judgement of a model is not told again.

    Of several vessels each with the name.
    """
    standing = [status.judged.event for status in statuses if status.judged is not None]
    named = len(statuses) > 1
    known = [(event, status.name if named else "") for status in statuses
             for event in status.events if event not in standing]  # fmt: skip
    known.sort(key=lambda one: one[0]["receive_time_ns"])
    chosen: list[int] = []
    for k in sorted(range(len(known)), key=lambda k: (_rank(known[k][0]), -k)):
        if (needed := _lines_of(_told(*known[k]), width - CLOCK_COLUMNS)) <= lines:
            chosen, lines = [*chosen, k], lines - needed
        if lines <= 0:
            break
    table = Table.grid()
    table.add_column(width=CLOCK_COLUMNS, style=FAINT, no_wrap=True)
    table.add_column(overflow="fold")
    for k in sorted(chosen):
        event, name = known[k]
        table.add_row(time_of_day(event["receive_time_ns"]), _told(event, name))
    return table


def _rank(event: Message) -> int:
    """Which events come first: of model and sensors, and warnings; then others, requests last."""
    if event["kind"].startswith(BEARING) or event["severity"] in ("warning", "error"):
        return 0
    return 2 if event["kind"] in ROUTINE else 1


def _told(event: Message, name: str) -> Text:
    """What happened, of which vessel if `name` is given."""
    text = f"{name}: {one_line(event['says'])}" if name else one_line(event["says"])
    return Text(text, style=STYLES.get(event["severity"], WARN))


def _overview(statuses: Sequence[VesselStatus], width: int, height: int) -> Group:
    """One line per vessel, the essentials; below, what stands of models that are not right, and
    events in the lines that are left.
    """
    table = Table(box=None, padding=(0, 1), pad_edge=False)
    table.add_column("vessel", no_wrap=True, max_width=18)
    for name in ("model", "kn", "°", "off m", "missing σ", "silent s", "Hz", "loss %"):
        table.add_column(name, justify="right", no_wrap=True)
    for status in statuses:
        table.add_row(*_line(status))
    odd = [text for status in statuses for text in _odd(status)]
    left, told = height - _lines_of(table, width), list[Text]()
    while odd and (needed := _lines_of(odd[0], width)) <= left - (len(odd) > 1):
        told, odd, left = [*told, odd[0]], odd[1:], left - needed
    if odd:
        told, left = (
            [*told, Text(f"and {len(odd)} more: `shadow monitor NAME` shows one", style=FAINT)],
            left - 1,
        )
    return Group(table, *told, _events(statuses, width, left))


def _odd(status: VesselStatus) -> list[Text]:
    """What stands of a vessel whose model is wrong or cannot be judged, with its name."""
    standing = standing_of(status)
    if standing.verdict is not Verdict.WRONG:
        told = [Text(one_line(standing.unfit), style=WARN)] if standing.unfit else []
    else:
        told = _judgement(standing)
    return [Text.assemble((f"{status.name}: ", "bold"), text) for text in told]


def _line(status: VesselStatus) -> list[RenderableType]:
    boat = status.motion()
    off = _difference(status.message("measured"), status.message("shadow"))
    residual, health = status.message("residual"), status.message("health")
    cells: list[RenderableType] = [
        Text(status.name, style="bold"),
        _dot(status),
    ]
    cells += ["·", "·"] if boat is None else [_number(_knots(boat), 2), _heading(boat["yaw_rad"])]
    cells.append("·" if off is None else _number(math.hypot(off["north_m"], off["east_m"]), 2))
    cells.append("·" if residual is None else _worst(residual))
    cells.append("·" if health is None else _number(health["link_age_s"], 1))
    cells.append(_number(status.rate_hz, 0))
    cells.append("·" if health is None else _number(100 * health["loss"], 1))
    return cells


def _dot(status: VesselStatus) -> Text:
    """Whether a vessel is there, and its model right."""
    if not status.alive:
        return Text("○ gone", style=BAD)
    standing = standing_of(status)
    if standing.unfit:
        return Text("● ?", style=WARN)
    style = {Verdict.RIGHT: GOOD, Verdict.WRONG: f"bold {WARN}"}.get(standing.verdict, FAINT)
    return Text(f"● {standing.verdict.value}", style=style)


def _knots(boat: Message) -> float:
    return math.hypot(boat["surge_mps"], boat["sway_mps"]) / KNOT_MPS


def _worst(residual: Message) -> Text:
    """The largest missing force in its own standard deviations."""
    ratio = max(abs(residual[n]) / max(residual[f"{n}_std"], 1e-9) for n in FORCES)
    return Text(_number(ratio, 1), style=WARN if ratio > SIGNIFICANT else "")


def _degrees(value: float, letters: str) -> str:
    """Latitude or longitude with the letter of its half of the world."""
    return f"{_number(abs(value), 5)}° {letters[value < 0.0]}"


def _heading(yaw: float) -> str:
    """Radians -> 0 to 360 degrees; a question mark for what is no number."""
    return f"{math.degrees(yaw) % 360.0:05.1f}" if math.isfinite(yaw) else "?"


def _spread(std: float, digits: int) -> str:
    """A standard deviation in five columns: without digits where it is large."""
    return _number(std, digits if abs(std) < LARGE_STD else 0)


def _number(value: float, digits: int) -> str:
    """So many digits, but never wider than its column, and never −0."""
    if abs(value) >= 1e6:
        return f"{value:.0e}"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


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
    """Ctrl-C, SIGTERM and SIGHUP end the block as its normal end: the terminal is put in order."""
    before = {n: signal.signal(n, signal.default_int_handler) for n in other_ends()}
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
