"""A free curve: what no effect explains as a curve of one variable or two, a map or a history.

A curve is an effect without a law: each of its tables is a force, a share of the thrust, water that
flows, or what a sensor reads too much, over one variable, two, the map or the time. The table that
a few steps of the search fill best is fitted whole, with all other numbers; then the knots of one
over one variable are moved to where it bends (a motor that skips a band of thrust has a step, which
knots at even places smear), and a profile is turned. It is judged on unseen time like an effect:
beside the effects that were found, for what they leave; and in their place, for an effect that only
lies near takes the form of another cause as far as its law can. At the noise free runs hardly tell
such a one from its cause, but from one moment to the next the two part.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.answer import LadderStep, ScoredFormula, fitted_values
from sim.diagnosis.fit import Fit, fit_effects, start_values, unknowns_for
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import Gain, HeldOutScorer, RankedEffect, gain, gain_under, rank
from sim.diagnosis.ladder import Selection
from sim.diagnosis.screening import Mapper
from sim.diagnosis.worth import helps, is_worth_it
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Scope, Values
from sim.state import Floats, Progress
from sim.vessel import Vessel

FREE_FORMS = tuple(effect for effect in EFFECTS if effect.is_curve)


@dataclass(frozen=True)
class FreeCurve:
    """The vessel with a curve, what the curve is worth, and whether it stands beside effects.

    over      what it is worth from one moment to the next in the place of effects: those found, or
              else the best of the ranking
    against   their names
    as_well   other kinds of curves that do as well: a survey takes its time from place to place
    formula   a short law that does as well; None where none of the library does
    """

    step: LadderStep
    gain: Gain
    fit: Fit
    over: Gain | None = None
    against: tuple[str, ...] = ()
    as_well: tuple[Effect, ...] = ()
    formula: ScoredFormula | None = None

    @property
    def replaces(self) -> bool:
        """Whether the curve does without any effect."""
        return len(self.step.effects) == 1

    @property
    def description(self) -> str:
        """The curve in words."""
        added = self.step.vessel.effects[-1]
        if added.effect.in_words is None:
            return added.effect.name
        return added.effect.in_words(fitted_values(self.step, added.effect.name))


def find_free_curve(
    vessel: Vessel, selection: Selection, scorer: HeldOutScorer,
    progress: Progress = lambda _: None, mapper: Mapper = map,
    forms: Sequence[Effect] = FREE_FORMS, beside: bool = True,
) -> FreeCurve | None:  # fmt: skip
    """The curve that predicts unseen time best, noticeably better than what was found without it.

    One that does without any effect comes before one beside them that is hardly better. None where
    none is. `beside`: also beside the effects that were found, not only in their place.
    """
    found: list[FreeCurve] = []
    for fit in (selection.base, selection.fit) if selection.fits and beside else (selection.base,):
        progress("looking for a curve, a pair, a map or a time history")
        rival = _best_of_catalogue(selection) if fit is selection.base else None
        curve = _fitted(vessel, fit, scorer, selection.fit, progress, mapper, forms, rival)
        if curve is not None:
            found.append(curve)
    if not found:
        return None
    least = min(curve.step.heldout.nrmse for curve in found)
    enough = thresholds.MAX_FORMULA_RATIO * least
    best = next(curve for curve in found if curve.step.heldout.nrmse <= enough)
    without = scorer.score_fit(selection.base if best.replaces else selection.fit).nrmse
    if without <= thresholds.MAX_FORMULA_RATIO * best.step.heldout.nrmse:
        return best  # no law at all does as well: none of them is the law
    progress("looking for a short formula")
    return replace(best, formula=_short_formula(best, scorer))


def _best_of_catalogue(selection: Selection) -> Fit:
    """What a curve in the place of all effects is held against: what was found, or else the first
    of the ranking if it is worth anything, though it may help no free run.
    """
    if selection.fits:
        return selection.fit
    first = next(iter(selection.first.finalists), None)
    return first.fit if first is not None and first.gain.nats > 0.0 else selection.base


def _short_formula(curve: FreeCurve, scorer: HeldOutScorer) -> ScoredFormula | None:
    """The shortest of those that predict unseen time as well as the curve; each of the held-out
    fits has its own, through its own table.
    """
    vessel = curve.step.vessel
    effect, values = vessel.effects[-1].effect, vessel.effects[-1].values
    formulas = effect.formulas
    if formulas is None:
        return None
    sure = {e.name.rpartition(".")[2]: 0.25 * (e.ci95[1] - e.ci95[0])
            for e in curve.step.parameters[effect.name]}  # fmt: skip
    std = {key: sure.get(key, 0.0) for key in values}
    names = curve.fit.unknowns.model.names
    place = {key: names.index(f"{effect.name}.{key}") for key in values}

    def through(theta: Floats, form: str) -> Floats:
        """The parameters of a fit with its table replaced by a form through its knots."""
        own, out = {key: float(theta[i]) for key, i in place.items()}, np.array(theta)
        made = next(f for f in formulas(vessel, own, std) if f.form == form)
        for key, i in place.items():
            out[i] = made.values[key]
        return out

    most = thresholds.MAX_FORMULA_RATIO * curve.step.heldout.nrmse
    for formula in formulas(vessel, values, std):
        error = scorer.score_fit(curve.fit, partial(through, form=formula.form)).nrmse
        if error <= most:
            return ScoredFormula(formula, error)
    return None


def _fitted(
    vessel: Vessel, fit: Fit, scorer: HeldOutScorer, last: Fit, progress: Progress,
    mapper: Mapper, forms: Sequence[Effect], rival: Fit | None,
) -> FreeCurve | None:  # fmt: skip
    """The best curve beside a fit's effects, in a kernel that holds no other effects; one that
    comes nowhere near a `rival` is not fitted. It has to help beyond the `last` fit too.
    """
    present = {a.effect.name for a in (*vessel.effects, *fit.added)}
    others = [form for form in forms if form.name not in present]
    if not others:
        return None
    superset = SupersetModel.of(vessel, [a.effect for a in fit.added])
    found = rank(superset, fit.model(), others, fit, progress, mapper, rival=rival)
    moved = mapper(partial(_refined, superset, found.reference, scorer), found.finalists)
    finalists = sorted(moved, key=lambda r: -r.gain.ratio)
    before = min(scorer.given, scorer.score_fit(last).nrmse)
    over = {
        r.name: gain_under(rival.renewed_problem, rival, r.fit) if rival else None
        for r in finalists
    }
    rows = [
        r for r in finalists
        if is_worth_it(r.gain)
        and (helps(scorer, [fit, last], r.fit) or _is_better(over[r.name], scorer, r.fit, before))
    ]  # fmt: skip
    if not rows:
        return None
    best, *rest = _simplest_first(rows, lambda one: scorer.score_fit(one).nrmse)
    step = LadderStep.of(best.fit, scorer)
    enough = thresholds.MAX_FORMULA_RATIO * step.heldout.nrmse
    as_well = tuple(r.effect for r in rest if scorer.score_fit(r.fit).nrmse <= enough)
    against = rival.names if rival else ()
    return FreeCurve(step, best.gain, best.fit, over[best.name], against, as_well)


def _refined(
    superset: SupersetModel, reference: Fit, scorer: HeldOutScorer, row: RankedEffect
) -> RankedEffect:
    """A table with its knots where it bends, and in the direction in which it differs, if it is
    surely and noticeably better so on unseen time, and no worse in free runs; else as it was.

    What it is worth is judged while these may move, each held-out block with those of the fit
    without it; then they are held, like the range of the table.
    """
    fit, problem, name = row.fit, row.fit.problem, row.name
    trials = len(problem.trials)
    moved = tuple(f"{name}.{key}" for key in _room(row.effect, fit.values(name)))
    if not moved or (row.effect.scope is Scope.VOYAGE and trials > 1):  # each has its own
        return row
    more = replace(problem.settings, free=(*problem.settings.free, *moved))
    for _ in range(thresholds.REFINING_ROUNDS):
        limits = {f"{name}.{k}": ends for k, ends in _room(row.effect, fit.values(name)).items()}
        unknowns = unknowns_for(superset, fit.effects(), trials, more)
        each = tuple(
            replace(u, lower=limits[u.name][0], upper=limits[u.name][1]) if u.name in limits else u
            for u in unknowns.each
        )
        unknowns = replace(unknowns, each=each)
        fit = fit_effects(fit.effects(), unknowns, problem, start_values(unknowns, fit))
    won = gain(row.fit.heldout_residual, fit.heldout_residual, problem.block)
    of_a_day = row.effect.scope is Scope.VOYAGE  # a place may be met in a few blocks alone
    surely = won.t >= thresholds.MIN_T_BETTER or (of_a_day and is_worth_it(won))
    if not surely or won.log_ratio < thresholds.MIN_LOG_RATIO_IN_PLACE:
        return row
    unknowns = unknowns_for(superset, fit.effects(), trials, problem.settings)
    fit = fit_effects(fit.effects(), unknowns, problem, start_values(unknowns, fit))
    if scorer.score_fit(fit).nrmse > scorer.score_fit(row.fit).nrmse:
        return row
    won = gain(reference.heldout_residual, fit.heldout_residual, problem.block)
    return replace(row, fit=fit, gain=won)


def _room(effect: Effect, values: Values) -> dict[str, tuple[float, float]]:
    """How far what holds a table may move in one round: its knots half the way to their neighbours,
    so that none passes another; a direction as far as the effect says.
    """
    places = effect.knot_places
    edges = np.array([0.0, *(values[p] for p in places), 1.0])
    middle, room = 0.5 * (edges[1:] + edges[:-1]), thresholds.KNOT_ROOM * np.diff(edges)
    ends = zip(middle[:-1] + room[:-1], middle[1:] - room[1:], strict=True)
    knots = dict(zip(places, ends, strict=True))
    return knots | {k: (values[k] - far, values[k] + far) for k, far in effect.turned.items()}


def _simplest_first(
    rows: Sequence[RankedEffect], error: Callable[[Fit], float]
) -> list[RankedEffect]:
    """A simpler curve before the best one where that is not clearly better: it carries over to
    other voyages further, and a short law may do as well. Simpler is what the best one holds; and
    of two that are of the place that of fewer numbers, if it leaves hardly more. One that errs in
    free runs (`error`) as what was never true comes behind.
    """
    best, *rest = rows
    most = thresholds.MAX_RIVAL_RATIO * error(best.fit)
    for row in rest:
        over = best.gain_over(row)
        close = over.log_ratio < thresholds.MIN_LOG_RATIO_IN_PLACE
        held = row.name == best.effect.contains
        simpler = (held and (close or not is_worth_it(over))) or (close and _is_smaller(row, best))
        if simpler and error(row.fit) <= most:
            return [row, *(r for r in rows if r is not row)]
    return list(rows)


def _is_smaller(one: RankedEffect, other: RankedEffect) -> bool:
    """Whether both are of the place, and one has fewer numbers."""
    of_places = one.effect.over_map is not None and other.effect.over_map is not None
    return of_places and len(one.effect.fit_parameters) < len(other.effect.fit_parameters)


def _is_better(over: Gain | None, scorer: HeldOutScorer, curve: Fit, before: float) -> bool:
    """Whether a curve is worth much from one moment to the next, and no worse in free runs."""
    if over is None or over.log_ratio < thresholds.MIN_LOG_RATIO_IN_PLACE:
        return False
    return is_worth_it(over) and scorer.score_fit(curve).nrmse <= before
