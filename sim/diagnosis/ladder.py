"""Effects one after another, as long as each is worth it on unseen time.

    rank → add the best → rank beside it …  then swap: choose the earlier ones again beside the
    later;  and backward: what no longer earns its place goes

The first choice is made while the second effect is still missing, and may stand in for both.

The last fit of a ladder once more, as `shadow identify` fits: its numbers are those that stay.

    moments of events, once;   then starts → noise → numbers in turn until they settle

While effects are compared, starts are taken from the measured motion and noise from a leader, the
same for all. Numbers that are told with an interval deserve starts where this model has them, and
the noise that it leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.diagnosis.fit import Fit, at_its_moment, fitted, moments_in, started, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.heldout import Gain, HeldOutScorer, gain, unseen
from sim.diagnosis.ranking import BLOCK, Ranked, Ranking, rank, renewed
from sim.diagnosis.screening import Each, Tell
from sim.effects.effect import Effect
from sim.identification.shooting import FitInputs, fit_by_shooting, residuals_of
from sim.model import Model
from sim.vessel import AddedEffect

WORTH = 0.025  # least mean log ratio of squared errors per block
SURE = 3.5  # least t of it
EVENTS = 20.0  # nats that a few blocks may win alone, where hardly any loses
LOSES = 0.2
GROUPED = 0.6  # of the nats won that a wave may lose again
NOTICED = 0.99  # of the nrmse before: what lowers it by less is no use to anyone
LATER = 0.05  # of the nats that the effects before it won: less is their form, not another effect


@dataclass(frozen=True)
class Step:
    """An effect that was added: by which ranking, and what it was worth then."""

    ranking: Ranking
    chosen: Ranked


@dataclass(frozen=True)
class Climb:
    """From the re-fitted base upwards: a fit for each effect more, and how each was chosen.

    first   the whole catalogue beside the bare base
    """

    base: Fit
    fits: tuple[Fit, ...]
    steps: tuple[Step, ...]
    first: Ranking

    @property
    def fit(self) -> Fit:
        """The best."""
        return self.fits[-1] if self.fits else self.base


def missed(effect: Effect, g: Gain) -> bool:
    """Whether an effect is worth so much that it would be missed.

    Waves come in groups that no single frequency follows for long: they are believed even where
    one loses now and then.
    """
    wave = effect.partial and g.nats > EVENTS and g.lost < GROUPED
    return wave or worth_it(g)


def worth_it(g: Gain) -> bool:
    """Large enough to matter, and in most blocks; or in few blocks alone, but there beyond doubt.

    What shows only when the boat brakes is told by the two or three blocks in which it does.
    """
    return (g.log > WORTH and g.t > SURE) or (g.nats > EVENTS and g.lost < LOSES)


@dataclass(frozen=True)
class Climber:
    """What all steps share."""

    wide: SupersetModel
    effects: tuple[Effect, ...]
    most: int
    tell: Tell
    each: Each
    judge: HeldOutScorer

    def climb(self, base: Fit) -> Climb:
        """Greedy, then swapped, then backward."""
        steps: list[Step] = []
        fit = base
        ranking, more = self.ranked(base, steps)
        first = ranking
        while more and len(steps) < self.most:
            steps.append(Step(ranking, ranking.best))
            fit = ranking.best.fit
            if len(steps) > 1:
                steps, fit = self.swapped(steps, fit)
            if len(steps) == self.most or not self.beyond(fit):
                break
            ranking, more = self.ranked(fit, steps)
        steps, fit = self.backward(steps, fit)
        if steps:
            self.tell("the numbers, and how sure they are")
            last = polished(fit)
            if not self.helps(last, fit):  # a hull far from the model may run away from it
                fit = last
        found = fit.found()
        before = [self.rung(found[:k], steps, fit) for k in range(1, len(found))]
        return Climb(base, (*before, fit) if found else (), tuple(steps), first)

    def rung(self, added: Sequence[AddedEffect], steps: Sequence[Step], last: Fit) -> Fit:
        """The first effects alone: as they were chosen, where they were chosen one by one."""
        names = tuple(a.effect.name for a in added)
        chosen = (step.chosen.fit for step in steps if step.chosen.fit.names == names)
        return next(chosen, None) or self.beside(added, last)

    def ranked(self, fit: Fit, steps: Sequence[Step]) -> tuple[Ranking, bool]:
        """What could come next, led by the first that should; whether there is one.

        The best may be worth much and yet help nobody, as long as a larger error hides what it
        does: then that one is first in turn.
        """
        ranking = self.rank(fit)
        row = next((r for r in ranking.finalists if self.justified(r, steps, fit)), None)
        return (ranking, False) if row is None else (ranking.led_by(row), True)

    def justified(self, row: Ranked, steps: Sequence[Step], fit: Fit) -> bool:
        """Whether one of a ranking should be added to what was found so far."""
        won = sum(step.chosen.gain.nats for step in steps)
        least = max(LATER * won, EVENTS if steps else 0.0)
        enough = missed(row.effect, row.gain) and row.gain.nats >= least
        return enough and self.helps(fit, row.fit)

    def helps(self, before: Fit, after: Fit) -> bool:
        """Whether predictions become better by more than nobody would notice."""
        return self.judge.fitted(after).nrmse < NOTICED * self.judge.fitted(before).nrmse

    def rank(self, fit: Fit) -> Ranking:
        """What could come next."""
        there = fit.names
        self.tell("looking for " + ("more beside " + ", ".join(there) if there else "effects"))
        return rank(self.wide, self.model(fit), self.beyond(fit), fit, self.tell, self.each)

    def beyond(self, fit: Fit) -> list[Effect]:
        """The effects that a fit does not hold."""
        return [e for e in self.effects if e.name not in fit.names]

    def model(self, fit: Fit) -> Model:
        """The vessel as fitted, on the first trial."""
        return replace(fit.unknowns.model, theta=fit.unknowns.theta(fit.z[None], 0)[0])

    def swapped(self, steps: list[Step], fit: Fit) -> tuple[list[Step], Fit]:
        """The earlier effects chosen again beside the last one."""
        last = steps[-1]
        for i in range(len(steps) - 1):
            kept = [a for k, a in enumerate(fit.found()) if k != i]
            ranking = self.rank(self.beside(kept, fit))
            best = ranking.best
            if best.name != steps[i].chosen.name and worth_it(self.over(best.fit, fit)):
                self.tell(f"{best.name} in the place of {steps[i].chosen.name}")
                steps = [s for k, s in enumerate(steps) if k != i][:-1]
                return [*steps, last, Step(ranking, best)], best.fit
        return steps, fit

    def backward(self, steps: list[Step], fit: Fit) -> tuple[list[Step], Fit]:
        """Without each effect in turn: one that is not missed goes."""
        while len(steps) > 1:
            added = fit.found()
            for i in range(len(added)):
                without = self.beside([a for k, a in enumerate(added) if k != i], fit)
                if not missed(added[i].effect, self.over(fit, without)):
                    self.tell(f"{added[i].effect.name} no longer earns its place")
                    name = added[i].effect.name
                    steps = [s for s in steps if s.chosen.name != name]
                    fit = without
                    break
            else:
                break
        return steps, fit

    def beside(self, added: Sequence[AddedEffect], like: Fit) -> Fit:
        """The base with these effects, fitted under the noise that `like` leaves."""
        ground = renewed(like, like.unknowns, like.z)
        unknowns = unknowns_for(self.wide, added, len(ground.trials), ground.settings)
        return fitted(added, unknowns, ground, started(unknowns, like))

    def over(self, fit: Fit, other: Fit) -> Gain:
        """What one fit is worth over another, under the noise that the first leaves."""
        ground = renewed(fit, fit.unknowns, fit.z)
        one, two = (fitted(f.added, f.unknowns, ground, f.z) for f in (other, fit))
        return gain(unseen(one), unseen(two), ground.block)


def polished(fit: Fit) -> Fit:
    """The same effects with their last numbers; the ground is that of the new fit."""
    for name in moments_in(fit):
        fit = at_its_moment(fit, name)
    ground, unknowns = fit.ground, fit.unknowns
    trials, settings = ground.trials, ground.settings
    last = replace(settings, horizons=settings.horizons[-1:])
    shot = fit_by_shooting(FitInputs(unknowns, trials, last), fit.z)
    own = FitProblem.of(
        ground.vessel, trials, unknowns, shot.z, shot.noise, settings, BLOCK, shot.tracks
    )
    return Fit(
        fit.added, unknowns, own, shot.z, residuals_of(unknowns, own.windows, shot.z[None])[0]
    )
