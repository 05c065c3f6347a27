"""An identification: fitted parameters, every doubt in words, and what is gained on unseen time.

A plan for one: its prediction, its bounds and its files; and the list of manoeuvres. The passport
of a vessel file: origins of its numbers, differences, history.
"""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from gateway.figures import DEGREES
from gateway.offline.plan import PlanResult, pulse_bounds
from gateway.offline.vessel import Passport, differences, outputs_that_differ
from gateway.terminal import ResultConsole, result_table
from gateway.toml_file import MAX_TOLD, shortened
from sim.excitation import Manoeuvre
from sim.excitation.responses import STEER, THROTTLE, StepResponse, StepResponses
from sim.identification.by_recording import ByRecording
from sim.identification.identify import Identification, Validation
from sim.prediction.free_runs import Scores
from sim.vessel import Vessel

CHANNELS = {  # of the scores, in SI units
    "u": "u m/s", "v": "v m/s", "r": "r rad/s", "x": "north m", "y": "east m", "psi": "ψ rad",
}  # fmt: skip


def show_identification(
    found: Identification, out: Path | None, pictures: Path | None = None
) -> None:
    """Parameters, doubts, validation, and where file and pictures went."""
    console = ResultConsole()
    console.notices(found.notices)
    console.print(_parameters(found))
    console.bullets(f"{e.name} {e.doubt}" for e in (*found.estimates, *found.nuisances) if e.doubt)
    console.bullets((*found.cross_check, *found.trade))
    if found.nuisances:
        fitted = ", ".join(f"{e.name} {e.value:.3g} {e.unit}" for e in found.nuisances)
        console.print(f"Fitted along: {fitted}")
    console.print(step_response_table(found.vessel, found.step_responses))
    if found.validation:
        console.print(_validation(found))
    console.notices((*found.too_light, *found.unseen_losses, *found.unconfirmed))
    console.path("written", out)
    console.path("pictures", pictures)


def show_by_recording(found: ByRecording, written: Sequence[Path]) -> None:
    """Numbers put together, what each recording weighs, which one disagrees."""
    console = ResultConsole()
    console.notices((*found.notices, *(one.text for one in found.disagreements)))
    name = escape(next(iter(found.vessels.values())).name)
    title = f"{name}, each of {len(found.fits)} recordings alone, put together"
    columns = ("parameter", "before", "value", "95 % interval", "scatter of voyages")
    table = result_table(title, *columns, unit=True)
    for one in found.numbers:
        label = one.name + (f" ({one.boat})" if one.boat else "")
        low, high = one.ci95
        table.add_row(
            escape(label), f"{one.before:.4g}", f"{one.value:.5g}", f"{low:.5g} … {high:.5g}",
            f"{one.scatter:.2g}", one.unit,
        )  # fmt: skip
    console.print(table)
    weights = Table("recording", "weight", title_justify="left")
    for fit, weight in zip(found.fits, found.weight, strict=True):
        weights.add_row(escape(fit.recording), f"{100.0 * weight:.0f} %" if weight else "left out")
    console.print(weights)
    for file in written:
        console.path("written", file)


def _parameters(found: Identification) -> Table:
    title = f"{escape(found.vessel.name)}, {found.method} over {found.seconds:.0f} s"
    table = result_table(title, "parameter", "before", "value", "95 % interval", unit=True)
    for e in found.estimates:
        name = e.name if e.trial is None else escape(f"{e.name} ({e.trial})")
        low, high = e.ci95
        mark = "" if e.identifiable else " ?"
        table.add_row(
            name, f"{e.before:.4g}", f"{e.value:.5g}{mark}", f"{low:.5g} … {high:.5g}", e.unit
        )
    return table


def step_response_table(vessel: Vessel, responses: StepResponses) -> Table:
    """How the vessel answers to a step of throttle and of the helm: times in s, overshoot in %."""
    table = Table("step", "from rest to", "rise 10–90 %", "settles to 5 %", "to 2 %", "overshoot")
    table.title = "how the vessel answers to a step, predicted"
    surge, yaw = responses
    table.add_row(f"throttle {THROTTLE:g}", f"{surge.after:.2f} m/s", *_times(surge))
    under_way = ", under way" if vessel.rudders else ""
    turn = f"{yaw.after * DEGREES:.1f} °/s"
    table.add_row(f"steer {STEER:g}{under_way}", turn, *_times(yaw))
    return table


def _times(one: StepResponse) -> tuple[str, ...]:
    if not one.settled:
        return ("does not come to rest", "–", "–", "–")
    times = (one.rise, one.settling_5, one.settling_2)
    return (*(f"{seconds:.1f} s" for seconds in times), f"{100 * one.overshoot:.0f} %")


def _validation(found: Identification) -> Table:
    table = Table(title="on time that the fit did not see", title_justify="left")
    table.add_column("recording", overflow="fold")
    for name in ("", "vessel", "RMSE", "MAE", "R²", "fit %"):
        table.add_column(name, justify="right", no_wrap=True)
    for v in found.validation:
        title = f"{escape(v.name)}, {v.seconds:.0f} s: nrmse {v.before.nrmse:.3f} before, "
        title += f"{v.after.nrmse:.3f} after, {v.noise_floor_nrmse:.3f} by noise alone"
        rows = _score_rows(v.before.scores, v.after.scores)
        for i, cells in enumerate(rows):
            table.add_row(title if i == 0 else "", *cells, end_section=i == len(rows) - 1)
        for i, cells in enumerate(_free_run_rows(v)):
            table.add_row("one free run" if i == 0 else "", *cells)
        table.add_section()
    return table


def _score_rows(before: Scores, after: Scores) -> list[tuple[str, ...]]:
    """Channel by channel, before and after; R² and fit where the channel moved at all."""
    return [
        (
            label if when == "before" else "", when, f"{s.rmse[c]:.3f}", f"{s.mae[c]:.3f}",
            *((f"{s.r2[c]:.3f}", f"{s.fit_percent[c]:.0f}") if c in s.r2 else ("", "")),
        )
        for c, label in CHANNELS.items()
        for when, s in (("before", before), ("after", after))
    ]  # fmt: skip


def _free_run_rows(v: Validation) -> list[tuple[str, ...]]:
    before, after = v.before.free_run, v.after.free_run
    if before is None or after is None:
        return []
    if len(after.error) == 0:
        return [("u m/s", "after", "diverged", "", "", "")]
    return _score_rows(before.scores, after.scores)


MOST = 5  # manoeuvres that are named
UNKNOWN = "wind and current that the vessel file does not hold come on top"


def show_manoeuvres(known: Sequence[Manoeuvre]) -> None:
    """One line each."""
    table = Table("excitation", "seconds", "what it tells of")
    for manoeuvre in known:
        table.add_row(manoeuvre.name, f"{manoeuvre.seconds:.0f}", manoeuvre.reveals)
    out = ResultConsole()
    out.print(table)
    out.print(
        "circles (also in mixed) take as long as the vessel needs. "
        "shadow plan --vessel V --excitation NAME writes one for a boat",
        highlight=False,
    )


def show_plan(done: PlanResult) -> None:
    """What will happen, whether it stays in the circle, what stops it, where the files are."""
    out, plan = ResultConsole(highlight=False), done.plan
    out.print(
        f"[bold]{plan.manoeuvre.name}[/bold] for {plan.vessel.name}: {plan.seconds:.0f} s, "
        f"throttle up to {100 * plan.limits.throttle:.0f} %"
    )
    if done.ranking is not None:
        out.print(f"chosen to tell {done.ranking.of}; per second, of most use:", markup=False)
        for one in done.ranking.ranked[:MOST]:
            out.print(f"  {one.manoeuvre.name}, {one.seconds:.0f} s: {one.nats:.0f} nats")
    out.print(f"tells of {plan.manoeuvre.reveals}", markup=False)
    out.print(_circle(done), markup=False)
    out.print(step_response_table(plan.vessel, done.step_responses))
    if done.unscripted:
        out.notices([done.unscripted])
    else:
        out.print(_what_stops_it(done), markup=False)
    for file in done.files:
        out.path("wrote", file)
    if not done.unscripted:
        out.print("how to run it aboard, safely: docs/plan.md")


def _what_stops_it(done: PlanResult) -> str:
    """The limits of the script."""
    pulses = (
        f"{low}–{high} µs on {channel}" for channel, (low, high) in pulse_bounds(done.plan).items()
    )
    volts = done.safety.lowest_voltage_v
    battery = "BATT_LOW_VOLT" if volts is None else f"{volts:g} V"
    return (
        f"the script stops, in Hold, beyond {done.safety.radius_m:g} m or "
        f"{done.safety.highest_speed_mps:g} m/s, below {battery}, outside {', '.join(pulses)}, "
        "and when you move a stick, the switch or the mode"
    )


def _circle(done: PlanResult) -> str:
    plan, radius = done.plan, done.safety.radius_m
    stops = "" if done.unscripted else ", where the script will stop"
    fast = f"predicted: at most {plan.speed.max():.1f} m/s, {plan.reach:.0f} m from the start"
    if not done.within_radius:
        return (
            f"WARNING: {fast}: it leaves the circle of {radius:g} m after {done.leaves_at:.0f} s"
            f"{stops}. --seconds {done.clear_until:.0f} keeps it in; or give "
            "more --radius, or another --excitation"
        )
    if done.close_to_edge:
        return (
            f"{fast}, within the circle of {radius:g} m but close to it: wind or current may carry "
            f"it out{stops}. --seconds {done.clear_until:.0f} keeps it clear"
        )
    if plan.limits.throttle < done.requested_throttle:
        return (
            f"{fast}, in the circle of {radius:g} m: for that the throttle limit "
            f"was lowered from {done.requested_throttle:g} to {plan.limits.throttle:.2f}; {UNKNOWN}"
        )
    return f"{fast}, in the circle of {radius:g} m; {UNKNOWN}"


def show_passport(read: Passport) -> None:
    """Every number with its interval and its origin."""
    console = ResultConsole()
    table = Table(title=f"{read.vessel.name}: {read.path}", title_justify="left")
    for name in ("number", "value", "95 % interval", "unit"):
        table.add_column(name, no_wrap=True, justify="left" if name == "number" else "right")
    table.add_column("from", overflow="fold")
    for one in read.numbers:
        ci95 = one.origin.ci95 if one.origin else None
        interval = "" if ci95 is None else f"{ci95[0]:.4g} … {ci95[1]:.4g}"
        source = escape(one.source)
        table.add_row(escape(one.name), f"{one.value:.5g}", interval, one.unit, source)
    console.print(table)
    if read.vessel.source:
        console.print(f"source: {read.vessel.source}", markup=False, highlight=False)
    console.notices(read.vessel.assumptions)


def show_difference(first: Passport, second: Passport) -> None:
    """The numbers and the wiring that differ."""
    console, found = ResultConsole(), differences(first, second)
    table = result_table("what differs", "number", "first", "second", "change", "intervals",
                         unit=True)  # fmt: skip
    words = {None: "not stated", True: "beyond", False: "within"}
    for one in found:
        change = "" if one.share is None else f"{100.0 * one.share:+.1f} %"
        ends = ("–" if value is None else f"{value:.5g}" for value in (one.first, one.second))
        table.add_row(one.name, *ends, change, words[one.beyond], one.unit)
    if found:
        console.print(table)
    wiring = outputs_that_differ(first.vessel, second.vessel)
    console.bullets(wiring)
    if not found and not wiring:
        console.bullets(["the two are the same vessel"])


def show_history(read: Passport) -> None:
    """One line a revision, with what it changed."""
    console = ResultConsole()
    for one in read.tables.history:
        changed = ", ".join(
            f"{name} {one.before[name]:.4g} → {now:.4g}"
            if name in one.before
            else f"{name} {now:.4g}"
            for name, now in one.now.items()
        )
        console.bullets(
            [f"{one.date}, {one.by} on {shortened(one.recording, MAX_TOLD)}: {changed}"]
        )
    if not read.tables.history:
        console.bullets(["no history: no command of this program has changed its numbers"])
