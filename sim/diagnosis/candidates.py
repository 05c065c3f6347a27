"""What could be added to a fit of effects, and what that is worth: candidates, ranked and judged.

`sim.diagnosis.ladder` decides with these what is added, and in which order.
"""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, fit_effects, may_join, start_values, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.generality import doubt_of
from sim.diagnosis.heldout import (
    Gain,
    HeldOutScorer,
    RankedEffect,
    Ranking,
    gain_under,
    rank,
    ranked_over,
)
from sim.diagnosis.screening import Mapper
from sim.diagnosis.worth import helps, is_missed
from sim.effects.effect import Effect
from sim.state import Progress
from sim.vessel import AddedEffect


@dataclass(frozen=True)
class CandidateSearch:
    """The catalogue of one diagnosis, how many effects may be added, and what scores them.

    unshown effects that these trials cannot show: never added, but they may do as well
    """

    superset: SupersetModel
    effects: tuple[Effect, ...]
    most: int
    progress: Progress
    mapper: Mapper
    scorer: HeldOutScorer
    unshown: tuple[Effect, ...] = ()

    def _is_above_noise(self, fit: Fit) -> bool:
        """Whether more is left than a complete model leaves."""
        scorer = self.scorer.shared_with(fit)
        return scorer.score_fit(fit).nrmse > thresholds.MAX_FLOORS * scorer.noise_floor

    @property
    def _weather(self) -> tuple[set[str], set[str]]:
        """Changes of water and wind; and these with the steady cases that they hold as a whole."""
        changes = {e.name: e.contains for e in self.effects if e.contains}
        return set(changes), {*changes, *changes.values()}

    def _led_by(
        self, fit: Fit, before: Sequence[AddedEffect], added: AddedEffect, promising: Sequence[str]
    ) -> Ranking:
        """A ranking beside some effects of a fit that is led by another of its effects, as it is
        there, with what else is promising.
        """
        reference, after = self._beside(before, fit), self._beside([*before, added], fit)
        ranking = self.rank(reference, among={added.effect.name, *promising})
        own = fit_effects(after.added, after.unknowns, ranking.reference.problem, after.z)
        row = ranked_over(ranking.reference, own)
        others = (r for r in ranking.finalists if r.name != row.name)
        return replace(ranking, finalists=(row, *others))

    def ranked(self, fit: Fit, steps: Sequence[Ranking]) -> tuple[Ranking, bool]:
        """What could come next, led by the first that should; whether there is one.

        The best may be worth much and yet improve no prediction, as long as a larger error hides
        what it does: then that one is first in turn. Where none should come and the error stands
        far above the noise, the promising ones are looked at closer.
        """
        ranking = self.rank(fit)
        row = self._first_justified(ranking, steps, fit)
        more = any(e.more_starts for e in self._others(fit))
        if row is None and more and self._is_above_noise(fit):
            ranking = self.rank(fit, closer=True, among={r.name for r in ranking.finalists})
            row = self._first_justified(ranking, steps, fit)
        return (ranking, False) if row is None else (ranking.led_by(row), True)

    def _first_justified(
        self, ranking: Ranking, steps: Sequence[Ranking], fit: Fit
    ) -> RankedEffect | None:
        worth = (r for r in ranking.finalists if self.justified(r, steps, fit))
        return next((r for r in worth if self.is_believed(r, ranking.reference)), None)

    def justified(self, row: RankedEffect, steps: Sequence[Ranking], fit: Fit) -> bool:
        """Whether one of a ranking should be added to what was found so far."""
        least = thresholds.MIN_NATS_IN_FEW_BLOCKS if steps else 0.0
        if not is_missed(row.effect, row.gain) or row.gain.nats < least:
            return False
        won = sum(step.best.gain.nats for step in steps)
        is_more_than_form = row.gain.nats >= thresholds.MIN_SHARE_OF_EARLIER * won
        return self.helps(fit, row.fit) and (is_more_than_form or self._is_large(fit, row.fit))

    def _is_large(self, before: Fit, after: Fit) -> bool:
        """Whether an effect takes away more of the error on unseen time than the form of earlier
        effects leaves: who has found a strong current has not yet found a small offset.
        """
        scorer = self.scorer.shared_with(after)
        error, left = (scorer.score_fit(fit).nrmse for fit in (before, after))
        above = scorer.given**2 - scorer.noise_floor**2
        return error**2 - left**2 > thresholds.MIN_SHARE_OF_BASE_ERROR * above

    def helps(self, before: Fit, after: Fit) -> bool:
        """Whether predictions become noticeably better."""
        return helps(self.scorer, [before], after)

    def is_believed(self, row: RankedEffect, reference: Fit) -> bool:
        """Whether nothing speaks against one of a ranking being true beyond these data."""
        return not doubt_of(row, reference, self.scorer)

    def rank(
        self, fit: Fit, closer: bool = False, among: Container[str] | None = None,
        present: Fit | None = None,
    ) -> Ranking:  # fmt: skip
        """What could come next, of the whole catalogue or `among` these effects; `closer`: and
        among those that declare further starts; `present`: see `screen`.
        """
        beside = ", ".join(fit.names)
        self.progress(f"looking for {f'more beside {beside}' if beside else 'effects'}")
        others = self._others(fit)
        if among is not None:
            others = [e for e in others if e.name in among or (closer and e.more_starts)]
        return rank(
            self.superset, fit.model(), others, fit, self.progress, self.mapper, closer,
            present=present,
        )  # fmt: skip

    def _others(self, fit: Fit) -> list[Effect]:
        """The effects that may stand beside those of a fit."""
        return [e for e in self.effects if may_join(e, fit.added)]

    def in_place_of(self, fit: Fit, at: Container[int], among: Container[str] | None) -> Ranking:
        """What could stand where these effects of a fit stand, by place, beside the others."""
        return self.rank(self._without(fit, at), among=among)

    def _without(self, fit: Fit, at: Container[int]) -> Fit:
        """A fit of all effects of another but those at these places."""
        return self._beside([a for i, a in enumerate(fit.effects()) if i not in at], fit)

    def _beside(
        self, added: Sequence[AddedEffect], like: Fit, problem: FitProblem | None = None
    ) -> Fit:
        """The base with these effects, from where `like` ended; under the noise that it leaves."""
        problem = problem or like.renewed_problem
        unknowns = unknowns_for(self.superset, added, len(problem.trials), problem.settings)
        return fit_effects(added, unknowns, problem, start_values(unknowns, like))

    def _gain_over(self, fit: Fit, other: Fit) -> Gain:
        """What one fit is worth over another, under the noise that the first leaves."""
        return gain_under(fit.renewed_problem, other, fit, self.mapper)

    def _special_of(self, fit: Fit, step: Ranking, special: Effect) -> Fit | None:
        """A fit with the special case from where the general effect of a step ended; None where the
        two do not share their numbers.
        """
        added = list(fit.effects())
        i = fit.names.index(step.best.name)
        names = {p.name for p in special.parameters}
        values = {name: x for name, x in added[i].values.items() if name in names}
        if len(values) < len(names):
            return None
        added[i] = AddedEffect(special, values)
        return self._beside(added, fit, step.best.fit.problem)  # as all of its ranking
