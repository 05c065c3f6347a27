"""What a search for effects found: the ladder, scored on unseen time, its rivals, what is left.

And the reasons there may be to doubt it: what is left is more than noise, sensors contradict one
another, numbers were found that no boat has.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from sim.diagnosis import thresholds
from sim.diagnosis.answer import LadderStep, StepBase, falling
from sim.diagnosis.free_curve import FreeCurve
from sim.diagnosis.heldout import HeldOutScorer, RankedEffect
from sim.diagnosis.ladder import EffectSearch, Selection
from sim.diagnosis.limits import strain_of
from sim.diagnosis.more_room import numbers_at_limit
from sim.diagnosis.residual_terms import Dependence
from sim.diagnosis.rivals import all_rivals_of
from sim.diagnosis.verdict import (
    is_above_noise,
    is_above_stated,
    remaining_dependences,
    rivals_of,
)
from sim.diagnosis.worth import is_at_floor
from sim.model import Model
from sim.prediction.free_runs import shown_floor
from sim.trial import Trial


@dataclass(frozen=True)
class Findings:
    """A selection of effects, scored.

    ladder  the vessel as given, its base, then effect by effect
    floor   what noise alone leaves of free runs on these trials [nrmse]
    alone   each of the effects that came closest at first, by itself
    rivals  of each step of the selection, the effects that did as well
    later   steps with these in their place
    """

    selection: Selection
    ladder: tuple[LadderStep, ...]
    floor: float
    alone: tuple[LadderStep, ...]
    rivals: tuple[Sequence[RankedEffect], ...]
    later: tuple[LadderStep, ...]

    @classmethod
    def of(
        cls, selection: Selection, search: EffectSearch, plain: Model, trials: Sequence[Trial]
    ) -> "Findings":
        """Of a search from a plain vessel; `search.scorer` is that of the selection."""
        scorer = search.scorer
        ladder, floor = _ladder_of(selection, scorer, plain, trials), scorer.noise_floor
        rivals = tuple(all_rivals_of(step, search, selection) for step in selection.steps)
        at_first = {row.name for row in selection.first.finalists}
        later = tuple(
            LadderStep.of(row.fit, scorer)
            for step, of in zip(selection.steps, rivals, strict=True)
            for row in of
            if step is not selection.first or row.name not in at_first
        )
        alone = tuple(LadderStep.of(row.fit, scorer) for row in selection.first.finalists)
        return cls(selection, ladder, floor, alone, rivals, later)

    @property
    def base(self) -> LadderStep:
        """The step of the base alone."""
        return self.ladder[1]

    @property
    def last(self) -> LadderStep:
        """The step with all that was found."""
        return self.ladder[-1]

    @property
    def is_above(self) -> bool:
        """Whether more is left than noise may leave."""
        return self.last.heldout.nrmse > thresholds.MAX_FLOORS * self.floor

    @property
    def is_predicted(self) -> bool:
        """Whether effects were found, and no more than noise is left beside them."""
        return bool(self.selection.fits) and self.last.heldout.nrmse <= self.floor

    @cached_property
    def left(self) -> tuple[Dependence, ...]:
        """What the rest depends on; nothing where it is predicted, or no more than noise."""
        whole = is_at_floor(self.selection.fit.noise_share) and not self.is_above
        if self.is_predicted or whole:
            return ()
        return tuple(remaining_dependences(self.selection, self.is_above))

    @property
    def rivals_of_first(self) -> list[str]:
        """Names of the effects that did as well as the first of the ranking."""
        steps, first = self.selection.steps, self.selection.first
        led = bool(steps) and steps[0].best is first.best
        rows = self.rivals[0] if led else rivals_of(first, self.last.effects)
        return [row.name for row in rows]

    def told_floor(self, curve: FreeCurve | None) -> float:
        """The noise floor that is told beside these errors [nrmse]."""
        steps = (*self.ladder, *((curve.step,) if curve else ()))
        return shown_floor(self.floor, [step.heldout.nrmse for step in steps])

    def not_on_the_ladder(self, steps: Iterable[LadderStep]) -> tuple[LadderStep, ...]:
        """Those of other effects than any step of the ladder has."""
        ladder = {step.effects for step in self.ladder}
        return tuple(step for step in steps if step.effects not in ladder)


class Doubts(NamedTuple):
    """Why what was found may not be all.

    above           what is left is more than noise, by a wide margin, or beside numbers of the base
                    that stand at their limits (not beside a train of waves: a sea bends them)
    contradictions  of sensors: what a model of the boat leaves may be theirs
    strained        numbers of what was found that no boat has
    """

    above: bool
    contradictions: tuple[str, ...]
    strained: tuple[str, ...]

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return self.above or bool(self.contradictions) or bool(self.strained)

    @classmethod
    def of(cls, found: Findings, trials: Sequence[Trial], prior: float) -> "Doubts":
        """About what was found in these trials, with a prior of the base numbers."""
        fit, last = found.selection.fit, found.last
        effects = [a.effect for a in fit.added]
        above = is_above_noise(effects, found.ladder, found.floor, fit.noise_share)
        above = above or is_above_stated(effects, fit.noise_share)
        at_limit = found.is_above and bool(numbers_at_limit(last, prior))
        above = above or (at_limit and not any(e.partial for e in effects))
        new = [added for added in last.vessel.effects if added.effect.name in last.effects]
        strained = tuple(strain for a in new if (strain := strain_of(a, last.vessel)))
        contradictions = tuple(dict.fromkeys(said for t in trials for said in t.contradictions))
        return cls(above, contradictions, strained)


def _ladder_of(
    selection: Selection, scorer: HeldOutScorer, plain: Model, trials: Sequence[Trial]
) -> tuple[LadderStep, ...]:
    """The vessel as given, its base where that predicts better re-fitted, and what was added."""
    given = LadderStep((), StepBase.PLAIN, scorer.score_model(plain), (), {}, plain.vessel)
    if len(trials) >= thresholds.MIN_RECORDINGS:
        given = replace(given, left_out=given.heldout)
    fits = (selection.base, *selection.fits)
    refitted, *added = (LadderStep.of(fit, scorer).with_left_out(fit, scorer) for fit in fits)
    base = refitted if _predicts_better(refitted, given) else replace(given, base=StepBase.KEPT)
    return falling([given, base, *added])


def _predicts_better(fitted: LadderStep, given: LadderStep) -> bool:
    """Whether re-fitted numbers predict unseen time, and recordings left out, better than as given.

    Numbers that suit the recordings they were fitted to and no other are not kept.
    """
    pairs = ((fitted.heldout, given.heldout), (fitted.left_out, given.left_out))
    return all(a.nrmse < b.nrmse for a, b in pairs if a is not None and b is not None)
