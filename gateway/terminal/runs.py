"""Runs: what a replay or a simulation did, which plants there are, and where a report is."""

from collections.abc import Mapping, Sequence

from rich.markup import escape
from rich.table import Table

from gateway.figures.quantities import POSE, VELOCITIES, YAW_RATE
from gateway.offline.replay_outputs import ReplaySummary
from gateway.offline.report import ReportFile
from gateway.offline.simulate import SimulationResult
from gateway.terminal.console import ResultConsole

CHANNELS = ("x", "y", "psi", "u", "v", "r")


def show_replay(summary: ReplaySummary) -> None:
    """A short table, and where the recording is."""
    out = ResultConsole()
    rate = summary.seconds / max(summary.wall_seconds, 1e-9)
    out.print(
        f"[bold]{escape(summary.log)}[/bold]: {summary.boat}, {summary.seconds:.0f} s in "
        f"{summary.wall_seconds:.1f} s ({rate:.0f} × real time), {summary.rows} rows, "
        f"{summary.events} events"
    )
    table = Table("", *CHANNELS, title="shadow − boat while telemetry was fresh, RMSE")
    errors = zip(summary.rmse, (*POSE, *VELOCITIES), strict=True)
    table.add_row("", *(f"{value * axis.factor:.3g} {axis.unit}" for value, axis in errors))
    out.print(table)
    X, Y, N = summary.missing
    out.print(
        f"missing force, root mean square: {X:.3g} N ahead, {Y:.3g} N to starboard, {N:.3g} N m: "
        "what the vessel would need on top of its thrusters to move as measured"
    )
    for note in summary.notes:
        out.print(f"note: {note}", highlight=False, markup=False)
    for path in summary.recordings:
        out.path("recorded", path)


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


def show_simulation(result: SimulationResult) -> None:
    """How far it went, how well the follower followed, where the recording is."""
    out = ResultConsole()
    last = result.motion[-1]
    out.print(
        f"{result.time[-1]:.0f} s simulated; at the end {last[0]:.1f} m north, {last[1]:.1f} m "
        f"east, {last[3]:.2f} m/s ahead"
    )
    if result.follower is not None:
        off = ((result.follower - result.motion)[:, 3:6] ** 2).mean(axis=0) ** 0.5
        out.print(
            f"follower − vessel, RMSE: {off[0]:.4f} m/s, {off[1]:.4f} m/s, "
            f"{off[2] * YAW_RATE.factor:.3f} °/s"
        )
    out.path("recorded", result.recording)


def show_report(done: ReportFile) -> None:
    """Two lines."""
    out = ResultConsole(highlight=False)
    out.print(done.headline, markup=False)
    out.print(f"report: {done.path} ({done.size_bytes / 1e6:.1f} MB)", soft_wrap=True, markup=False)
