"""How a vessel answers to a step of throttle and of the helm, as a table.

Fitted parameters as a table, every doubt in words, and what is gained on unseen time.

How far models are from the measurement: a table, and the worst regimes in words.

A plan, its prediction and its bounds; the list of manoeuvres.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.offline.plan import Planned
from gateway.offline.plan_export import pulse_bounds
from sim.comparison.compare import Comparison
from sim.excitation.manoeuvre import Manoeuvre
from sim.excitation.step_response import STEER, THROTTLE, Response, StepResponses
from sim.identification.identify import Identified
from sim.identification.intervals import Estimate
from sim.identification.validation import Validation
from sim.prediction.scores import Scores
from sim.vessel import Vessel


def responses_table(vessel: Vessel, answers: StepResponses) -> Table:
    """Rise and settling times in seconds, overshoot in percent."""
    table = Table("step", "from rest to", "rise 10–90 %", "settles to 5 %", "to 2 %", "overshoot")
    table.title = "how the vessel answers to a step, predicted"
    surge, yaw = answers
    table.add_row(f"throttle {THROTTLE:g}", f"{surge.after:.2f} m/s", *_times(surge))
    under_way = ", under way" if vessel.rudders else ""
    table.add_row(f"steer {STEER:g}{under_way}", f"{math.degrees(yaw.after):.1f} °/s", *_times(yaw))
    return table


def _times(one: Response) -> tuple[str, ...]:
    if not one.settled:
        return ("does not come to rest", "–", "–", "–")
    times = (one.rise, one.settling_5, one.settling_2)
    return (*(f"{seconds:.1f} s" for seconds in times), f"{100 * one.overshoot:.0f} %")


UNITS = {"u": "u m/s", "v": "v m/s", "r": "r rad/s", "x": "north m", "y": "east m", "psi": "ψ rad"}


def show_identified(found: Identified, out: Path | None, pictures: Path | None = None) -> None:
    """Parameters, doubts, validation, and where file and pictures went."""
    console = Console()
    for says in found.notices:
        console.print(f"[bold]![/bold] {escape(says)}", highlight=False)
    console.print(_parameters(found))
    for e in (*found.estimates, *found.nuisances):
        if e.doubt:
            console.print(f"• {e.name} {e.doubt}", highlight=False, markup=False)
    for says in (*found.cross_check, *found.trade):
        console.print(f"• {says}", highlight=False, markup=False)
    if found.nuisances:
        console.print(f"Fitted along: {', '.join(_short(e) for e in found.nuisances)}")
    console.print(responses_table(found.vessel, found.answers))
    if found.validation:
        console.print(_validation(found))
    for says in found.untold:
        console.print(f"[bold]![/bold] {escape(says)}", highlight=False)
    if out is not None:
        console.print(f"written: {out}", soft_wrap=True, markup=False)
    if pictures is not None:
        console.print(f"pictures: {pictures}", soft_wrap=True, markup=False)


def _parameters(found: Identified) -> Table:
    title = f"{escape(found.vessel.name)}, {found.method} over {found.seconds:.0f} s"
    table = Table(title=title, title_justify="left")
    table.add_column("parameter", no_wrap=True)
    for name in ("before", "value", "95 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for e in found.estimates:
        name = e.name if e.trial is None else escape(f"{e.name} ({e.trial})")
        low, high = e.ci95
        mark = "" if e.identifiable else " ?"
        table.add_row(
            name, f"{e.before:.4g}", f"{e.value:.5g}{mark}", f"{low:.5g} … {high:.5g}", e.unit
        )
    return table


def _validation(found: Identified) -> Table:
    table = Table(title="on time that the fit did not see", title_justify="left")
    table.add_column("recording", overflow="fold")
    for name in ("", "vessel", "RMSE", "MAE", "R²", "fit %"):
        table.add_column(name, justify="right", no_wrap=True)
    for v in found.validation:
        floor = f"{escape(v.name)}, {v.seconds:.0f} s: nrmse {v.before.nrmse:.3f} before, "
        floor += f"{v.after.nrmse:.3f} after, {v.noise_floor_nrmse:.3f} by noise alone"
        rows = _rows(v.before.scores, v.after.scores)
        for i, cells in enumerate(rows):
            table.add_row(floor if i == 0 else "", *cells, end_section=i == len(rows) - 1)
        for cells in _free_rows(v):
            table.add_row("one free run" if cells[0] == "u m/s" else "", *cells)
        table.add_section()
    return table


def _rows(before: Scores, after: Scores) -> list[tuple[str, ...]]:
    """Channel by channel, before and after."""
    return [
        (UNITS[c] if when == "before" else "", when, *_cells(s, c))
        for c in UNITS
        for when, s in (("before", before), ("after", after))
    ]


def _free_rows(v: Validation) -> list[tuple[str, ...]]:
    runs = v.before.free_run, v.after.free_run
    if runs[0] is None or runs[1] is None:
        return []
    if len(runs[1].error) == 0:
        return [("u m/s", "after", "diverged", "", "", "")]
    return _rows(runs[0].scores, runs[1].scores)


def _cells(s: Scores, channel: str) -> tuple[str, ...]:
    moved = channel in s.r2
    return (
        f"{s.rmse[channel]:.3f}", f"{s.mae[channel]:.3f}",
        f"{s.r2[channel]:.3f}" if moved else "", f"{s.fit_percent[channel]:.0f}" if moved else "",
    )  # fmt: skip


def _short(e: Estimate) -> str:
    return f"{e.name} {e.value:.3g} {e.unit}"


WORST = 5  # regimes told


def show_comparisons(found: Sequence[Comparison], pictures: Path | None) -> None:
    """All comparisons: errors beside the floor, then where the last vessel of a trial is worst."""
    out = Console()
    out.print(_table(found))
    out.print(
        "nrmse: error of free predictions over the horizon, in standard deviations of the motion; "
        "at the floor it is noise. A free run starts once and is never corrected."
    )
    for says in _refits(found):
        out.print(f"• {says}", highlight=False, markup=False)
    for notice in dict.fromkeys(n for comparison in found for n in comparison.notices):
        out.print(f"[bold]![/bold] {escape(notice)}", highlight=False)
    for comparison in found:
        worst = comparison.worst(WORST)
        says = "where it is worst" if worst else "no worse anywhere than noise"
        out.print(f"\n[bold]{escape(comparison.vessel)}[/bold] on {escape(comparison.log)}: {says}")
        for one in worst:
            out.print(f"• {one.sentence}", highlight=False, markup=False)
        for says in _besides(comparison):
            out.print(f"• {says}", highlight=False, markup=False)
    if pictures is not None:
        out.print(f"\npictures: {pictures}", soft_wrap=True, markup=False)


def _refits(found: Sequence[Comparison]) -> list[str]:
    """What was estimated anew on the day, either half of the blocks from the other."""
    return [
        f"{c.vessel} on {c.log}, estimated anew on blocks that it is not judged by: "
        + ", ".join(f"{key} {a:.3g} / {b:.3g}" for (key, a), b in zip(
            c.refit[0].items(), c.refit[1].values(), strict=True))
        for c in found if c.refit
    ]  # fmt: skip


def _besides(comparison: Comparison) -> list[str]:
    """The worst place on the map, and which commands the errors follow; in words."""
    place, follows = comparison.place, comparison.independence
    out = [str(place.to_dict()["says"])] if place is not None else []
    return [*out, follows.description] if follows is not None and follows.description else out


def _table(found: Sequence[Comparison]) -> Table:
    table = Table(title="measured − model, RMSE", title_justify="left")
    for name in ("recording", "vessel", "run"):
        table.add_column(name, overflow="fold")
    for name in ("u m/s", "v m/s", "r °/s", "nrmse", "floor"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in found:
        interval = "" if c.nrmse_ci95 is None else f" {c.nrmse_ci95[0]:.2f}–{c.nrmse_ci95[1]:.2f}"
        table.add_row(
            escape(f"{c.log}, {c.seconds:.0f} s"), escape(c.vessel),
            f"{c.ruler.settings.horizon:g} s", *_errors(c.scores.rmse), f"{c.nrmse:.3f}{interval}",
            f"{c.noise_floor_nrmse:.3f}",
        )  # fmt: skip
        table.add_row("", "", "free", *_free_run(c), end_section=True)
    return table


def _errors(rmse: Mapping[str, float]) -> tuple[str, str, str]:
    return f"{rmse['u']:.3f}", f"{rmse['v']:.3f}", f"{math.degrees(rmse['r']):.2f}"


def _free_run(c: Comparison) -> tuple[str, ...]:
    rmse = c.free_run.to_dict().get("rmse", {})
    return _errors(rmse) if "u" in rmse else ("diverged", "", "")


MOST = 5  # manoeuvres that are named
UNKNOWN = "wind and current that the vessel file does not hold come on top"


def show_manoeuvres(known: Sequence[Manoeuvre]) -> None:
    """One line each."""
    table = Table("excitation", "seconds", "what it tells of")
    for manoeuvre in known:
        table.add_row(manoeuvre.name, f"{manoeuvre.seconds:.0f}", manoeuvre.tells)
    Console().print(table)
    Console().print(
        "circles (also in mixed) take as long as the vessel needs. "
        "shadow plan --vessel V --excitation NAME writes one for a boat",
        highlight=False,
    )


def show_planned(done: Planned) -> None:
    """What will happen, whether it stays in the circle, what stops it, where the files are."""
    out, plan = Console(highlight=False), done.plan
    out.print(
        f"[bold]{plan.manoeuvre.name}[/bold] for {plan.vessel.name}: {plan.seconds:.0f} s, "
        f"throttle up to {100 * plan.limits.throttle:.0f} %"
    )
    if done.asked is not None:
        out.print(f"chosen to tell {done.asked.of}; per second, of most use:", markup=False)
        for one in done.asked.ranked[:MOST]:
            out.print(f"  {one.manoeuvre.name}, {one.seconds:.0f} s: {one.nats:.0f} nats")
    out.print(f"tells of {plan.manoeuvre.tells}", markup=False)
    out.print(_circle(done), markup=False)
    out.print(responses_table(plan.vessel, done.answers))
    pulses = (
        f"{low}–{high} µs on {channel}" for channel, (low, high) in pulse_bounds(plan).items()
    )
    out.print(
        f"the script stops, in Hold, beyond {done.safety.radius_m:g} m or "
        f"{done.safety.highest_speed_mps:g} m/s, {_battery(done)}, outside {', '.join(pulses)}, "
        "and when you move a stick, the switch or the mode",
        markup=False,
    )
    for file in done.files:
        out.print(f"wrote: {file}", soft_wrap=True, markup=False)
    out.print("how to run it aboard, safely: docs/plan.md")


def _circle(done: Planned) -> str:
    plan, radius = done.plan, done.safety.radius_m
    fast = f"predicted: at most {plan.speed.max():.1f} m/s, {plan.reach:.0f} m from the start"
    if not done.stays:
        return (
            f"WARNING: {fast}: it leaves the circle of {radius:g} m after {done.leaves_at:.0f} s, "
            f"where the script will stop. --seconds {done.near_until:.0f} keeps it in; or give "
            "more --radius, or another --excitation"
        )
    if done.narrow:
        return (
            f"{fast}, within the circle of {radius:g} m but close to it: wind or current may carry "
            f"it out, where the script will stop. --seconds {done.near_until:.0f} keeps it clear"
        )
    if plan.limits.throttle < done.asked_throttle:
        return (
            f"{fast}, in the circle of {radius:g} m: for that the throttle limit "
            f"was lowered from {done.asked_throttle:g} to {plan.limits.throttle:.2f}; {UNKNOWN}"
        )
    return f"{fast}, in the circle of {radius:g} m; {UNKNOWN}"


def _battery(done: Planned) -> str:
    volts = done.safety.lowest_voltage_v
    return "below BATT_LOW_VOLT" if volts is None else f"below {volts:g} V"
