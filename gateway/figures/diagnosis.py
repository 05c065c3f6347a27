"""Figures of a diagnosis: the ladder, the ranking, and the evidence for each effect."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from gateway.figures import (
    DEGREES,
    EVIDENCE,
    MISSING_FORCES,
    NRMSE,
    SMALLEST_PROBABILITY,
    Axis,
    Band,
    Bars,
    ColouredPoints,
    Dots,
    FigureData,
    Level,
    Line,
    Mark,
    Panel,
    SeriesRole,
)
from gateway.figures.comparison import bars_with_intervals
from gateway.figures.motion import map_panel, track_line
from gateway.figures.words import diagnosis_texts
from sim.diagnosis.answer import Diagnosis, LadderStep, StepBase, fitted_values
from sim.diagnosis.evidence import Evidence, evidence_of, evidence_of_rivals
from sim.diagnosis.screening_steps import moment_of
from sim.effects.effect import Kind, Parameter
from sim.effects.tables import MapField
from sim.state import Eta, Floats
from sim.trial import Trial

UNSEEN_ERROR = Axis("error on unseen time, nrmse (0 is perfect)")
MINUTES = 1.0 / 60.0
FLOOR = "noise floor: what a perfect model would show"
ARROW, HEAD = 0.8, 0.2  # the longest arrow over the spacing of the map, its head over its length
FORCES = (*MISSING_FORCES, Axis("missing force along it", "N"))


def step_name(step: LadderStep) -> str:
    """What was done in a step of the ladder, in words."""
    if step.effects:
        return f"+ {' + '.join(step.effects[-step.new :])}"
    return {
        StepBase.PLAIN: "as given", StepBase.KEPT: "base kept",
        StepBase.REFITTED: "base re-fitted",
    }[step.base]  # fmt: skip


def told_steps(d: Diagnosis) -> list[tuple[str, LadderStep]]:
    """The ladder, each step with its name; then the curve, where nothing in the catalogue is it."""
    steps = [(step_name(step), step) for step in d.ladder]
    if d.curve is None:
        return steps
    instead = "instead: " if d.curve_stands_alone else "+ "
    return [*steps, (f"{instead}{d.curve.effects[-1]}", d.curve)]


@dataclass(frozen=True)
class LadderBar:
    """A step of the ladder: its name, the error after it, and its 95 % interval if there is one."""

    name: str
    error: float
    ci95: tuple[float, float] | None

    @classmethod
    def of(cls, step: LadderStep) -> "LadderBar":
        """The bar of a step of a diagnosis."""
        return cls.named(step_name(step), step)

    @classmethod
    def named(cls, name: str, step: LadderStep) -> "LadderBar":
        """The same under another name."""
        return cls(name.replace("_", " "), step.heldout.nrmse, step.heldout.ci95)


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
    course = timeline(diagnosis, trials)
    if course is not None:
        figures["timeline"] = course
    proofs = {r.effect: evidence_figure(r) for r in evidence_of_rivals(diagnosis, trials)}
    for effect, figure in {**evidence_figures(diagnosis, trials), **proofs}.items():
        figures[f"evidence {effect}"] = figure
    return figures


def evidence_figures(diagnosis: Diagnosis, trials: Sequence[Trial]) -> dict[str, FigureData]:
    """Of each effect that was found, and of the curve beside or in the place of them, that
    first, by name.
    """
    out = {found.effect: evidence_figure(found) for found in evidence_of(diagnosis, trials)}
    steps = [diagnosis.ladder[-1], *([diagnosis.curve] if diagnosis.curve else [])]
    for step in steps:
        for added in step.vessel.effects:
            if added.effect.name in step.effects and added.effect.over_map is not None:
                field = added.effect.over_map(fitted_values(step, added.effect.name))
                trial = next(t for t in trials if t.usable.any())
                out[added.effect.name] = _map_figure(added.effect.name, field, trial)
    first = diagnosis.curve.effects[-1:] if diagnosis.curve else ()
    return {name: out[name] for name in (*first, *out) if name in out}


def _map_figure(effect: str, field: MapField, trial: Trial) -> FigureData:
    """Arrows at the places of a field that the boat came near, over its track; where the field has
    no direction, the track coloured by it.

    What is known no better than the longest arrow that is sure is not drawn.
    """
    title = f"Evidence for {effect}"
    if not field.directed:
        return FigureData(title, (map_panel((_coloured_track(effect, field, trial),), ""),))
    track = np.where(trial.usable[:, None], trial.eta, np.nan)
    place = np.stack([field.north, field.east], axis=1)
    apart = np.max([np.diff(np.unique(x)).max(initial=0.0) for x in (field.north, field.east)])
    sailed = trial.eta[trial.usable, : Eta.YAW]
    near = np.min(np.linalg.norm(place[:, None] - sailed, axis=2), axis=1) <= apart
    sure = near & (field.half <= float(field.least[near].max(initial=0.0)))
    longest = float(field.size[sure].max(initial=0.0))
    marks = [track_line(track, SeriesRole.CONTEXT, "where the boat was")]
    if longest > 0.0:
        ahead = np.stack([field.to_north, field.to_east], axis=1)[sure] * ARROW * apart / longest
        arrows = _arrows(place[sure], ahead)
        label = f"what {effect} supplies, at most {longest:.2g} {field.unit}"
        marks.append(Line(arrows[:, 1], arrows[:, 0], SeriesRole.MODEL, label))
    caption = "" if longest > 0.0 else "nowhere is it known well enough for an arrow"
    panel = map_panel(tuple(marks), "")
    return FigureData(title, (panel,), caption=caption)


def _coloured_track(effect: str, field: MapField, trial: Trial) -> ColouredPoints:
    """Where the boat was, coloured by the field at the nearest of its places; 0 beyond them.

    Of a field with both signs what it adds, or what it takes away, whichever is larger.
    """
    sailed = trial.eta[trial.usable, : Eta.YAW]
    away, nearest = cKDTree(np.stack([field.north, field.east], axis=1)).query(sailed)
    apart = np.max([np.diff(np.unique(x)).max(initial=0.0) for x in (field.north, field.east)])
    value = np.where(away <= apart, field.to_north[nearest], 0.0)
    does = "adds"
    if max(value, key=abs) < 0.0:
        value, does = -value, "takes away"
    value = np.maximum(value, 0.0)
    return ColouredPoints(sailed[:, 1], sailed[:, 0], value, Axis(f"{effect} {does}", field.unit))


def _arrows(tail: Floats, ahead: Floats) -> Floats:
    """Tails (n, 2) and lengths north and east (n, 2) -> one line (6n, 2), NaN between arrows."""
    tip, aside = tail + ahead, 0.6 * HEAD * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    left, right = (tip - HEAD * ahead + side for side in (aside, -aside))
    end = np.full_like(tail, np.nan)
    return np.stack([tail, tip, left, right, tip, end], axis=1).reshape(-1, 2)


def timeline(diagnosis: Diagnosis, trials: Sequence[Trial]) -> FigureData | None:
    """What changed at a moment: each number before and after, with intervals; None if nothing did.

    Two thin lines hold the moment. A number `later_…` follows its namesake, any other one what
    would be neutral.
    """
    last, end = diagnosis.ladder[-1], max(float(t.time[-1]) for t in trials)
    panels = []
    for added in (a for a in last.vessel.effects if a.effect.name in last.effects):
        known = {p.name: p for p in added.effect.parameters}
        moment = moment_of(added.effect)
        if moment is None:
            continue
        found = fitted_values(last, added.effect.name).ci95
        low, high = found.get(moment, (added.values[moment],) * 2)
        for p in known.values():
            after = known.get(f"later_{p.name}", p)
            before = p.neutral if after is p else added.values[p.name]
            if before is None or p.kind not in (Kind.NUMBER, Kind.CIRCLE):
                continue
            if p.name.startswith("later_"):
                continue
            ends = (before, added.values[after.name])
            own = found.get(p.name) if after is not p else None
            panels.append(
                _course(
                    f"{added.effect.name}: {p.name}", p, ends, (own, found.get(after.name)),
                    (added.values[moment], low, high), end,
                )
            )  # fmt: skip
    if not panels:
        return None
    return FigureData(
        f"{diagnosis.vessel.name}: the course of the voyage", tuple(panels), shared_x=True,
        caption=" ".join(diagnosis_texts(diagnosis)),
    )  # fmt: skip


def _course(
    name: str, p: Parameter, ends: tuple[float, float],
    ci95: tuple[tuple[float, float] | None, tuple[float, float] | None],
    moment: tuple[float, float, float], last: float,
) -> Panel:  # fmt: skip
    """One number before and after a moment (value, low, high) [s] of a voyage that lasts `last`."""
    axis = Axis(name.replace("_", " "), p.unit.replace("-", ""))
    if p.kind is Kind.CIRCLE:
        axis = Axis(axis.label, "°", DEGREES)
    factor = axis.factor
    circle = 2.0 * np.pi if p.kind is Kind.CIRCLE else 0.0
    marks: list[Mark] = []
    levels, times = [], (0.0, moment[0], last)
    for value, interval, span in zip(ends, ci95, pairwise(times), strict=True):
        turns = circle * np.floor(value / circle) if circle else 0.0
        low, high = ((x - turns) * factor for x in interval or (value, value))
        x = np.array(span) * MINUTES
        marks.append(Band(x, np.full(2, low), np.full(2, high), SeriesRole.INTERVAL))
        levels += [low, high, (value - turns) * factor]
    middle = np.array([levels[2], levels[2], levels[5], levels[5]])
    marks.append(Line(np.repeat(times, 2)[1:-1] * MINUTES, middle, SeriesRole.MODEL))
    for t in moment[1:]:
        ends_of = np.array([min(levels), max(levels)])
        marks.append(Line(np.full(2, t * MINUTES), ends_of, SeriesRole.CONTEXT))
    return Panel(Axis("time after the first sample", "min"), axis, tuple(marks))


def ladder(diagnosis: Diagnosis) -> FigureData:
    """The error on unseen time after each step, with its interval and the noise floor."""
    told, steps = zip(*told_steps(diagnosis), strict=True)
    x = np.arange(len(steps), dtype=float)
    error = np.array([step.heldout.nrmse for step in steps])
    low, high = np.array([step.heldout.ci95 or (step.heldout.nrmse,) * 2 for step in steps]).T
    marks = (
        Line(x, error, SeriesRole.CONTEXT),
        Dots(x, error, low, high, SeriesRole.MODEL, "error on unseen time, 95 % interval"),
        Level(diagnosis.noise_floor, SeriesRole.FLOOR, FLOOR),
        Level(0.0, SeriesRole.CONTEXT),
    )
    names = tuple(name.replace("base ", "base\n").replace(": ", ":\n") for name in told)
    panel = Panel(Axis("step"), NRMSE, marks, names=names)
    title = f"{diagnosis.vessel.name}: step by step"
    return FigureData(title, (panel,), caption=diagnosis.summary)


def ranking(diagnosis: Diagnosis) -> FigureData:
    """Each effect alone beside the re-fitted base: its error, and below how probable it is."""
    rows = diagnosis.told_ranking
    x = np.arange(len(rows), dtype=float)
    error = np.array([row.heldout_nrmse for row in rows])
    marks = (
        Bars(x - 0.3, x + 0.3, error, SeriesRole.MODEL, "error with this effect alone"),
        Level(diagnosis.ladder[1].heldout.nrmse, SeriesRole.ERROR, "without any"),
        Level(diagnosis.noise_floor, SeriesRole.FLOOR, FLOOR),
    )
    names = tuple(
        f"{row.effect.replace('_', chr(10))}\n"
        f"{'not believed' if row.doubted else _percent(row.probability)}"
        for row in rows
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
