"""A recording: what `shadow info` finds in it, and the vessel file that `shadow init` makes.

Runs: what a replay or a simulation did, which plants there are, and where a report is.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from gateway.errors import counted, one_line, shell_path
from gateway.figures import POSE, VELOCITIES, YAW_RATE
from gateway.ingest.log_events import LogEvent
from gateway.ingest.survey import BoatSurvey, Survey
from gateway.terminal import ResultConsole
from gateway.vessel_tables import RudderTable, ThrusterTable, VesselFile

if TYPE_CHECKING:  # `shadow info` needs none of them
    from gateway.offline.export import Exported
    from gateway.offline.replay_summary import ReplaySummary, Warned
    from gateway.offline.report import ReportFile
    from gateway.offline.simulate import SimulationResult


def show_survey(found: Survey) -> None:
    """The recording, its boats, its messages."""
    out, s = ResultConsole(), found.statistics
    out.print(
        f"[bold]{escape(str(found.path))}[/bold]: {found.kind}, {s.size_bytes / 1e6:.2f} MB, "
        f"{found.seconds:.0f} s, {s.accepted} messages"
    )
    odd = {
        "bad checksum": s.bad_checksum, "junk bytes": s.junk_bytes, "signed": s.signed,
        "unknown messages": s.unknown_messages, "lost": s.lost, "duplicates": s.duplicates,
        "clock steps back": s.time_backwards, "cut at the end": int(s.truncated_tail),
    }  # fmt: skip
    counted = ", ".join(f"{name} {count}" for name, count in odd.items() if count)
    nothing = "nothing but what the notes say" if s.notes else "nothing"
    out.print(f"odd: {counted or nothing}")
    if s.mavlink1 or s.mavlink2:
        out.print(f"MAVLink 1: {s.mavlink1}, MAVLink 2: {s.mavlink2}")
    for note in s.notes:
        out.print(f"note: {note}", markup=False)
    for boat in found.boats:
        _show_boat(out, boat)
    if not found.boats:
        out.print("no boat in it: nobody but ground stations spoke, or nobody said what it is")
    _show_messages(out, found)


def show_next(following: str) -> None:
    """What comes next; a command goes on in one line, however long, so that it can be pasted."""
    ResultConsole().print(f"next: {following}", highlight=False, markup=False, soft_wrap=True)


def _show_boat(out: ResultConsole, one: BoatSurvey) -> None:
    clock = one.clock
    lost = f", {clock.unplaced} without a time that can be" if clock.unplaced else ""
    out.print(f"\n[bold]{one.boat}[/bold] {escape(one_line(one.firmware))}: {one.seconds:.0f} s")
    out.print(
        f"clock: {clock.sessions} boot sessions, {clock.reboots} reboots, {clock.wraps} wraps, "
        f"{clock.late} late, {clock.duplicates} duplicates, {clock.receive_steps} steps of the "
        f"receiver's clock, delays spread over {clock.spread_s * 1000:.0f} ms{lost}"
    )
    table = Table("quantity", "source", "rate", "longest gap", "why", title="sources chosen")
    for quantity, choice in one.sources.items():
        gap = "" if math.isinf(choice.longest_gap_s) else f"{choice.longest_gap_s:.1f} s"
        table.add_row(quantity, escape(choice.source), f"{choice.rate_hz:.1f} Hz", gap, choice.why)
    out.print(table)
    for actuator in one.actuators:
        low, neutral, high = actuator.pwm
        turned = ", reversed" if actuator.reversed else ""
        out.print(
            f"servo {actuator.channel}: {actuator.kind.value}, "
            f"{low:.0f} – {neutral:.0f} – {high:.0f} µs{turned}"
        )
    if one.named_outputs:
        out.print(f"by PX4's parameters: {', '.join(one.named_outputs)}", markup=False)
    out.notices(one.notices)
    out.bullets(one.good_for)


def _show_messages(out: ResultConsole, found: Survey) -> None:
    table = Table("message", "count", "rate", "longest gap", title="messages")
    for name, message in found.messages.items():
        table.add_row(
            name, str(message.count), f"{message.rate_hz:.1f} Hz", f"{message.longest_gap_s:.1f} s"
        )
    out.print(table)


def show_events(boat: str, events: Sequence[LogEvent]) -> None:
    """What happened to a boat, a line each; none is cut off."""
    out = ResultConsole()
    many = counted(len(events), "event")
    out.print(f"\n[bold]{escape(boat)}[/bold]: {many}, seconds since the log began")
    for one in events:
        who = "" if one.by == "autopilot" else f"{one.by}: "
        level = "" if one.severity in ("", "info", "notice", "debug") else f"{one.severity}: "
        line = f"{one.time_s:9.1f}  {who}{level}{one_line(one.text)}"
        out.print(line, highlight=False, markup=False)


def show_initial_vessel(
    made: VesselFile, out: Path, following: str, notices: Sequence[str] = ()
) -> None:
    """Actuators found, numbers assumed, what looks odd in the log, what to do next."""
    console = ResultConsole()
    table = Table("actuator", "channel", "pwm [µs]", title=f"{made.name}: outputs that move it")
    parts: list[ThrusterTable | RudderTable] = [*made.thrusters, *made.rudders]
    for part in parts:
        pulses = " – ".join(f"{p:.0f}" for p in part.pwm)
        table.add_row(part.name, str(part.channel), pulses + (" reversed" * part.reversed))
    console.print(table)
    origins: dict[str, list[str]] = {}
    for key, origin in made.provenance.items():
        origins.setdefault(origin.says, []).append(key)
    for text, keys in origins.items():
        console.print(f"{text}: {', '.join(keys)}", highlight=False)
    console.path("written", out)
    console.notices(notices)
    show_next(following)


CHANNELS = ("x", "y", "psi", "u", "v", "r")
MOST_WARNINGS = 8  # that are printed


def show_replay(summary: "ReplaySummary") -> None:
    """A short table, and where the recording is."""
    out = ResultConsole()
    rate = summary.seconds / max(summary.wall_seconds, 1e-9)
    out.print(
        f"[bold]{escape(summary.log)}[/bold]: {summary.boat}, {summary.seconds:.0f} s in "
        f"{summary.wall_seconds:.1f} s ({rate:.0f} × real time), {summary.rows} rows, "
        f"{counted(summary.events, 'event')}"
    )
    table = Table("", *CHANNELS, title="shadow − boat while telemetry was fresh, RMSE")
    errors = zip(summary.rmse, (*POSE, *VELOCITIES), strict=True)
    table.add_row("", *(f"{value * axis.factor:.3g} {axis.unit}" for value, axis in errors))
    out.print(table)
    if summary.missing is None:
        out.print("missing force: not judged, at hardly any moment could these data do that")
    else:
        X, Y, N = summary.missing
        out.print(
            f"missing force, root mean square: {X:.3g} N ahead, {Y:.3g} N to starboard, "
            f"{N:.3g} N m: what the vessel would need on top of its thrusters to move as measured"
        )
    for note in summary.notes:
        out.print(f"note: {note}", highlight=False, markup=False)
    warnings = list(dict.fromkeys(summary.warnings))
    for warned in _told_first(warnings):
        mark = "" if warned.over else "! "
        out.print(f"{mark}{warned.says}", highlight=False, markup=False)
    for path in summary.recordings:
        out.path("recorded", path)
    more = len(warnings) - MOST_WARNINGS
    if summary.recordings and more > 0:
        file = shell_path(summary.recordings[0])
        others = counted(more, "more warning")
        out.print(f"{others}: shadow info --events {file}", markup=False)


def _told_first(warnings: "Sequence[Warned]") -> "list[Warned]":
    """Those that are printed: of many the first ones, and how it ended with the model."""
    if len(warnings) <= MOST_WARNINGS:
        return list(warnings)
    first, later = warnings[: MOST_WARNINGS - 1], warnings[MOST_WARNINGS - 1 :]
    return [*first, next((one for one in reversed(later) if one.judges), later[0])]


def show_export(done: "Exported") -> None:
    """How much was written, and where."""
    out = ResultConsole()
    many = counted(done.count, done.unit.removesuffix("s"))
    out.print(f"[bold]{escape(done.log)}[/bold]: {many}")
    if done.columns:
        out.print(f"columns: {', '.join(done.columns)}", highlight=False, markup=False)
    for note in done.notes:
        out.print(f"note: {note}", highlight=False, markup=False)
    for file, label in zip(done.files, ("written", "mapping"), strict=False):
        out.path(label, file)


def show_plants(known: Sequence[Mapping[str, str]]) -> None:
    """One line per kind: name and description."""
    table = Table("plant", "what it is")
    for kind in known:
        table.add_row(kind["name"], escape(kind["description"]))
    out = ResultConsole()
    out.print(table)
    out.print(
        "--plant KIND makes one from the boat's own vessel, KIND:FILE from another vessel file; "
        "FILE alone is vessel:FILE",
        highlight=False,
    )


def show_simulation(result: "SimulationResult") -> None:
    """How far it went, how well the follower followed, where the recording is."""
    out = ResultConsole()
    last = result.motion[-1]
    out.notices(result.notices)
    out.print(
        f"{result.time[-1]:.0f} s simulated; at the end {last[0]:.1f} m north, {last[1]:.1f} m "
        f"east, {last[3]:.2f} m/s ahead"
    )
    off = result.follower_rmse
    if off is not None:
        out.print(
            f"follower − vessel, RMSE: {off[0]:.4f} m/s, {off[1]:.4f} m/s, "
            f"{off[2] * YAW_RATE.factor:.3f} °/s"
        )
    out.path("recorded", result.recording)


def show_report(done: "ReportFile") -> None:
    """What it says, and where it is."""
    out = ResultConsole(highlight=False)
    out.print(done.headline, markup=False)
    out.print(f"report: {done.path} ({done.size_bytes / 1e6:.1f} MB)", soft_wrap=True, markup=False)
    if done.pdf is not None:
        out.print(f"printed: {done.pdf}", soft_wrap=True, markup=False)
