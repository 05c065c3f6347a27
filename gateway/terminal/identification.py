"""An identification: fitted parameters, every doubt in words, and what is gained on unseen time."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from gateway.figures.quantities import DEGREES
from gateway.terminal.console import ResultConsole, result_table
from sim.excitation.step_response import STEER, THROTTLE, StepResponse, StepResponses
from sim.identification.identify import Identification
from sim.identification.validation import Validation
from sim.prediction.scores import Scores
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
    console.notices(found.unconfirmed)
    console.path("written", out)
    console.path("pictures", pictures)


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
