"""Figures of a diagnosis: the ladder, the ranking, and the evidence for each effect."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gateway.figures.comparison import bars_with_intervals
from gateway.figures.figure_data import Axis, Bars, Dots, FigureData, Level, Line, Panel, SeriesRole
from gateway.figures.style import DEGREES, EVIDENCE, MISSING_FORCES, NRMSE, SMALLEST_PROBABILITY
from sim.diagnosis.answer import Diagnosis, LadderStep
from sim.diagnosis.evidence import Evidence, evidence_of, evidence_of_rivals
from sim.trial import Trial

UNSEEN_ERROR = Axis("error on unseen time, nrmse (0 is perfect)")
FLOOR = "noise floor: what a perfect model would show"
FORCES = (*MISSING_FORCES, Axis("missing force along it", "N"))


def step_name(step: LadderStep) -> str:
    """What was done in a step of the ladder, in words."""
    if step.effects:
        return f"+ {' + '.join(step.effects[-step.new :])}"
    return {"plain": "as given", "kept": "base kept"}.get(step.base, "base re-fitted")


@dataclass(frozen=True)
class LadderBar:
    """A step of the ladder: its name, the error after it, and its 95 % interval if there is one."""

    name: str
    error: float
    ci95: tuple[float, float] | None

    @classmethod
    def of(cls, step: LadderStep) -> "LadderBar":
        """The bar of a step of a diagnosis."""
        return cls(step_name(step).replace("_", " "), step.heldout.nrmse, step.heldout.ci95)


def ladder_bars(bars: Sequence[LadderBar], floor: float) -> FigureData:
    """The steps taken so far as bars, and the noise floor as a line."""
    x = np.arange(len(bars), dtype=float)
    height = np.array([bar.error for bar in bars])
    marks = (
        *bars_with_intervals(x, height, [bar.ci95 for bar in bars], 0.3),
        Level(floor, SeriesRole.FLOOR, "noise floor: a perfect model would show this"),
    )
    panel = Panel(Axis("step"), UNSEEN_ERROR, marks, names=tuple(bar.name for bar in bars))
    return FigureData("", (panel,))


def diagnosis_figures(diagnosis: Diagnosis, trials: Sequence[Trial]) -> dict[str, FigureData]:
    """All figures by name."""
    figures = {"ladder": ladder(diagnosis)}
    if diagnosis.ranking:
        figures["ranking"] = ranking(diagnosis)
    for found in (*evidence_of(diagnosis, trials), *evidence_of_rivals(diagnosis, trials)):
        figures[f"evidence {found.effect}"] = evidence_figure(found)
    return figures


def ladder(diagnosis: Diagnosis) -> FigureData:
    """The error on unseen time after each step, with its interval and the noise floor."""
    steps = diagnosis.ladder
    x = np.arange(len(steps), dtype=float)
    error = np.array([step.heldout.nrmse for step in steps])
    low, high = np.array([step.heldout.ci95 or (step.heldout.nrmse,) * 2 for step in steps]).T
    marks = (
        Line(x, error, SeriesRole.CONTEXT),
        Dots(x, error, low, high, SeriesRole.MODEL, "error on unseen time, 95 % interval"),
        Level(diagnosis.noise_floor, SeriesRole.FLOOR, FLOOR),
        Level(0.0, SeriesRole.CONTEXT),
    )
    names = tuple(step_name(step).replace("base ", "base\n") for step in steps)
    panel = Panel(Axis("step"), NRMSE, marks, names=names)
    title = f"{diagnosis.vessel.name}: step by step"
    return FigureData(title, (panel,), caption=diagnosis.summary)


def ranking(diagnosis: Diagnosis) -> FigureData:
    """Each effect alone beside the re-fitted base: its error, and below how probable it is."""
    rows = diagnosis.ranking
    x = np.arange(len(rows), dtype=float)
    error = np.array([row.heldout_nrmse for row in rows])
    marks = (
        Bars(x - 0.3, x + 0.3, error, SeriesRole.MODEL, "error with this effect alone"),
        Level(diagnosis.ladder[1].heldout.nrmse, SeriesRole.ERROR, "without any"),
        Level(diagnosis.noise_floor, SeriesRole.FLOOR, FLOOR),
    )
    names = tuple(
        f"{row.effect.replace('_', chr(10))}\n{_percent(row.probability)}" for row in rows
    )
    panel = Panel(Axis("effect, and how probable it is"), NRMSE, marks, names=names)
    return FigureData(f"{diagnosis.vessel.name}: which effect", (panel,))


def _percent(probability: float) -> str:
    """Three digits, where the terminal has one decimal: the names are narrow."""
    return f"{100.0 * probability:.3g} %" if probability >= SMALLEST_PROBABILITY else "< 0.1 %"


def evidence_figure(found: Evidence) -> FigureData:
    """Missing force without the effect, and the effect's own curve through it."""
    axis = EVIDENCE.get(found.by, Axis(found.by, "°", DEGREES))  # an own variable is an angle
    middle = found.at * axis.factor
    points = Dots(middle, found.mean, found.low, found.high, SeriesRole.MEASURED,
                  "missing without it (mean, 2 standard errors)")  # fmt: skip
    curve = Line(middle, found.curve, SeriesRole.MODEL, f"what {found.effect} supplies")
    panel = Panel(axis, FORCES[found.axis], (Level(0.0, SeriesRole.CONTEXT), curve, points))
    share = found.explained_share
    caption = f"it supplies {100.0 * share:.0f} % of what is missing here" if share > 0.0 else ""
    return FigureData(f"Evidence for {found.effect}", (panel,), caption=caption)
