"""From what was found to one of four answers, and the sentence that gives it.

**A free curve**: what no effect explains as a curve of one variable, a map or a time history,
fitted, and judged on unseen time like an effect.

An effect that declares `tables` has no law: each of its empty tables is a force, or a share of the
thrust, over one variable. The table that a few steps of the search fill best is fitted whole, with
all other numbers: beside the effects that were found, for what they leave; and in their place, for
an effect that only lies near takes the form of another cause as far as its law can.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim.comparison.compare import Judgement, judge
from sim.diagnosis import thresholds
from sim.diagnosis.answer import LadderStep, ScoredFormula, Verdict, fitted_values
from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import Gain, HeldOutScorer, RankedEffect, Ranking, rank
from sim.diagnosis.ladder import Selection, helps, is_worth_it
from sim.diagnosis.residual_terms import Dependence, dependences
from sim.diagnosis.screening import Mapper, Progress
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect
from sim.state import Floats
from sim.vessel import Vessel

FREE_FORMS = tuple(effect for effect in EFFECTS if effect.tables is not None)


@dataclass(frozen=True)
class FreeCurve:
    """The vessel with a curve, what the curve is worth, and whether it stands beside effects.

    as_well   other kinds of curves that do as well: a survey takes its time from place to place
    formula   a short law that does as well; None where none of the library does
    """

    step: LadderStep
    gain: Gain
    fit: Fit
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
    vessel: Vessel, selection: Selection, scorer: HeldOutScorer, given: float,
    progress: Progress = lambda _: None, mapper: Mapper = map,
    forms: Sequence[Effect] = FREE_FORMS, beside: bool = True,
) -> FreeCurve | None:  # fmt: skip
    """The curve that predicts unseen time best, noticeably better than what was found without it.

    One that does without any effect comes before one beside them that is hardly better. None where
    none is. `given`: error on unseen time of the vessel as it was given; `beside`: also beside the
    effects that were found, not only in their place.
    """
    before = min(scorer.score_fit(selection.fit).nrmse, given)
    found: list[FreeCurve] = []
    for fit in (selection.base, selection.fit) if selection.fits and beside else (selection.base,):
        progress("looking for a curve, a map or a time history")
        rival = selection.fit if fit is selection.base else None
        curve = _fitted(vessel, fit, scorer, before, progress, mapper, forms, rival)
        if curve is not None:
            found.append(curve)
    if not found:
        return None
    least = min(curve.step.heldout.nrmse for curve in found)
    enough = thresholds.MAX_FORMULA_RATIO * least
    best = next(curve for curve in found if curve.step.heldout.nrmse <= enough)
    progress("looking for a short formula")
    return replace(best, formula=_short_formula(best, scorer))


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
    vessel: Vessel, fit: Fit, scorer: HeldOutScorer, before: float, progress: Progress,
    mapper: Mapper, forms: Sequence[Effect], rival: Fit | None,
) -> FreeCurve | None:  # fmt: skip
    """The best curve beside a fit's effects, in a kernel that holds no other effects; one that
    comes nowhere near a `rival` is not fitted.
    """
    present = {a.effect.name for a in (*vessel.effects, *fit.added)}
    others = [form for form in forms if form.name not in present]
    if not others:
        return None
    superset = SupersetModel.of(vessel, [a.effect for a in fit.added])
    found = rank(superset, fit.model(), others, fit, progress, mapper, rival=rival)
    rows = [r for r in found.finalists if is_worth_it(r.gain) and helps(scorer, fit, r.fit, before)]
    if not rows:
        return None
    best, *rest = rows
    step = LadderStep.of(best.fit, scorer)
    enough = thresholds.MAX_FORMULA_RATIO * step.heldout.nrmse
    as_well = tuple(r.effect for r in rest if scorer.score_fit(r.fit).nrmse <= enough)
    return FreeCurve(step, best.gain, best.fit, as_well)


TIME = "time"  # of `force_terms.GROUPS`


def rivals_of(ranking: Ranking, found: Sequence[str] = ()) -> list[RankedEffect]:
    """Effects that explain held-out time as well as the best, as far as blocks of it can tell.

    What was found beside it in the end is no rival.
    """
    if not ranking.finalists or not is_worth_it(ranking.best.gain):
        return []
    best, out = ranking.best, []
    for row in ranking.finalists[1:]:
        better = best.gain_over(row)
        if row.effect.general_of == best.name or row.name in found:
            continue
        close = row.gain.log_ratio > thresholds.MIN_SHARE_OF_BEST * best.gain.log_ratio
        if close and better.t < thresholds.MIN_T_BETTER:
            out.append(row)
    return out[: thresholds.MAX_EXPLANATIONS - 1]


def verdict_of(
    selection: Selection, rivals: Sequence[Sequence[RankedEffect]], left: Sequence[Dependence],
    above_noise: bool,
) -> Verdict:  # fmt: skip
    """One of four: what is left counts most, then whether anything was found.

    `above_noise`: the error that is left cannot be noise, or sensors contradict one another.
    """
    if left or above_noise:
        return Verdict.UNKNOWN
    if not selection.steps:
        return Verdict.ADEQUATE
    return Verdict.CONFOUNDED if any(rivals) else Verdict.EXPLAINED


def is_above_noise(effects: Sequence[Effect], ladder: Sequence[LadderStep], floor: float) -> bool:
    """Whether the last step's error cannot be noise, whatever it depends on.

    An effect in nature's own form may leave a few floors, but not much of what it was to explain.
    Beside what is but a part of nature (one train of waves) the error alone tells nothing.
    """
    last = ladder[-1].heldout.nrmse
    if any(e.partial for e in effects) or last <= thresholds.MAX_FLOORS * floor:
        return False
    share = _share_of_form(effects)
    if effects and last <= thresholds.MAX_FLOORS_WITH_EFFECTS * floor:
        share = max(share, thresholds.MAX_SHARE_LEFT)
    return _is_more_than(share, last, floor, ladder, floor)


def does_without_effects(curve: FreeCurve, ladder: Sequence[LadderStep]) -> bool:
    """Whether a curve alone predicts clearly better than all effects of the last step."""
    most = thresholds.MAX_IN_PLACE_RATIO * ladder[-1].heldout.nrmse
    return curve.replaces and curve.step.heldout.nrmse < most


def is_curve_above_form(
    curve: FreeCurve, effects: Sequence[Effect], ladder: Sequence[LadderStep], floor: float
) -> bool:
    """Whether a curve beside effects takes away more error than nature's own form leaves."""
    last, after = ladder[-1].heldout.nrmse, curve.step.heldout.nrmse
    return _is_more_than(_share_of_form(effects), last, after, ladder, floor)


def _is_more_than(
    share: float, error: float, after: float, ladder: Sequence[LadderStep], floor: float
) -> bool:
    """Whether the squared error between two is more than a share of what the base alone left above
    the noise.
    """
    return error**2 - after**2 > share * (ladder[1].heldout.nrmse ** 2 - floor**2)


def _share_of_form(effects: Sequence[Effect]) -> float:
    """The share of the base's error that nature's own form may leave."""
    return max([thresholds.MIN_SHARE_OF_BASE_ERROR, *(e.unsteady for e in effects)])


def is_above_stated(effects: Sequence[Effect], share: Sequence[float]) -> bool:
    """Whether surge and sway are left with more than the recordings state as noise can be.

    `share`: of u, v, r, `Diagnosis.noise_share`. The yaw rate tells nothing here: gusts shake it.
    """
    if any(e.partial for e in effects):
        return False
    most = thresholds.MAX_NOISE_SHARE_WITH_EFFECTS if effects else thresholds.MAX_NOISE_SHARE_ALONE
    return max(share[:2]) > most


def remaining_dependences(selection: Selection, above_noise: bool) -> list[Dependence]:
    """What the last fit leaves that depends on something; `above_noise`: by more than one floor.

    However small: a free run of ten seconds may hardly tell what six hundred of them do.
    """
    return [
        d
        for d in dependences(selection.fit)
        if is_more_than_form(d.gain, selection, above_noise, of_time=d.on == TIME)
    ]


def is_more_than_form(
    g: Gain, selection: Selection, above_noise: bool, *, of_time: bool = False
) -> bool:
    """Whether what is left is more than a form that nature chose a little differently.

    `of_time`: it depends on the time, as gusts do that a steady wind leaves.
    """
    won = sum(step.best.gain.nats for step in selection.steps)
    share = thresholds.MAX_FORM_SHARE_ABOVE_NOISE if above_noise else thresholds.MAX_FORM_SHARE
    if any(a.effect.partial for a in selection.fit.added):
        share = thresholds.MAX_FORM_SHARE_PARTIAL
    if of_time:
        share = max([share, *(a.effect.unsteady for a in selection.fit.added)])
    return is_worth_it(g) and g.nats > max(thresholds.MIN_RESIDUAL_NATS, share * won)


def unexplained_share(ladder: Sequence[LadderStep], floor: float) -> float:
    """Share of the squared error above the noise that the last step leaves."""
    first, last = ladder[0].heldout.nrmse ** 2, ladder[-1].heldout.nrmse ** 2
    above = first - min(floor**2, last)
    return float(np.clip((last - min(floor**2, last)) / above, 0.0, 1.0)) if above > 0 else 0.0


def summary_of(
    verdict: Verdict, ladder: Sequence[LadderStep], rivals: Sequence[Sequence[RankedEffect]],
    left: Sequence[Dependence], floor: float, curve: FreeCurve | None = None,
    period: float | None = None, contradictions: Sequence[str] = (),
) -> str:  # fmt: skip
    """The answer in one sentence; `period` [s]: that of what is left, where it swings.

    `contradictions`: of sensors; what a model of the boat leaves may be theirs.
    """
    first, base, last = (ladder[i].heldout.nrmse for i in (0, 1, -1))
    names = " and ".join(ladder[-1].effects)
    fell = f"{_changed(first, last)} (noise {floor:.3f}){_on_others(ladder)}"
    if verdict is Verdict.ADEQUATE:
        refit = f"{base:.3f} with the base re-fitted"
        if ladder[1].base == "kept":
            refit = "no better with the base re-fitted"
        numbers = f"{first:.3f} as given, {refit} (noise {floor:.3f})"
        if judge(min(first, base), floor) is Judgement.UNJUDGED:
            return f"these data cannot tell whether anything is missing, noise hides it: {numbers}"
        return f"no effect of the catalogue is missing as far as these data can tell: {numbers}"
    if verdict is Verdict.EXPLAINED:
        return f"{names}: {fell}"
    if verdict is Verdict.CONFOUNDED:
        others = sorted({r.name for step in rivals for r in step})
        return f"{names}: {fell}; these data cannot tell it from {' or '.join(others)}"
    one = "s" if len(ladder[-1].effects) == 1 else ""
    known = f"{names} help{one}, {fell}, but " if names else ""
    if curve is not None:
        below = f"{_changed(first, curve.step.heldout.nrmse)} (noise {floor:.3f})"
        nearest = f"; nearest to it come{one} {names}, {fell}" if names and curve.replaces else ""
        if curve.as_well:
            kinds = " or ".join(effect.looks_like for effect in curve.as_well)
            below += f"; as well does a curve that {kinds}"
        if curve.formula is not None:
            below += f"; as well does {curve.formula.formula.text} ({curve.formula.nrmse:.3f})"
        return (
            f"{'' if nearest else known}something is missing that the catalogue does not hold: "
            f"{curve.description}; with that curve {below}{nearest}"
        )
    rest = "what is left is no noise, and follows nothing that was looked for"
    if contradictions:
        rest = (f"the sensors contradict one another ({'; '.join(contradictions)}): that comes "
                "before any effect")  # fmt: skip
    elif left:
        rest = left[0].description
    elif period is not None:
        rest = (f"what is left swings with a period of some {period:.1f} s, as in a sea, or under "
                "a controller that hunts")  # fmt: skip
    return f"{known}something is missing that the catalogue does not hold: {rest}"


def _on_others(ladder: Sequence[LadderStep]) -> str:
    """Where recordings that were left out are predicted no better than as given, that; else ""."""
    given, last = ladder[0].left_out, ladder[-1].left_out
    if given is None or last is None or last.nrmse < given.nrmse:
        return ""
    numbers = f"{given.nrmse:.3f} as given, {last.nrmse:.3f} so"
    return f", but not that on recordings which the fit did not see: {numbers}"


def _changed(first: float, last: float) -> str:
    """From where to where the error on unseen time goes, as it is printed."""
    a, b = f"{first:.3f}", f"{last:.3f}"
    if a == b:
        return f"the error on unseen time stays at {a}"
    return f"the error on unseen time {'falls' if last < first else 'rises'} from {a} to {b}"
