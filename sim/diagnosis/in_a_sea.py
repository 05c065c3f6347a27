"""The search for effects beside waves.

A sea holds more waves than two trains follow. What the others leave swings, which noise of first
order does not, and an autopilot steers against it: over runs of several seconds the search takes
that for effects, and what is there drowns in it. Predictions from one moment to the next under the
noise that there is are efficient, and free of bias in a closed loop (Ljung, System Identification,
2nd ed. 1999, §8.4, §13.4). So in a sea the trains come first, and then all else is judged

    over the shortest runs, under the colour of what the leader of each ranking leaves of them

Neither alone does (benchmarks/results/waves.md). Free runs judge the errors as everywhere. But what
takes away most of the error of free runs comes before all: no waves do that, and a strong wind that
no model has yet is a colour of its own, under which hardly anything of it is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, event_names, fit_effects, with_event_moved
from sim.diagnosis.heldout import RankedEffect, Ranking
from sim.diagnosis.ladder import EffectSearch, Selection
from sim.diagnosis.next_experiment import Refusal
from sim.diagnosis.residual_terms import swing_period
from sim.diagnosis.worth import is_at_floor, share_left
from sim.effects.effect import Effect, Shown
from sim.identification.runs import MIN_MEANS_TIED


def is_in_a_sea(fit: Fit) -> bool:
    """Whether a fit holds a train of waves, or what it leaves swings as in a sea."""
    if any(a.effect.partial for a in fit.added):
        return True
    return not is_at_floor(fit.noise_share) and swing_period(fit) is not None


def is_too_late_to_tell(effect: Effect) -> bool:
    """Whether an effect is of velocities that come late, which the shortest runs do not tell.

    A late velocity is that of a moment before the run began, which was measured: the later, the
    more of what waves do the model is given, and the less is left of the run to err in.
    """
    return Shown.VELOCITY in effect.shown_by


def not_told_in_a_sea(selection: Selection, effects: Sequence[Effect]) -> list[Refusal]:
    """Effects of these that were not looked for beside waves, and why."""
    if not selection.fit.problem.is_coloured:
        return []
    return [
        Refusal(effect.name, "waves hide it: a run in calm water tells it")
        for effect in effects
        if is_too_late_to_tell(effect) and effect.name not in selection.fit.names
    ]


def search_beside_waves(search: EffectSearch, base: Fit, first: Ranking) -> Selection:
    """The trains of waves, then what else is there; `first`: the whole catalogue beside the base"""
    return _SeaSearch(**vars(search)).beside_waves(base, first)


@dataclass(frozen=True)
class _SeaSearch(EffectSearch):
    """From the bare base to the effects that are justified beside waves."""

    def beside_waves(self, base: Fit, first: Ranking) -> Selection:
        """What stands out of the sea, the trains, then one effect after another, then backward."""
        steps, fit = self._trains(*self._standing_out(base, first), first)
        self.progress("in a sea: from one moment to the next, under the colour of what is left")
        bare = under_own_colour(_over_shortest_runs(base))
        fit = under_own_colour(_over_shortest_runs(fit)) if steps else bare
        told = tuple(e for e in self.effects if not is_too_late_to_tell(e))
        return replace(self, effects=told).under_the_colour(bare, first, steps, fit)

    def under_the_colour(
        self, bare: Fit, first: Ranking, steps: list[Ranking], fit: Fit
    ) -> Selection:
        """What else there is beside the trains."""
        steps, fit = self._grown_and_exchanged(steps, fit, self._next(steps, fit))
        steps, fit = self._made_simpler(*self._backward(steps, fit))
        steps, fit = self._of_each_day(steps, fit)
        return self.selection(bare, first, steps, fit)

    def _standing_out(self, base: Fit, first: Ranking) -> tuple[list[Ranking], Fit]:
        """The first effect of a ranking that takes away most of the error of free runs, or none."""
        row = self._first_justified(first, [], base)
        if row is None or row.effect.partial or not self._takes_most(base, row.fit):
            return [], base
        return [first.led_by(row)], row.fit

    def _takes_most(self, before: Fit, after: Fit) -> bool:
        """Whether half is left at most of the squared error above the noise on unseen time."""
        scorer = self.scorer.shared_with(after)
        had, has = (scorer.score_fit(fit).nrmse for fit in (before, after))
        return share_left(had, has, scorer.noise_floor) < thresholds.MAX_SHARE_LEFT_IN_A_SEA

    def _trains(self, steps: list[Ranking], fit: Fit, first: Ranking) -> tuple[list[Ranking], Fit]:
        """Trains of waves beside what was found, as many as are justified."""
        names = {effect.name for effect in self.effects if effect.partial}
        for _ in names:
            seen = not steps and any(r.name in names for r in first.finalists)
            ranking = first if seen else self.rank(fit, among=names)
            trains = replace(
                ranking, finalists=tuple(r for r in ranking.finalists if r.name in names)
            )
            row = self._first_justified(trains, steps, fit)
            if row is None:
                break
            steps, fit = [*steps, ranking.led_by(row)], row.fit
        return steps, fit

    def justified(self, row: RankedEffect, steps: Sequence[Ranking], fit: Fit) -> bool:
        """As elsewhere; what was found before won its nats over longer runs, without a colour."""
        return super().justified(row, [s for s in steps if s.reference.problem.is_coloured], fit)

    def is_worse(self, before: Fit, after: Fit) -> bool:
        """As elsewhere, or unseen time in free runs: under a colour a strong wind is worth little,
        and gave way to late velocities with three times the error.
        """
        scorer = self.scorer.shared_with(after)
        had, has = (scorer.score_fit(fit).nrmse for fit in (before, after))
        return has > thresholds.MAX_RIVAL_RATIO * had or super().is_worse(before, after)

    def settled(self, base: Fit, fit: Fit) -> Fit:
        """The same effects with their last numbers, under the colour that these leave."""
        for name in event_names(fit):
            fit = with_event_moved(fit, name)
        return under_own_colour(fit)


def under_own_colour(fit: Fit) -> Fit:
    """Fit, noise and colour in turn."""
    for _ in range(thresholds.COLOUR_ROUNDS):
        problem = fit.renewed_problem.under_colour_of(fit.unknowns, fit.z)
        fit = fit_effects(fit.added, fit.unknowns, problem, fit.z)
    return fit


def _over_shortest_runs(fit: Fit) -> Fit:
    """The same numbers, over runs that are as short as those that are tied may be."""
    settings = fit.problem.settings
    shortest = replace(settings, horizons=(MIN_MEANS_TIED * settings.average,))
    return replace(fit, problem=replace(fit.problem, settings=shortest))
