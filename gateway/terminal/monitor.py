"""What `shadow monitor` shows: every vessel in full where there is room, else one line each."""

import math
from collections.abc import Sequence
from datetime import datetime

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from gateway.monitor.vessel_view import Message, VesselPicture
from gateway.topics import HORIZONS_S, RATED

KNOT_MPS = 1852.0 / 3600.0
WIDE = 110  # columns from which link and rates stand beside the motion
FULL_LINES = 21  # of a vessel in full at 80 columns, WIDE_LINES at WIDE
WIDE_LINES = 17
MOTION_COLUMNS = 74
EVENTS_SHOWN = 4
QUIET_S = 2.0  # without news: worth a word
SIGNIFICANT = 3.0  # standard deviations

AXES = (("surge_mps", 1.0, 2), ("sway_mps", 1.0, 2), ("yaw_rate_radps", 180.0 / math.pi, 1))
FORCES = ("missing_surge_n", "missing_sway_n", "missing_yaw_nm")
GOOD, BAD, WARN, FAINT = "green", "bold red", "yellow", "bright_black"
STYLES = {"debug": FAINT, "info": "", "warning": WARN, "error": BAD}


def monitor_view(
    pictures: Sequence[VesselPicture], width: int, height: int | None = None
) -> RenderableType:
    """All vessels; `height` in lines where they must fit, None where they need not."""
    lines = WIDE_LINES if width >= WIDE else FULL_LINES
    if height is not None and len(pictures) > 1 and lines * len(pictures) > height:
        return _overview(pictures)
    return Group(*(_vessel(picture, width) for picture in pictures))


def waiting_view(where: str, connected: bool) -> RenderableType:
    """What there is to say while nobody is there."""
    state = "no vessel there yet" if connected else "nobody answers yet"
    return Text(f"{where}: {state}; waiting (Ctrl-C ends)", style=WARN)


def show_once(pictures: Sequence[VesselPicture]) -> None:
    """One picture of all vessels on standard output."""
    out = Console()
    out.print(monitor_view(pictures, out.width))


def _vessel(picture: VesselPicture, width: int) -> Panel:
    motion, link = _motion(picture), _link(picture.message("health"))
    body: list[RenderableType] = [motion, *link]
    if width >= WIDE:
        side_by_side = Table.grid(padding=(0, 2))
        side_by_side.add_column(width=MOTION_COLUMNS)
        side_by_side.add_row(motion, Group(*link))
        body = [side_by_side]
    where = _where(picture)
    events = [_event(event) for event in picture.events[-EVENTS_SHOWN:]]
    title = Text.assemble((picture.name, "bold"), "  ", _state(picture))
    return Panel(Group(*where, *body, *events), title=title, title_align="left")


def _state(picture: VesselPicture) -> Text:
    """Alive or gone, what the shadow follows, how often news comes."""
    if not picture.alive:
        return Text("○ gone", style=BAD)
    words = Text("● alive", style=GOOD)
    reference, age = picture.message("reference"), picture.age_s()
    if reference is not None:
        model = reference["source"] == "model"
        words.append(", follows the model's prediction" if model else ", follows the measurement",
                     style=WARN if model else GOOD)  # fmt: skip
    if age is None or age > QUIET_S:
        since = "" if age is None else f" for {age:.0f} s"
        words.append(f", nothing new{since}", style=WARN)
    else:
        words.append(f", {picture.rate_hz:.0f} Hz")
    return words


def _motion(picture: VesselPicture) -> Table:
    """Three axes: boat, shadow, how they differ, what the model lacks."""
    table = Table.grid()
    table.add_column(width=14)
    for _ in AXES:
        table.add_column(width=17)
    table.add_column(width=9, style=FAINT)
    table.add_row("", *(f"{name:>10}" for name in ("ahead", "starboard", "turn right")))
    boat, shadow = picture.message("measured"), picture.message("shadow")
    units = "m/s, °/s"
    table.add_row("boat", *_axes(boat, stds=True), units)
    table.add_row("shadow", *_axes(shadow), units)
    table.add_row("boat − shadow", *_axes(_difference(boat, shadow)), units)
    residual = picture.message("residual")
    for horizon in HORIZONS_S:
        error = _error(residual, horizon)
        table.add_row(f"error at {horizon} s", *_axes(error), units)
    table.add_row("missing force", *_forces(residual), "N, N m")
    return table


def _axes(message: Message | None, stds: bool = False) -> list[Text]:
    """u, v, r of a motion message, in the units people read."""
    if message is None:
        return [_cell("·")] * len(AXES)
    return [
        _cell(
            _number(message[name] * scale, digits),
            _number(message[f"{name}_std"] * scale, digits) if stds else "",
        )
        for name, scale, digits in AXES
    ]


def _cell(value: str, std: str = "", style: str = "") -> Text:
    """A value, and its standard deviation so that values stand below each other."""
    spread = f" ±{std}" if std else ""
    return Text.assemble((f"{value:>10}", style), (f"{spread:<7}", FAINT))


def _difference(boat: Message | None, shadow: Message | None) -> Message | None:
    """Boat − shadow, where both tell of the same time; a boat that is silent is not compared."""
    if boat is None or shadow is None:
        return None
    if abs(boat["vehicle_time_ns"] - shadow["vehicle_time_ns"]) > 5e8:
        return None
    names = (*(name for name, _, _ in AXES), "north_m", "east_m")
    return {name: boat[name] - shadow[name] for name in names}


def _error(residual: Message | None, horizon: int) -> Message | None:
    if residual is None:
        return None
    return {name: residual[f"error_{name}_{horizon}s"] for name, _, _ in AXES}


def _forces(residual: Message | None) -> list[Text]:
    if residual is None:
        return [_cell("·")] * len(FORCES)
    return [_force(residual[name], residual[f"{name}_std"]) for name in FORCES]


def _force(value: float, std: float) -> Text:
    """A force that stands out of its own uncertainty catches the eye."""
    style = f"bold {WARN}" if abs(value) > SIGNIFICANT * std else ""
    return _cell(_number(value, 1), _number(std, 1), style)


def _where(picture: VesselPicture) -> list[Text]:
    """Speed, heading and place in words."""
    boat = picture.message("measured") or picture.message("shadow")
    if boat is None:
        return [Text("no estimate yet", style=FAINT)]
    speed = math.hypot(boat["surge_mps"], boat["sway_mps"])
    line = Text(f"{_number(speed / KNOT_MPS, 2)} kn, heading {_heading(boat['yaw_rad'])}°")
    off = _difference(picture.message("measured"), picture.message("shadow"))
    if off is not None:
        line.append(f", shadow {_number(math.hypot(off['north_m'], off['east_m']), 2)} m away")
    place = picture.message("position")
    if place is not None:
        line.append(
            f", {_degrees(place['boat_latitude_deg'], 'NS')}"
            f" {_degrees(place['boat_longitude_deg'], 'EW')}",
            style=FAINT,
        )
    return [line]


def _link(health: Message | None) -> list[Text]:
    """How well link, filter and gateway are; what is not well stands out."""
    if health is None:
        return [Text("link: no health message yet", style=FAINT)]
    h = health
    link = _words(
        "link",
        (f"silent for {_number(h['link_age_s'], 1)} s", h["link_age_s"] > 1.0),
        (f"{_number(h['rate_hz'], 0)} messages/s", False),
        (f"loss {_number(100 * h['loss'], 1)} %", h["loss"] > 0.05),
        (f"clock offset {_number(h['clock_offset_s'], 3)} s", False),
    )
    inside = _words(
        "filter",
        (f"NIS {_number(h['nis'], 2)}", h["nis"] > 3.0),
        (f"gated {h['gated']}", False),
        (f"late {h['late']}", False),
        (f"loop {_number(1000 * h['loop_lateness_s'], 1)} ms", h["loop_lateness_s"] > 0.1),
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
    """Parts on one line or two, those that are marked in a colour of warning."""
    line = Text(f"{head}: ", style="")
    for number, (says, bad) in enumerate(parts):
        line.append(", " if number else "")
        line.append(says, style=WARN if bad else "")
    return line


def _event(event: Message, name: str = "") -> Text:
    """A line: when, which vessel where that is not plain, and what happened."""
    style = STYLES.get(event["severity"], WARN)
    line = Text(f"{_clock(event['receive_time_ns'])} ", style=FAINT, no_wrap=True,
                overflow="ellipsis")  # fmt: skip
    return line.append(f"{name}: " if name else "").append(event["says"], style=style)


def _overview(pictures: Sequence[VesselPicture]) -> Group:
    """One line per vessel, the essentials; below, the latest events of all."""
    table = Table(box=None, padding=(0, 1), pad_edge=False)
    table.add_column("vessel", no_wrap=True, max_width=24)
    for name in ("", "kn", "°", "off m", "missing σ", "silent s", "Hz", "loss %"):
        table.add_column(name, justify="right", no_wrap=True)
    for picture in pictures:
        table.add_row(*_line(picture))
    events = [(event["receive_time_ns"], p.name, event) for p in pictures for event in p.events]
    events.sort(key=lambda entry: entry[0])
    return Group(table, *(_event(event, name) for _, name, event in events[-EVENTS_SHOWN:]))


def _line(picture: VesselPicture) -> list[RenderableType]:
    boat = picture.message("measured") or picture.message("shadow")
    off = _difference(picture.message("measured"), picture.message("shadow"))
    residual, health = picture.message("residual"), picture.message("health")
    cells: list[RenderableType] = [
        Text(picture.name, style="bold"),
        Text("●", style=GOOD) if picture.alive else Text("○", style=BAD),
    ]
    cells += ["·", "·"] if boat is None else _speed_and_heading(boat)
    cells.append("·" if off is None else _number(math.hypot(off["north_m"], off["east_m"]), 2))
    cells.append("·" if residual is None else _worst(residual))
    cells.append("·" if health is None else _number(health["link_age_s"], 1))
    cells.append(_number(picture.rate_hz, 0))
    cells.append("·" if health is None else _number(100 * health["loss"], 1))
    return cells


def _speed_and_heading(boat: Message) -> list[RenderableType]:
    knots = math.hypot(boat["surge_mps"], boat["sway_mps"]) / KNOT_MPS
    return [_number(knots, 2), _heading(boat["yaw_rad"])]


def _worst(residual: Message) -> Text:
    """The missing force furthest out of its own uncertainty, in standard deviations."""
    ratio = max(abs(residual[n]) / max(residual[f"{n}_std"], 1e-9) for n in FORCES)
    return Text(_number(ratio, 1), style=WARN if ratio > SIGNIFICANT else "")


def _degrees(value: float, letters: str) -> str:
    """Latitude or longitude with the letter of its half of the world."""
    return f"{_number(abs(value), 5)}° {letters[value < 0.0]}"


def _heading(yaw: float) -> str:
    """Radians -> 0 to 360 degrees; whatever others may send."""
    return f"{math.degrees(yaw) % 360.0:05.1f}" if math.isfinite(yaw) else "?"


def _number(value: float, digits: int) -> str:
    """Never wider than its column, never a minus before nothing."""
    if abs(value) >= 1e6:
        return f"{value:.0e}"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def _clock(time_ns: int) -> str:
    """Local time of day; a time that cannot be is not shown."""
    try:
        return f"{datetime.fromtimestamp(time_ns * 1e-9):%H:%M:%S}"
    except (ValueError, OverflowError, OSError):
        return "--:--:--"
