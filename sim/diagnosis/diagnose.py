"""Which physical effect is missing: the whole path, from trials and a vessel to an answer.

re-fit the base → search for effects → score each step on held-out time → what is left → verdict
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.answer import Diagnosis, StepBase, Verdict, candidates_of
from sim.diagnosis.feedback import said_of_times, times_of, with_times_one_step
from sim.diagnosis.findings import Doubts, Findings
from sim.diagnosis.fit import Fit, fit_effects, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.free_curve import FREE_FORMS, FreeCurve, find_free_curve
from sim.diagnosis.generality import doubt_of, unseen_headings
from sim.diagnosis.heldout import HeldOutScorer, RankedEffect, gain
from sim.diagnosis.in_a_sea import is_in_a_sea, not_told_in_a_sea, search_beside_waves
from sim.diagnosis.ladder import EffectSearch, Selection
from sim.diagnosis.more_room import (
    is_simpler,
    is_worth_more_room,
    numbers_at_limit,
    numbers_beyond,
)
from sim.diagnosis.next_experiment import (
    RecordingContent,
    Refusal,
    SuggestedManoeuvre,
    by_information,
    by_separation,
    refusals,
)
from sim.diagnosis.residual_terms import swing_period
from sim.diagnosis.screening import Mapper
from sim.diagnosis.verdict import (
    does_without_effects,
    is_as_stated,
    is_curve_above_form,
    is_more_than_form,
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
from sim.prediction.segments import NoUsableTimeError
from sim.state import Progress
from sim.trial import Trial
from sim.vessel import Vessel


@dataclass(frozen=True)
class DiagnoseSettings:
    """How a diagnosis is made.

    prior     relative standard deviation of the base numbers as given
    trusted   a person chose that prior: no second look that gives the base numbers more room
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
    trusted: bool = False

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
    trials = _long_enough(trials)
    first, selection, search = _diagnosed(trials, vessel, settings, progress, mapper)
    at_limit = numbers_at_limit(first.ladder[-1], settings.prior)
    if settings.trusted or settings.prior >= thresholds.GUESSED_PRIOR or not at_limit:
        return first
    if len(trials) > thresholds.MAX_RECORDINGS_LOOKED_AT_TWICE:
        return first
    progress("more room for the numbers of the file")
    wide = replace(settings, prior=thresholds.GUESSED_PRIOR)
    try:
        base = fit_base(search.superset, Model.of(vessel), trials, wide)
        if not is_worth_more_room(selection.fit, base, search):
            return first
        second, *_ = _diagnosed(trials, vessel, wide, progress, mapper)
    except (ValueError, np.linalg.LinAlgError):  # the model is lost: what is known stays
        return first
    if not is_simpler(second, first):
        return first
    note = _further_off(first, second, thresholds.MAX_BASE_SIGMAS * settings.prior)
    return replace(second, summary="; ".join(filter(None, (second.summary, note))))


def _further_off(first: Diagnosis, second: Diagnosis, share: float) -> str:
    """Which numbers are off by more than a share, and what was told while they were trusted to be
    no further off. Of those that these data do not tell nothing is said.
    """
    known = {e.name for e in second.ladder[-1].base_parameters if e.identifiable}
    names = [name for name in numbers_beyond(second.ladder[-1], share) if name in known]
    if not names:
        return ""
    verb = "is" if len(names) == 1 else "are"
    off = f"{', '.join(names)} of the file {verb} off by more than {100.0 * share:.0f} %"
    others = [name for name in first.effects if name not in second.effects]
    if others and first.verdict is not Verdict.UNKNOWN:
        return f"{off}, else {' and '.join(others)} would stand in"
    left = first.ladder[-1].heldout.nrmse
    return f"{off}: with less room for them the error was {left:.3f}"


def _diagnosed(
    trials: Sequence[Trial], vessel: Vessel, settings: DiagnoseSettings, progress: Progress,
    mapper: Mapper,
) -> tuple[Diagnosis, Selection, EffectSearch]:  # fmt: skip
    """The answer with one prior of the base numbers, and what it was found with."""
    plain = Model.of(vessel)
    content = RecordingContent.of(plain, trials)
    catalogue = settings.effects
    if len(trials) >= thresholds.MIN_RECORDINGS:  # what each has alike is the boat's
        catalogue = tuple(e.of_the_boat if e.alike else e for e in catalogue)
    effects = _effects_to_try(vessel, content, catalogue)
    progress("re-fitting the base")
    possible = [e for e in catalogue if not e.is_curve]  # one kernel, whatever the trials can show
    superset = SupersetModel.of(vessel, possible, trials)
    base = fit_base(superset, plain, trials, settings)
    search = EffectSearch(
        superset, effects.shown, settings.most, progress, mapper, HeldOutScorer.of(trials, plain),
        effects.unshown,
    )  # fmt: skip
    selection, on_times = _with_times_in_a_sea(_selected(search, base), search)
    progress("what is left")
    search = replace(search, scorer=search.scorer.shared_with(selection.fit))
    found = Findings.of(selection, search, plain, trials)
    doubts = Doubts.of(found, trials, settings.prior)
    verdict = verdict_of(selection, found.rivals, found.left, doubts.any)
    forms = _forms_to_try(vessel, content, trials, doubts)
    verdict, curve = _held_against_a_curve(verdict, vessel, search, found, forms)
    said = _in_words(verdict, search, found, doubts, curve)
    notes = [each.description for each in found.last.assumed]
    notes += [_alike(added.effect, len(trials)) for added in selection.fit.added]
    notes += [unseen_headings(step.best, step.reference) for step in selection.steps]
    notes += [on_times, *(doubts.strained if curve is not None else ())]
    steps = (*found.alone, *found.later, *((curve.step,) if curve else ()))
    diagnosis = Diagnosis(
        verdict=verdict,
        summary="; ".join((said, *filter(None, notes))),
        base_changed=found.base.base is StepBase.REFITTED and _base_changed(selection.base),
        effects=found.last.effects,
        ladder=found.ladder,
        ranking=candidates_of(selection.first, found.alone, found.rivals_of_first),
        unexplained=unexplained_share(found.ladder, found.floor),
        depends_on=found.left,
        refused=(
            *effects.refused,
            *_doubted(selection, search.scorer),
            *not_told_in_a_sea(selection, search.effects),
        ),
        noise_floor=found.told_floor(curve),
        suggested=_suggested(selection, found.rivals, settings.plan, progress),
        noise_share=selection.fit.noise_share,
        alternatives=found.not_on_the_ladder(steps),
        curve=curve.step if curve else None,
        formula=curve.formula if curve else None,
        start_time_ns=trials[0].start_time_ns if len(trials) == 1 else 0,
        prior=settings.prior,
    )
    return diagnosis, selection, search


def _alike(effect: Effect, recordings: int) -> str:
    """That what a day may bring has the same numbers on every one; empty where each has its own.

    Not that it is seen on every one: a short one alone may not tell.
    """
    if not effect.is_alike:
        return ""
    whose = f"all {recordings} recordings, as of {effect.alike}"
    return f"{effect.name} has one set of numbers for {whose}"


def _long_enough(trials: Sequence[Trial]) -> list[Trial]:
    """Those with usable time; NoUsableTimeError where that is too short in all."""
    usable = [t for t in trials if t.usable.any()]
    seconds = sum(float(t.usable.sum()) * t.dt for t in usable)
    if seconds < (needed := thresholds.MIN_USABLE_S):
        raise NoUsableTimeError(f"{seconds:.0f} s of usable time: {needed:.0f} s are needed")
    return usable


class _EffectsToTry(NamedTuple):
    """Effects that the recordings can show, and those that the vessel could have but they cannot;
    refused: why not.
    """

    shown: tuple[Effect, ...]
    unshown: tuple[Effect, ...]
    refused: Sequence[Refusal]


def _effects_to_try(
    vessel: Vessel, content: RecordingContent, catalogue: Sequence[Effect]
) -> _EffectsToTry:
    """Of the catalogue, without those that the vessel has already."""
    present = {added.effect.name for added in vessel.effects}
    effects = [e for e in catalogue if e.name not in present and not e.is_curve]
    refused = refusals(effects, content, vessel)
    names = {r.effect for r in refused}
    shown = tuple(e for e in effects if e.name not in names)
    unshown = tuple(e for e in effects if e.name in names and not vessel.unmet_needs(e))
    return _EffectsToTry(shown, unshown, refused)


def _forms_to_try(
    vessel: Vessel, content: RecordingContent, trials: Sequence[Trial], doubts: Doubts
) -> list[Effect]:
    """Free curves that the recordings can show; of many recordings none of a single voyage.

    Where sensors contradict one another a curve of the boat would be one of their errors.
    """
    short_of = {r.effect for r in refusals(FREE_FORMS, content, vessel)}
    of_a_day = len(trials) <= thresholds.MAX_RECORDINGS_OF_TABLES
    return [
        form for form in FREE_FORMS
        if form.name not in short_of and (of_a_day or form.scope is Scope.BOAT)
        and (form.observe is not None or not doubts.contradictions)
    ]  # fmt: skip


def _in_words(
    verdict: Verdict, search: EffectSearch, found: Findings, doubts: Doubts,
    curve: FreeCurve | None,
) -> str:  # fmt: skip
    """The answer in one sentence, without notes."""
    selection = found.selection
    told = found.left or doubts.contradictions or doubts.strained
    nameless = verdict is Verdict.UNKNOWN and not told and curve is None
    period = swing_period(selection.fit) if nameless else None
    small = seen_one_step_ahead(selection) if verdict is Verdict.ADEQUATE else None
    if small is not None and not search.is_believed(small, selection.first.reference):
        small = None
    return summary_of(
        verdict, found.ladder, found.rivals, found.left, found.told_floor(curve), curve, period,
        doubts.contradictions, doubts.strained, small,
        drifts=found.is_above and is_as_stated(selection.fit.noise_share),
    )  # fmt: skip


def _held_against_a_curve(
    verdict: Verdict, vessel: Vessel, search: EffectSearch, found: Findings,
    forms: Sequence[Effect],
) -> tuple[Verdict, FreeCurve | None]:  # fmt: skip
    """The verdict, and the curve of what the catalogue does not hold; else as it was, and None.

    A curve is tried in the place of all that was found, be it nothing; and where more than noise is
    left beside it.
    """
    selection, ladder, floor = found.selection, found.ladder, found.floor
    more = not is_at_floor(selection.fit.noise_share) and not found.is_predicted
    more = more or verdict is Verdict.UNKNOWN
    curve = find_free_curve(
        vessel, selection, search.scorer, search.progress, search.mapper, forms, beside=more,
    )  # fmt: skip
    if curve is None or verdict is Verdict.UNKNOWN:
        return verdict, curve
    if curve.replaces:
        beyond_form = does_without_effects(curve, selection, ladder, floor, found.is_above)
    else:
        effects = [a.effect for a in selection.fit.added]
        beyond_form = is_more_than_form(curve.gain, selection, found.is_above)
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
    how = replace(how, free=(*how.free, *own)).with_motion_of(trials)
    shot = fit_by_shooting(FitInputs(unknowns_of(plain, len(trials), how), trials, how))
    unknowns = unknowns_for(superset, [], len(trials), how)
    problem = FitProblem.of(vessel, trials, unknowns, shot.z, shot.noise, how)
    return fit_effects([], unknowns, problem, shot.z)


def _selected(search: EffectSearch, base: Fit) -> Selection:
    """The search's selection; in a sea that of a search beside the waves.

    The first look may see a sea at once. Where a larger cause hid it the end of the search does.
    """
    first, more = search.ranked(base, [])
    if not is_in_a_sea(first.best.fit if more else base):
        selection = search.run(base, first, more)
        if not is_in_a_sea(selection.fit):
            return selection
        first = selection.first
    return search_beside_waves(search, base, first)


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
    told = {row.name: Refusal(row.name, doubt, True) for row, doubt in rows if doubt}
    return list(told.values())


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
