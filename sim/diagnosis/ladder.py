"""The search for effects: one after another, as long as each is worth it on held-out time.

    rank → add the best → rank beside it …  then swap: choose the earlier ones again beside the
    later;  and backward: what no longer earns its place goes, and the others are chosen again;
    at last the final fit

The first choice is made while the second effect is still missing, and may stand in for both. The
final fit is as `shadow identify` fits: moments of events once, then starts → noise → numbers in
turn until they settle. While effects are compared, starts are taken from the measured motion and
noise from a leader, the same for all; numbers with an interval deserve starts where this model has
them, and the noise that it leaves.

**Generality**: is an effect that was found true of the boat, or of these recordings only?

    on recordings   each left out in turn: squared errors there, without and with the effect
    on headings     nats won on unseen time by the sector of the heading that they were won in

Blocks of one recording share its day. A compass that is turned, iron on board, a current and a hull
that is not alike on both sides push the boat to the same side as long as it sails one way: what is
true of the boat has to win on opposite headings too.
"""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.feedback import NOT_BEFORE_MOTION, acts_before_motion
from sim.diagnosis.fit import (
    Fit,
    event_names,
    fit_effects,
    start_values,
    unknowns_for,
    with_event_moved,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.heldout import (
    Gain,
    HeldOutScorer,
    RankedEffect,
    Ranking,
    gain,
    gain_on_recordings,
    nats_won,
    rank,
)
from sim.diagnosis.screening import Mapper, Progress
from sim.effects.effect import Effect, Scope, Shown
from sim.identification.shooting import FitInputs, fit_by_shooting
from sim.state import Eta, Floats
from sim.vessel import AddedEffect

WIDTH_DEG = 360 // thresholds.HEADING_SECTORS
OF_HEADING = {Shown.OPPOSITE, Shown.CIRCLES}


def doubt_of(row: RankedEffect, reference: Fit, scorer: HeldOutScorer) -> str:
    """Why a ranked effect is not believed of the boat, in words; empty where it is.

    `reference` is that of its ranking. What is of a day is learnt on each day anew.
    """
    if row.effect.scope is not Scope.BOAT:
        return ""
    if not _wins_on_recordings(row, reference, scorer):
        return "it wins nothing on recordings that the fit did not see: it is not alike on all"
    seen = _sectors_where_it_counts(row, reference)
    if seen is not None and not _opposite(seen):
        return f"it was seen on headings from {in_words(seen)} alone: sail opposite headings"
    if Shown.COMMANDS in row.effect.shown_by and not acts_before_motion(reference, row.fit):
        return NOT_BEFORE_MOTION
    return ""


def unseen_headings(row: RankedEffect, reference: Fit) -> str:
    """On which headings an effect was seen, in words, where they are few; else empty."""
    seen = _sectors_where_it_counts(row, reference)
    if seen is None or len(seen) >= thresholds.MIN_SECTORS_FOR_CIRCLES:
        return ""
    return f"{row.name} was seen on headings from {in_words(seen)} alone"


def _sectors_where_it_counts(row: RankedEffect, reference: Fit) -> list[int] | None:
    """`seen_sectors` of what is of the boat and shown by headings; None of all else."""
    if row.effect.scope is not Scope.BOAT or not OF_HEADING & set(row.effect.shown_by):
        return None
    return seen_sectors(row, reference)


def seen_sectors(row: RankedEffect, reference: Fit) -> list[int]:
    """Numbers of the sectors, from north, that a noticeable share of the gain was won in."""
    before, after = reference.heldout_residual, row.fit.heldout_residual
    sector = (_headings(row.fit) % (2.0 * np.pi) // np.radians(WIDTH_DEG)).astype(np.int64)
    won = np.bincount(sector, nats_won(before, after), thresholds.HEADING_SECTORS)
    least = thresholds.MIN_SEEN_SECTOR_SHARE * np.maximum(won, 0.0).sum()
    return [int(i) for i in np.flatnonzero(won > least)]


def in_words(sectors: list[int]) -> str:
    """Sectors as ranges of degrees, neighbours as one; not all of them."""
    count, parts = thresholds.HEADING_SECTORS, []
    for begin in (i for i in sectors if (i - 1) % count not in sectors):
        width = next(n for n in range(1, count) if (begin + n) % count not in sectors)
        parts.append(f"{WIDTH_DEG * begin}° to {WIDTH_DEG * (begin + width) % 360}°")
    return " and ".join(parts)


def _wins_on_recordings(row: RankedEffect, reference: Fit, scorer: HeldOutScorer) -> bool:
    """Of fewer than `MIN_RECORDINGS` nothing is known, and nothing held against it."""
    g = gain_on_recordings(reference, row.fit)
    if g is None:
        return True
    before, after = scorer.score_recordings(reference), scorer.score_recordings(row.fit)
    falls = before is None or after is None or after.nrmse < before.nrmse
    return falls and g.nats > thresholds.MIN_NATS_ON_RECORDINGS


def _opposite(sectors: list[int]) -> bool:
    """Whether two of them lie far enough apart."""
    count = thresholds.HEADING_SECTORS
    apart = [min((a - b) % count, (b - a) % count) for a in sectors for b in sectors]
    return max(apart, default=0) >= thresholds.MIN_SECTORS_APART


def _headings(fit: Fit) -> Floats:
    """Heading [rad] at the begin of the run of each residual (N,)."""
    places = fit.problem.places
    out = np.empty(len(places.begin))
    for i, trial in enumerate(fit.problem.trials):
        mine = places.trial == i
        at = np.searchsorted(trial.time, places.begin[mine]).clip(max=len(trial.time) - 1)
        out[mine] = trial.eta[at, Eta.YAW]
    return out


@dataclass(frozen=True)
class Selection:
    """From the re-fitted base upwards: a fit for each effect more, and how each was chosen.

    steps   for each effect that was added the ranking that it leads, with what it was worth then
    first   the whole catalogue beside the bare base
    """

    base: Fit
    fits: tuple[Fit, ...]
    steps: tuple[Ranking, ...]
    first: Ranking

    @property
    def fit(self) -> Fit:
        """The best."""
        return self.fits[-1] if self.fits else self.base


def is_missed(effect: Effect, g: Gain) -> bool:
    """Whether an effect is worth so much that it would be missed.

    Waves come in groups that no single frequency follows for long: they are believed even where
    one loses now and then.
    """
    enough = g.nats > thresholds.MIN_NATS_IN_FEW_BLOCKS
    return (effect.partial and enough and g.lost < thresholds.MAX_LOST_PARTIAL) or is_worth_it(g)


def is_worth_it(g: Gain) -> bool:
    """Large enough to matter, and in most blocks; or in few blocks alone, but there beyond doubt.

    What shows only when the boat brakes is told by the two or three blocks in which it does.
    """
    large = g.log_ratio > thresholds.MIN_LOG_RATIO_PER_BLOCK
    enough = g.nats > thresholds.MIN_NATS_IN_FEW_BLOCKS
    in_most, in_few = g.t > thresholds.MIN_T_OVER_BLOCKS, g.lost < thresholds.MAX_LOST
    return (large and in_most) or (enough and in_few)


def is_at_floor(noise_share: Sequence[float]) -> bool:
    """Whether no more is left in u, v, r than the recordings state as noise (`Fit.noise_share`)."""
    return max(noise_share) < thresholds.MAX_NOISE_SHARE


def helps(scorer: HeldOutScorer, before: Fit, after: Fit, given: float) -> bool:
    """Whether predictions of unseen time become noticeably better, also than as `given`; at the
    noise floor more is asked.
    """
    best = min(scorer.score_fit(before).nrmse, given)
    at_floor = is_at_floor(before.noise_share) or best <= scorer.noise_floor
    ratio = thresholds.MAX_NRMSE_RATIO_AT_FLOOR if at_floor else thresholds.MAX_NRMSE_RATIO
    return scorer.score_fit(after).nrmse < ratio * best


@dataclass(frozen=True)
class EffectSearch:
    """The catalogue of one diagnosis, how many effects may be added, and what scores them.

    given   error on unseen time of the vessel as it was given: no effect may leave more
    unshown effects that these trials cannot show: never added, but they may do as well
    """

    superset: SupersetModel
    effects: tuple[Effect, ...]
    most: int
    progress: Progress
    mapper: Mapper
    scorer: HeldOutScorer
    given: float
    unshown: tuple[Effect, ...] = ()

    def run(self, base: Fit) -> Selection:
        """Greedy, then swapped, then backward."""
        steps: list[Ranking] = []
        fit = base
        first, more = self.ranked(base, steps)
        ranking = first
        while more and len(steps) < self.most:
            steps.append(ranking)
            fit = ranking.best.fit
            if len(steps) > 1:
                steps, fit = self._swapped(steps, fit)
            if len(steps) == self.most or not self._others(fit):
                break
            ranking, more = self.ranked(fit, steps)
        fewer, fit = self._backward(steps, fit)
        if 1 < len(fewer) < len(steps):  # what went may have kept another from its place
            fewer, fit = self._swapped(fewer, fit, last=True)
        steps = fewer
        if not steps or not self.helps(base, fit):
            return Selection(base, (), (), first)
        self.progress("the numbers, and how sure they are")
        last = final_fit(fit)
        if not self.helps(last, fit):  # a hull far from the model may run away from it
            fit = last
        effects = fit.effects()
        earlier = [self._with_first(effects[:k], steps, fit) for k in range(1, len(effects))]
        return Selection(base, (*earlier, fit), tuple(steps), first)

    def _with_first(self, added: Sequence[AddedEffect], steps: Sequence[Ranking], last: Fit) -> Fit:
        """The first effects alone: as they were chosen, where they were chosen one by one."""
        names = tuple(a.effect.name for a in added)
        chosen = (step.best.fit for step in steps if step.best.fit.names == names)
        return next(chosen, None) or self._beside(added, last)

    def ranked(self, fit: Fit, steps: Sequence[Ranking]) -> tuple[Ranking, bool]:
        """What could come next, led by the first that should; whether there is one.

        The best may be worth much and yet improve no prediction, as long as a larger error hides
        what it does: then that one is first in turn. Where none should come and the error stands
        far above the noise, the promising ones are looked at closer.
        """
        ranking = self.rank(fit)
        row = self._first_justified(ranking, steps, fit)
        far = self.scorer.score_fit(fit).nrmse > thresholds.MAX_FLOORS * self.scorer.noise_floor
        if row is None and far and any(e.more_starts for e in self._others(fit)):
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
        error, left = (self.scorer.score_fit(fit).nrmse for fit in (before, after))
        above = self.given**2 - self.scorer.noise_floor**2
        return error**2 - left**2 > thresholds.MIN_SHARE_OF_BASE_ERROR * above

    def helps(self, before: Fit, after: Fit) -> bool:
        """Whether predictions become noticeably better."""
        return helps(self.scorer, before, after, self.given)

    def is_believed(self, row: RankedEffect, reference: Fit) -> bool:
        """Whether nothing speaks against one of a ranking being true beyond these data."""
        return not doubt_of(row, reference, self.scorer)

    def rank(self, fit: Fit, closer: bool = False, among: Container[str] | None = None) -> Ranking:
        """What could come next, of the whole catalogue or `among` these effects; `closer`: and
        among those that declare further starts.
        """
        beside = ", ".join(fit.names)
        self.progress(f"looking for {f'more beside {beside}' if beside else 'effects'}")
        others = self._others(fit)
        if among is not None:
            others = [e for e in others if e.name in among or (closer and e.more_starts)]
        return rank(self.superset, fit.model(), others, fit, self.progress, self.mapper, closer)

    def beside_unshown(self, step: Ranking) -> Ranking:
        """The best of a step among those of its look-alikes that these trials cannot show.

        Where such a one does as well, on few headings say, the best is not established.
        """
        best = step.best.effect
        alike = [e for e in self.unshown if best.looks_like_effect(e)]
        if not alike:
            return replace(step, finalists=(step.best,))
        self.progress(f"whether {best.name} is told from {', '.join(e.name for e in alike)}")
        fit = step.reference
        found = rank(self.superset, fit.model(), [best, *alike], fit, mapper=self.mapper)
        row = next((r for r in found.finalists if r.name == best.name), None)
        return replace(step, finalists=(step.best,)) if row is None else found.led_by(row)

    def _others(self, fit: Fit) -> list[Effect]:
        """The effects that a fit does not hold, whole or as a part of another."""
        inside = {a.effect.contains for a in fit.added}
        return [
            e for e in self.effects
            if e.name not in fit.names and e.name not in inside and e.contains not in fit.names
        ]  # fmt: skip

    def _swapped(
        self, steps: list[Ranking], fit: Fit, last: bool = False
    ) -> tuple[list[Ranking], Fit]:
        """The earlier effects, or the `last` one too, chosen again beside the others.

        Until none gives way; each that does is worth it, so that no two take turns for ever.
        """
        for _ in range(thresholds.MAX_SWAPS):
            swap = next(self._swaps(steps, fit, last), None)
            if swap is None:
                break
            steps, fit = swap
        return steps, fit

    def _swaps(
        self, steps: list[Ranking], fit: Fit, last: bool
    ) -> Iterator[tuple[list[Ranking], Fit]]:
        """What is worth more in the place of one of the effects, each when asked.

        Of what promised enough at one of the steps to be fitted whole: the whole catalogue for each
        would take most of the time of a long ladder. At the last it is the whole catalogue.
        """
        promising = None if last else {row.name for step in steps for row in step.finalists}
        for i, step in enumerate(steps if last else steps[:-1]):
            kept = [a for k, a in enumerate(fit.effects()) if k != i]
            ranking = self.rank(self._beside(kept, fit), among=promising)
            ranking = ranking if ranking.finalists else step
            best, old = ranking.best, step.best.name
            better = best.name != old and is_worth_it(self._gain_over(best.fit, fit))
            if better and self.is_believed(best, ranking.reference):
                self.progress(f"{best.name} in the place of {old}")
                yield [*(s for k, s in enumerate(steps) if k != i), ranking], best.fit

    def _backward(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """Without each effect in turn: one that is not missed goes."""
        while len(steps) > 1:
            added = fit.effects()
            for i, a in enumerate(added):
                without = self._beside([b for k, b in enumerate(added) if k != i], fit)
                if not is_missed(a.effect, self._gain_over(fit, without)):
                    self.progress(f"{a.effect.name} no longer earns its place")
                    steps = [s for s in steps if s.best.name != a.effect.name]
                    fit = without
                    break
            else:
                break
        return steps, fit

    def _beside(self, added: Sequence[AddedEffect], like: Fit) -> Fit:
        """The base with these effects, fitted under the noise that `like` leaves."""
        problem = like.renewed_problem
        unknowns = unknowns_for(self.superset, added, len(problem.trials), problem.settings)
        return fit_effects(added, unknowns, problem, start_values(unknowns, like))

    def _gain_over(self, fit: Fit, other: Fit) -> Gain:
        """What one fit is worth over another, under the noise that the first leaves."""
        problem = fit.renewed_problem
        before, after = (
            fit_effects(f.added, f.unknowns, problem, f.z).heldout_residual for f in (other, fit)
        )
        return gain(before, after, problem.block)


def final_fit(fit: Fit) -> Fit:
    """The same effects with their last numbers; the problem is that of the new fit."""
    for name in event_names(fit):
        fit = with_event_moved(fit, name)
    problem, unknowns = fit.problem, fit.unknowns
    trials, settings = problem.trials, problem.settings
    last = replace(settings, horizons=settings.horizons[-1:])
    shot = fit_by_shooting(FitInputs(unknowns, trials, last), fit.z)
    own = FitProblem.of(problem.vessel, trials, unknowns, shot.z, shot.noise, settings, shot.tracks)
    final = replace(fit, problem=own, z=shot.z)
    return replace(final, residual=final.at(shot.z[None])[0])
