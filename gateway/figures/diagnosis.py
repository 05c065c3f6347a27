"""The ladder as far as it has been climbed: the error on unseen time after each step.

Pictures of a diagnosis: the ladder, the ranking, and the evidence for each effect.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gateway.figures.error_against import DEGREES
from gateway.figures.figure_data import Axis, Bars, Dots, FigureData, Level, Line, Mark, Panel, Role
from gateway.figures.vessels import NRMSE
from sim.diagnosis.answer import Diagnosis, LadderStep
from sim.diagnosis.evidence import Evidence, evidence
from sim.identification.vessel_update import applied
from sim.trial import Trial
from sim.vessel import Vessel

ERROR = Axis("error on unseen time, nrmse (0 is perfect)")


@dataclass(frozen=True)
class Step:
    """One step: what was done, the error after it, and its 95 % interval where there is one."""

    name: str
    error: float
    ci95: tuple[float, float] | None


def steps(title: str, climbed: Sequence[Step], floor: float) -> FigureData:
    """One bar per step and the noise floor as a line."""
    x = np.arange(len(climbed), dtype=float)
    height = np.array([step.error for step in climbed])
    interval = np.array([step.ci95 or (step.error, step.error) for step in climbed])
    marks: tuple[Mark, ...] = (
        Bars(x - 0.3, x + 0.3, height, Role.MODEL, "error of the model"),
        Dots(x, height, interval[:, 0], interval[:, 1], Role.INTERVAL, "95 % interval"),
        Level(floor, Role.FLOOR, "noise floor: a perfect model would show this"),
    )
    names = tuple(step.name for step in climbed)
    return FigureData(title, (Panel(Axis("step"), ERROR, marks, names=names),))


def name_of(effects: Sequence[str], base: str) -> str:
    """What was done on a rung, in words."""
    if effects:
        return f"+ {effects[-1].replace('_', ' ')}"
    return "as given" if base == "plain" else "base re-fitted"


FLOOR = "noise floor: what a perfect model would show"
UNLIKELY = 0.001
FORCES = (
    Axis("missing surge X", "N"), Axis("missing sway Y", "N"), Axis("missing yaw N", "N m"),
    Axis("missing force along it", "N"),
)  # fmt: skip
SHOWN = {  # what an effect depends on -> axis, and how much of its unit makes one SI unit
    "heading": (Axis("heading", "°"), DEGREES),
    "surge": (Axis("surge u", "m/s"), 1.0),
    "sway": (Axis("sway v", "m/s"), 1.0),
    "turn_rate": (Axis("turn rate r", "°/s"), DEGREES),
    "acceleration": (Axis("surge acceleration", "m/s²"), 1.0),
    "throttle": (Axis("mean throttle", "%"), 100.0),
    "astern": (Axis("hardest reverse", "%"), 100.0),
    "helm": (Axis("helm", "%"), 100.0),
    "throttle_change": (Axis("change of mean throttle", "%/s"), 100.0),
    "helm_change": (Axis("change of helm", "%/s"), 100.0),
    "voltage": (Axis("battery", "V"), 1.0),
    "time": (Axis("time in the recording", "s"), 1.0),
    "phase": (Axis("phase of the wave", "°"), DEGREES),
}


def album(diagnosis: Diagnosis, trials: Sequence[Trial]) -> dict[str, FigureData]:
    """Name of a picture -> what it shows."""
    pictures = {"ladder": ladder(diagnosis)}
    if diagnosis.ranking:
        pictures["ranking"] = ranking(diagnosis)
    for found in (*evidence_of(diagnosis, trials), *evidence_of_rivals(diagnosis, trials)):
        pictures[f"evidence {found.effect}"] = against(found)
    return pictures


def ladder(diagnosis: Diagnosis) -> FigureData:
    """The error on unseen time after each step, with its interval and the noise floor."""
    rungs = diagnosis.ladder
    x = np.arange(len(rungs), dtype=float)
    error = np.array([rung.heldout.nrmse for rung in rungs])
    low, high = np.array([rung.heldout.ci95 or (rung.heldout.nrmse,) * 2 for rung in rungs]).T
    marks: tuple[Mark, ...] = (
        Line(x, error, Role.CONTEXT),
        Dots(x, error, low, high, Role.MODEL, "error on unseen time, 95 % interval"),
        Level(diagnosis.floor, Role.FLOOR, FLOOR),
        Level(0.0, Role.CONTEXT),
    )
    panel = Panel(Axis("step"), NRMSE, marks, names=tuple(map(_step, rungs)))
    return FigureData(f"{diagnosis.vessel.name}: step by step", (panel,), says=diagnosis.summary)


def _step(rung: LadderStep) -> str:
    if rung.base == "plain":
        return "as given"
    return f"+ {rung.effects[-1]}" if rung.effects else "base\nre-fitted"


def ranking(diagnosis: Diagnosis) -> FigureData:
    """Each effect alone beside the re-fitted base: its error, and below how probable it is."""
    rows = diagnosis.ranking
    x = np.arange(len(rows), dtype=float)
    error = np.array([row.heldout_nrmse for row in rows])
    marks: tuple[Mark, ...] = (
        Bars(x - 0.3, x + 0.3, error, Role.MODEL, "error with this effect alone"),
        Level(diagnosis.ladder[1].heldout.nrmse, Role.ERROR, "without any"),
        Level(diagnosis.floor, Role.FLOOR, FLOOR),
    )
    names = tuple(
        row.effect.replace("_", "\n") + f"\n{100.0 * row.probability:.3g} %"
        if row.probability >= UNLIKELY
        else row.effect.replace("_", "\n") + f"\n< {100.0 * UNLIKELY:g} %"
        for row in rows
    )
    panel = Panel(Axis("effect, and how probable it is"), NRMSE, marks, names=names)
    return FigureData(f"{diagnosis.vessel.name}: which effect", (panel,))


def evidence_of(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For each effect that was found, from the best vessel with the numbers of each recording."""
    best = diagnosis.ladder[-1]
    found = [evidence_on(best, name, trials) for name in best.effects]
    return [one for one in found if one is not None]


def evidence_of_rivals(diagnosis: Diagnosis, trials: Sequence[Trial]) -> list[Evidence]:
    """For what these data cannot tell from the effects found, with its own fitted numbers."""
    found = [evidence_on(rung, rung.effects[-1], trials) for rung in rivals(diagnosis)]
    return [one for one in found if one is not None]


def rivals(diagnosis: Diagnosis) -> list[LadderStep]:
    """The alternatives that do as well as what was chosen, each effect once."""
    tied = {row.effect for row in diagnosis.ranking if row.confounded_with}
    out = {
        rung.effects[-1]: rung for rung in diagnosis.alternatives
        if len(rung.effects) > 1 or rung.effects[-1] in tied
    }  # fmt: skip
    return [rung for effect, rung in out.items() if effect not in diagnosis.effects]


def evidence_on(rung: LadderStep, effect: str, trials: Sequence[Trial]) -> Evidence | None:
    """For one effect of a rung's vessel; None where there is too little time to show it."""
    vessels = [_on(rung, trial, trials[0]) for trial in trials]
    added = next(a.effect for a in rung.vessel.effects if a.effect.name == effect)
    return evidence(trials, vessels, added)


def _on(rung: LadderStep, trial: Trial, first: Trial) -> Vessel:
    """The vessel of a rung with what each recording has for itself."""
    if trial is first:
        return rung.vessel
    own = {
        e.name: e.value for numbers in rung.parameters.values() for e in numbers
        if e.trial == trial.name
    }  # fmt: skip
    return applied(rung.vessel, own)


def against(found: Evidence) -> FigureData:
    """Missing force without the effect, and the effect's own curve through it."""
    axis, factor = SHOWN[found.by]
    middle = found.at * factor
    points = Dots(middle, found.mean, found.low, found.high, Role.MEASURED,
                  "missing without it (mean, 2 standard errors)")  # fmt: skip
    curve = Line(middle, found.curve, Role.MODEL, f"what {found.effect} supplies")
    panel = Panel(axis, FORCES[found.axis], (Level(0.0, Role.CONTEXT), curve, points))
    share = explained(found)
    says = f"it supplies {100.0 * share:.0f} % of what is missing here" if share > 0.0 else ""
    return FigureData(f"Evidence for {found.effect}", (panel,), says=says)


def explained(found: Evidence) -> float:
    """Share of the variation of the points about zero that the curve takes away."""
    total = float(np.sum(found.mean**2))
    left = float(np.sum((found.mean - found.curve) ** 2))
    return max(1.0 - left / total, 0.0) if total > 0.0 else 0.0
