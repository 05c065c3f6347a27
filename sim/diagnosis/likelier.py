"""What is more likely in the place of effects that were chosen, when a search is at its end.

    unlikely = nats that a fit is behind, under the noise that it leaves + one for each number

On unseen time two fits may each win under their own noise; then the gains say nothing, and these
nats decide. In the place of each effect another is fitted from where the fit stands, or from the
numbers that the missing forces give: a few steps may not lead there from a hull that was bent to go
with what stood there. Source: Akaike, IEEE Trans. Automatic Control 19, 1974.
"""

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

from sim.diagnosis import thresholds
from sim.diagnosis.candidates import CandidateSearch
from sim.diagnosis.fit import Fit, is_needed
from sim.diagnosis.fit_problem import FitProblem, nats_of
from sim.diagnosis.force_search import ForceProblem, fit_under_its_noise, in_place_by_forces
from sim.diagnosis.heldout import Ranking, is_better_than_special
from sim.diagnosis.worth import is_worth_it
from sim.effects.effect import Effect


@dataclass(frozen=True)
class LikelihoodSearch(CandidateSearch):
    """Effects chosen once more by likelihood."""

    def _likelier(
        self, first: Ranking, steps: list[Ranking], fit: Fit
    ) -> Iterator[tuple[list[Ranking], Fit]]:
        """What is more likely with another effect in the place of one, or one of two."""
        _, weather = self._weather
        weather = weather | {e.name for e in self.effects if e.general_of in weather}
        promising = _promising(first, steps)
        for i, step in enumerate(steps):
            present = step.best.effect
            others = (e for e in self.effects if e.name != present.name)
            among = {e.name for e in others if _may_stand_for(e, present, promising)}
            yield from self._likelier_at(steps, fit, {i}, among)
        for pair in combinations(range(len(steps)), 2) if len(steps) > 2 else ():
            if any(fit.names[i] in weather for i in pair):
                yield from self._likelier_at(steps, fit, set(pair), weather)

    def _likelier_at(
        self, steps: list[Ranking], fit: Fit, at: set[int], among: set[str]
    ) -> Iterator[tuple[list[Ranking], Fit]]:
        """The most likely of some effects in these places, where it is more likely and believed."""
        left = [a for i, a in enumerate(fit.added) if i not in at]
        if any(is_needed(fit.added[i].effect, left) for i in at):
            return
        self.progress(f"in the place of {' and '.join(fit.names[i] for i in sorted(at))}")
        ranking = self.in_place_of(fit, at, among)
        rows = sorted(ranking.finalists, key=lambda r: unlikely(fit.problem, r.fit))
        for row in rows:
            fewer = len(fit.z) - len(row.fit.z)
            least = 0.0 if fewer > 0 else thresholds.MIN_NATS_IN_FEW_BLOCKS
            likely = self._is_more_likely(row.fit, fit, least)
            if likely and self.is_believed(row, ranking.reference):
                kept = [step for i, step in enumerate(steps) if i not in at]
                yield [*kept, ranking.led_by(row)], row.fit
                break

    def _in_place_by_forces(
        self, first: Ranking, steps: list[Ranking], fit: Fit
    ) -> tuple[list[Ranking], Fit]:
        """Each of several effects chosen once more beside the others, from numbers that the missing
        forces give. What needs fewer numbers takes a place more easily, see `_takes_place`.
        """
        if len(steps) < 2 or not are_few(fit):
            return steps, fit
        promising = _promising(first, steps)
        problem = ForceProblem.of(self.superset, fit.problem.trials, fit.problem.settings)
        for step in list(steps):
            if is_needed(step.best.effect, fit.added):
                continue
            self.progress(f"what does as well as {step.best.name}, from the missing forces")
            fit = fit_under_its_noise(fit, fit.problem)  # as what is tried will be
            place, present = fit.names.index(step.best.name), step.best.effect
            effects = [e for e in self._others(fit) if _may_stand_for(e, present, promising)]
            found = in_place_by_forces(problem, fit, place, effects, self.mapper)
            taking = [other for other in found if self._takes_place(other, fit)]
            for other in sorted(taking, key=partial(unlikely, fit.problem)):
                *others, last = other.effects()
                ranking = self._led_by(other, others, last, sorted(promising))
                if self.is_believed(ranking.best, ranking.reference):
                    self.progress(f"{last.effect.name} in the place of {present.name}")
                    steps = [*(s for s in steps if s is not step), ranking]
                    fit = ranking.best.fit
                    break
        return steps, fit

    def _takes_place(self, other: Fit, fit: Fit) -> bool:
        """Whether another fit is worth it, and more so where it has more numbers; or is the more
        likely with no more numbers; or has two numbers fewer and does as well under the noise that
        this leaves, or better under its own, or one fewer and does better under both.
        """
        fewer = len(fit.z) - len(other.z)
        least = 0.0 if fewer else thresholds.MIN_NATS_IN_FEW_BLOCKS
        if fewer >= 0 and self._is_more_likely(other, fit, least):
            return True
        over, under = self._gain_over(other, fit), self._gain_over(fit, other)
        if is_worth_it(over) and (fewer >= 0 or under.nats <= 0.0):
            return True
        if fewer > 1 and (over.nats > 0.0 or not is_better_than_special(under)):
            return True
        return fewer == 1 and over.nats > 0.0 > under.nats

    def _is_more_likely(self, other: Fit, fit: Fit, nats: float) -> bool:
        """Whether another fit is ahead by so many nats, each under the noise that it leaves, and
        predicts as well: of two that each win under their own the gains on unseen time say nothing.
        """
        left, before = (unlikely(fit.problem, each) for each in (other, fit))
        if before - left <= nats:
            return False
        error, before = (self.scorer.score_fit(each).nrmse for each in (other, fit))
        return error <= thresholds.MAX_RIVAL_RATIO * before


def _promising(first: Ranking, steps: Sequence[Ranking]) -> set[str]:
    """What promised enough to be fitted whole, be it at the first look."""
    return {row.name for step in [first, *steps] for row in step.finalists}


def _may_stand_for(effect: Effect, present: Effect, promising: Container[str]) -> bool:
    """Whether one effect is tried in the place of another: its look-alikes and what is promising,
    but not its general forms, which the rankings have compared with it.
    """
    alike = effect.name in promising or effect.looks_like_effect(present)
    return alike and effect.general_of != present.name


def unlikely(problem: FitProblem, fit: Fit) -> float:
    """Key of the order in which fits are preferred, the most likely first, each under the noise
    that it leaves.
    """
    return nats_of(problem.deviance(fit.unknowns, fit.z)) + len(fit.z)


def are_few(fit: Fit) -> bool:
    """Whether a fit is of so few recordings that none can be left out in turn."""
    return len(fit.problem.trials) < thresholds.MIN_RECORDINGS
