"""Which physical effect is missing: the whole path, from trials and a vessel to an answer.

re-fit the base → climb the ladder of effects → judge each rung on unseen time → what is left
→ verdict
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.diagnosis.answer import Diagnosis
from sim.diagnosis.fit import Fit, fitted, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.heldout import HeldOutScorer, gain, unseen
from sim.diagnosis.identifiability import refused
from sim.diagnosis.ladder import Climb, Climber, worth_it
from sim.diagnosis.next_experiment import Suggested, informing, separating
from sim.diagnosis.ranking import BLOCK, Ranked
from sim.diagnosis.screening import Each, Tell
from sim.diagnosis.verdict import (
    STANDS,
    candidates_of,
    ladder,
    later_rivals,
    left_over,
    rivals_of,
    rungs_of,
    stands_open,
    summary_of,
    unexplained,
    verdict_of,
)
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect
from sim.identification.parameters import unknowns_of
from sim.identification.settings import BASE, IdentifySettings
from sim.identification.shooting import FitInputs, fit_by_shooting
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel

LEAST_S = 60.0  # of usable time


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
        """How the base is fitted along: near what was given, where that is a number at all."""
        given = {n: self.prior for n in BASE if getattr(vessel.dynamics, n) != 0.0}
        return IdentifySettings(horizons=self.horizons, priors=given)


def diagnose(
    trials: Sequence[Trial],
    vessel: Vessel,
    settings: DiagnoseSettings | None = None,
    tell: Tell = lambda _: None,
    each: Each = map,
) -> Diagnosis:
    """What is missing from the vessel as these trials show it; NoUsableTimeError if too short.

    `each` maps as `map` does, perhaps on several threads.
    """
    settings = settings or DiagnoseSettings()
    trials = [t for t in trials if t.usable.any()]
    seconds = sum(float(t.usable.sum()) * t.dt for t in trials)
    if seconds < LEAST_S:
        raise NoUsableTimeError(f"{seconds:.0f} s of usable time: {LEAST_S:.0f} s are needed")
    plain = Model.of(vessel)
    there = {added.effect.name for added in vessel.effects}
    effects = [e for e in settings.effects if e.name not in there]
    no = refused(effects, plain, trials)
    effects = [e for e in effects if e.name not in {r.effect for r in no}]
    tell("re-fitting the base")
    wide = SupersetModel.of(vessel, effects)
    base = refitted(wide, plain, trials, settings)
    judge = HeldOutScorer.of(trials, plain)
    climb = Climber(wide, tuple(effects), settings.most, tell, each, judge).climb(base)
    tell("what is left")
    rungs, floor = ladder(climb, plain, judge), judge.floor
    final = rungs[-1]
    left = left_over(climb, final.heldout.nrmse > STANDS * floor)
    alone = rungs_of(climb.first.finalists, judge)
    rivals = [rivals_of(step.ranking, climb.fit.names) for step in climb.steps]
    others = (*alone, *later_rivals(climb, rivals, judge))
    added = [a.effect for a in climb.fit.added]
    verdict = verdict_of(climb, rivals, left, stands_open(added, rungs, floor))
    told = _suggested(climb, rivals, settings.plan, tell)
    ranking = candidates_of(climb.first, alone, final.effects)
    return Diagnosis(
        verdict, summary_of(verdict, rungs, rivals, left, floor), _changed(climb.base),
        final.effects, rungs, ranking, unexplained(rungs, floor), tuple(left),
        tuple(no), told[0].says if told else None, floor, final.vessel, told,
        tuple(r for r in others if r.effects not in {rung.effects for rung in rungs}),
    )  # fmt: skip


def refitted(
    wide: SupersetModel, plain: Model, trials: Sequence[Trial], settings: DiagnoseSettings
) -> Fit:
    """The base fitted without any new effect: by shooting first, then on the common ground."""
    how = settings.identify(plain.vessel)
    how = replace(how, free=(*how.free, *_own(plain.vessel)))
    shot = fit_by_shooting(FitInputs(unknowns_of(plain, len(trials), how), trials, how))
    unknowns = unknowns_for(wide, [], len(trials), how)
    ground = FitProblem.of(plain.vessel, trials, unknowns, shot.z, shot.noise, how, BLOCK)
    return fitted([], unknowns, ground, shot.z)


def _own(vessel: Vessel) -> list[str]:
    """Parameters of the effects that the vessel has already: fitted along with its base."""
    return [f"{a.effect.name}.{key}" for a in vessel.effects for key in a.effect.fit_parameters]


def _suggested(
    climb: Climb, rivals: Sequence[Sequence[Ranked]], plan: bool, tell: Tell
) -> tuple[Suggested, ...]:
    """Manoeuvres that would tell rivals apart; if asked, without rivals those that tell most."""
    for step, of in zip(climb.steps, rivals, strict=True):
        if of:
            tell("looking for the manoeuvre that separates them")
            return tuple(separating(step.chosen.fit, [r.fit for r in of]))
    if not plan:
        return ()
    tell("looking for the manoeuvre that tells most")
    return tuple(informing(climb.fit))


def _changed(base: Fit) -> bool:
    """Whether the base numbers had to move: the fit beats them as given on unseen time.

    Offsets in time are no numbers of the base: both have them.
    """
    given = [u.name in BASE for u in base.unknowns.each]
    z = np.where(given, base.unknowns.start, base.z)
    return worth_it(gain(base.at(z[None])[0], unseen(base), base.ground.block))
