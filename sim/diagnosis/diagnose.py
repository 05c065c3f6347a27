"""Which physical effect is missing: the whole path, from trials and a vessel to an answer.

re-fit the base → search for effects → score each step on held-out time → what is left → verdict
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict, candidates_of, falling
from sim.diagnosis.feedback import said_of_times, times_of, with_times_one_step
from sim.diagnosis.fit import Fit, fit_effects, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.free_curve import FREE_FORMS, FreeCurve, find_free_curve
from sim.diagnosis.generality import doubt_of, unseen_headings
from sim.diagnosis.heldout import HeldOutScorer, RankedEffect, gain
from sim.diagnosis.ladder import EffectSearch, Selection
from sim.diagnosis.limits import strain_of
from sim.diagnosis.next_experiment import (
    RecordingContent,
    Refusal,
    SuggestedManoeuvre,
    by_information,
    by_separation,
    refusals,
)
from sim.diagnosis.residual_terms import swing_period
from sim.diagnosis.rivals import all_rivals_of
from sim.diagnosis.screening import Mapper, Progress
from sim.diagnosis.verdict import (
    does_without_effects,
    is_above_noise,
    is_above_stated,
    is_curve_above_form,
    is_more_than_form,
    remaining_dependences,
    rivals_of,
    seen_one_step_ahead,
    summary_of,
    unexplained_share,
    verdict_of,
)
from sim.diagnosis.worth import is_at_floor, is_missed, is_worth_it
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Scope, Shown
from sim.identification import BASE, IdentifySettings
from sim.identification.parameters import unknowns_of
from sim.identification.shooting import FitInputs, fit_by_shooting
from sim.model import Model
from sim.prediction.free_runs import shown_floor
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel


@dataclass(frozen=True)
class DiagnoseSettings:
    """How a diagnosis is made.

    prior     relative standard deviation of the base numbers as given
    most      effects that are added at most; 1: only the first, 0: only the ranking
    horizons  of the free runs [s]
    effects   the catalogue that is tried
    plan      also work out which manoeuvres would tell more, even if nothing is confounded
    """

    prior: float = 0.15
    most: int = 4
    horizons: tuple[float, ...] = (1.0, 3.0, 6.0)
    effects: tuple[Effect, ...] = field(default=EFFECTS)
    plan: bool = False

    def identify(self, vessel: Vessel) -> IdentifySettings:
        """How the base is fitted along: near what was given, where that is a number at all.

        Runs are tied by a filter: free ones leave the track of a hull that is unstable on course
        whatever the model, and on other hulls they name no more effects (benchmarks/hidden).
        """
        given = {n: self.prior for n in BASE if getattr(vessel.dynamics, n) != 0.0}
        return IdentifySettings(horizons=self.horizons, priors=given, tied=True)


def diagnose(
    trials: Sequence[Trial],
    vessel: Vessel,
    settings: DiagnoseSettings | None = None,
    progress: Progress = lambda _: None,
    mapper: Mapper = map,
) -> Diagnosis:
    """What is missing from the vessel as these trials show it; NoUsableTimeError if too short.

    `mapper` maps as `map` does, perhaps on several threads.
    """
    settings = settings or DiagnoseSettings()
    trials = [t for t in trials if t.usable.any()]
    seconds = sum(float(t.usable.sum()) * t.dt for t in trials)
    if seconds < (needed := thresholds.MIN_USABLE_S):
        raise NoUsableTimeError(f"{seconds:.0f} s of usable time: {needed:.0f} s are needed")
    plain = Model.of(vessel)
    present = {added.effect.name for added in vessel.effects}
    effects = [e for e in settings.effects if e.name not in present and not e.is_curve]
    content = RecordingContent.of(plain, trials)
    refused = refusals(effects, content, vessel)
    shown = [e for e in effects if e.name not in {r.effect for r in refused}]
    unshown = [e for e in effects if e not in shown and not vessel.unmet_needs(e)]
    progress("re-fitting the base")
    superset = SupersetModel.of(vessel, shown, trials)
    base = fit_base(superset, plain, trials, settings)
    search = EffectSearch(
        superset, tuple(shown), settings.most, progress, mapper,
        HeldOutScorer.of(trials, plain), tuple(unshown),
    )  # fmt: skip
    selection, on_times = _with_times_in_a_sea(search.run(base), search)
    progress("what is left")
    scorer = search.scorer.shared_with(selection.fit)
    search = replace(search, scorer=scorer)
    given = LadderStep((), "plain", scorer.score_model(plain), (), {}, vessel)
    if len(trials) >= thresholds.MIN_RECORDINGS:
        given = replace(given, left_out=given.heldout)
    fits = (selection.base, *selection.fits)
    refitted, *added = (LadderStep.of(fit, scorer).with_left_out(fit, scorer) for fit in fits)
    first = refitted if _predicts_better(refitted, given) else replace(given, base="kept")
    ladder, floor = falling([given, first, *added]), scorer.noise_floor
    last = ladder[-1]
    noise_share = selection.fit.noise_share
    above = last.heldout.nrmse > thresholds.MAX_FLOORS * floor
    predicted = bool(selection.fits) and last.heldout.nrmse <= floor
    whole = is_at_floor(noise_share) and not above
    left = [] if predicted or whole else remaining_dependences(selection, above)
    alone = [LadderStep.of(row.fit, scorer) for row in selection.first.finalists]
    rivals = [all_rivals_of(step, search, selection) for step in selection.steps]
    later = [
        LadderStep.of(row.fit, scorer)
        for step, of in zip(selection.steps, rivals, strict=True)
        for row in of
        if step is not selection.first or row.name not in {r.name for r in step.finalists}
    ]
    effects_found = [a.effect for a in selection.fit.added]
    beyond = is_above_noise(effects_found, ladder, floor) or is_above_stated(
        effects_found, noise_share
    )
    contradictions = tuple(dict.fromkeys(said for t in trials for said in t.contradictions))
    beyond_belief = [
        strain for added in last.vessel.effects
        if added.effect.name in last.effects and (strain := strain_of(added, last.vessel))
    ]  # fmt: skip
    no_noise = beyond or bool(contradictions) or bool(beyond_belief)
    verdict = verdict_of(selection, rivals, left, no_noise)
    notes = [each.description for each in last.assumed]
    notes += filter(
        None, (*(unseen_headings(s.best, s.reference) for s in selection.steps), on_times)
    )
    led = bool(selection.steps) and selection.steps[0].best is selection.first.best
    of_first = rivals[0] if led else rivals_of(selection.first, last.effects)
    names = [row.name for row in of_first]
    short_of = {r.effect for r in refusals(FREE_FORMS, content, vessel)}
    of_a_day = len(trials) <= thresholds.MAX_RECORDINGS_OF_TABLES
    forms = [
        form for form in FREE_FORMS
        if form.name not in short_of and (of_a_day or form.scope is Scope.BOAT)
        # where sensors contradict one another a curve of the boat would be one of their errors
        and (form.observe is not None or not contradictions)
    ]  # fmt: skip
    verdict, curve = _held_against_a_curve(verdict, vessel, search, selection, ladder, forms)
    told = left or contradictions or beyond_belief
    nameless = verdict is Verdict.UNKNOWN and not told and curve is None
    period = swing_period(selection.fit) if nameless else None
    small = seen_one_step_ahead(selection) if verdict is Verdict.ADEQUATE else None
    if small is not None and not search.is_believed(small, selection.first.reference):
        small = None
    steps = (*ladder, *([curve.step] if curve else ()))
    told_floor = shown_floor(floor, [step.heldout.nrmse for step in steps])
    said = summary_of(
        verdict, ladder, rivals, left, told_floor, curve, period, contradictions, beyond_belief,
        small,
    )  # fmt: skip
    if curve is not None:  # the sentence has the curve in its place
        notes += beyond_belief
    return Diagnosis(
        verdict=verdict,
        summary="; ".join((said, *notes)),
        base_changed=first is refitted and _base_changed(selection.base),
        effects=last.effects,
        ladder=ladder,
        ranking=candidates_of(selection.first, alone, names),
        unexplained=unexplained_share(ladder, floor),
        depends_on=tuple(left),
        refused=(*refused, *_doubted(selection, scorer)),
        noise_floor=told_floor,
        vessel=last.vessel,
        suggested=_suggested(selection, rivals, settings.plan, progress),
        noise_share=noise_share,
        alternatives=tuple(
            step
            for step in (*alone, *later, *([curve.step] if curve else ()))
            if step.effects not in {s.effects for s in ladder}
        ),
        curve=curve.step if curve else None,
        formula=curve.formula if curve else None,
        start_time_ns=trials[0].start_time_ns if len(trials) == 1 else 0,
    )


def _held_against_a_curve(
    verdict: Verdict, vessel: Vessel, search: EffectSearch, selection: Selection,
    ladder: Sequence[LadderStep], forms: Sequence[Effect],
) -> tuple[Verdict, FreeCurve | None]:  # fmt: skip
    """The verdict, and the curve of what the catalogue does not hold; else as it was, and None.

    A curve is tried in the place of all that was found, be it nothing; and where more than noise is
    left beside it.
    """
    left, floor = ladder[-1].heldout.nrmse, search.scorer.noise_floor
    predicted = bool(selection.fits) and left <= floor
    more = max(selection.fit.noise_share) > thresholds.MAX_NOISE_SHARE and not predicted
    more = more or verdict is Verdict.UNKNOWN
    curve = find_free_curve(
        vessel, selection, search.scorer, search.progress, search.mapper, forms, beside=more,
    )  # fmt: skip
    if curve is None or verdict is Verdict.UNKNOWN:
        return verdict, curve
    above = left > thresholds.MAX_FLOORS * floor
    if curve.replaces:
        beyond_form = does_without_effects(curve, selection, ladder, floor, above)
    else:
        effects = [a.effect for a in selection.fit.added]
        beyond_form = is_more_than_form(curve.gain, selection, above)
        beyond_form &= is_curve_above_form(curve, effects, ladder, floor)
    return (Verdict.UNKNOWN, curve) if beyond_form else (verdict, None)


def fit_base(
    superset: SupersetModel, plain: Model, trials: Sequence[Trial], settings: DiagnoseSettings
) -> Fit:
    """The base without any new effect: fitted by shooting first, then on the common problem.

    Parameters of effects that the vessel has already are fitted along.
    """
    vessel, how = plain.vessel, settings.identify(plain.vessel)
    own = [f"{a.effect.name}.{key}" for a in vessel.effects for key in a.effect.fit_parameters]
    how = replace(how, free=(*how.free, *own)).with_speeds_of(trials)
    shot = fit_by_shooting(FitInputs(unknowns_of(plain, len(trials), how), trials, how))
    unknowns = unknowns_for(superset, [], len(trials), how)
    problem = FitProblem.of(vessel, trials, unknowns, shot.z, shot.noise, how)
    return fit_effects([], unknowns, problem, shot.z)


def _with_times_in_a_sea(selection: Selection, search: EffectSearch) -> tuple[Selection, str]:
    """Delays and lags as predictions one step ahead have them where what is left swings, and what
    is to be said of them; else as they are, and nothing.
    """
    fit = selection.fit
    found = [a.effect for a in fit.added]
    timed = any(Shown.COMMANDS in effect.shown_by for effect in found)
    period = None if is_at_floor(fit.noise_share) or not timed else swing_period(fit)
    if period is None:
        return selection, ""
    if times_of(found):
        search.progress("delays and lags, from one moment to the next")
        close = with_times_one_step(fit)
        if search.helps(selection.base, close):
            fits = (
                with_times_one_step(f) if times_of(a.effect for a in f.added) else f
                for f in selection.fits[:-1]
            )
            selection = replace(selection, fits=(*fits, close))
    told = [estimate.name for estimate in selection.fit.told]
    return selection, said_of_times(found, told, period)


def _doubted(selection: Selection, scorer: HeldOutScorer) -> list[Refusal]:
    """What would be worth it on these recordings, but is not believed of the boat."""
    rows = [
        (row, doubt_of(row, step.reference, scorer))
        for step in (selection.first, *selection.steps)
        for row in step.finalists
        if row.name not in selection.fit.names and is_missed(row.effect, row.gain)
    ]
    return list({row.name: Refusal(row.name, doubt) for row, doubt in rows if doubt}.values())


def _predicts_better(fitted: LadderStep, given: LadderStep) -> bool:
    """Whether re-fitted numbers predict unseen time, and recordings left out, better than as given.

    Numbers that suit the recordings they were fitted to and no other are not kept.
    """
    pairs = ((fitted.heldout, given.heldout), (fitted.left_out, given.left_out))
    return all(a.nrmse < b.nrmse for a, b in pairs if a is not None and b is not None)


def _suggested(
    selection: Selection, rivals: Sequence[Sequence[RankedEffect]], plan: bool, progress: Progress
) -> tuple[SuggestedManoeuvre, ...]:
    """Manoeuvres that would tell rivals apart; if asked, without rivals those that tell most."""
    for step, of in zip(selection.steps, rivals, strict=True):
        if of:
            progress("looking for the manoeuvre that separates them")
            return tuple(by_separation(step.best.fit, [r.fit for r in of]))
    if not plan:
        return ()
    progress("looking for the manoeuvre that tells most")
    return tuple(by_information(selection.fit))


def _base_changed(base: Fit) -> bool:
    """Whether the base numbers had to move: the fit beats them as given on held-out time.

    Offsets in time are no numbers of the base: both have them.
    """
    z = np.where([u.name in BASE for u in base.unknowns.each], base.unknowns.start, base.z)
    return is_worth_it(gain(base.at(z[None])[0], base.heldout_residual, base.problem.block))
