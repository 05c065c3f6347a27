"""The search for effects: one after another, as long as each is worth it on held-out time.

    rank → add the best → rank beside it …  then swap: choose the earlier ones again beside the
    later;  exchange: two effects for one, or one for two;  and backward: what no longer earns its
    place goes, and the others are chosen again;  at last the final fit

The first choice is made while the second effect is still missing, and may stand in for both: a
change of current for a wind that turned while a current ran. No swap of one effect for another
leads from there to those two, or from a current and a steady wind to a wind that turned. So where
the first leaves much, and several stand out in the missing forces (`force_search`), the search
begins with these, and goes on from there as from any other beginning. Where more than noise is
left at the end, what is more likely is looked for: another effect in the place of one, or one
current or wind in the place of two. Then each is chosen once more from numbers that the forces
give, by likelihood: a few steps may not lead there from a hull that was bent to go with another
effect. The final fit is as `shadow identify` fits: moments of events once, then starts → noise →
numbers in turn until they settle. While effects are compared, starts are taken from the measured
motion and noise from a leader, the same for all; numbers with an interval deserve starts where
this model has them, and the noise that it leaves.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, final_fit, is_needed
from sim.diagnosis.force_search import ForceProblem, fit_under_its_noise, search_forces
from sim.diagnosis.heldout import RankedEffect, Ranking, is_better_than_special, rank
from sim.diagnosis.likelier import LikelihoodSearch, are_few, unlikely
from sim.diagnosis.worth import is_at_floor, is_missed, is_worse_elsewhere, is_worth_it
from sim.effects.effect import Scope
from sim.vessel import AddedEffect


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


@dataclass(frozen=True)
class EffectSearch(LikelihoodSearch):
    """From the bare base to the effects that are justified."""

    def run(self, base: Fit, first: Ranking, more: bool) -> Selection:
        """Greedy, with swaps and exchanges, then backward.

        From the first ranking, and whether its best should be added.
        """
        steps, fit = self._found(base, first, more)
        fewer, fit = self._backward(steps, fit)
        if 1 < len(fewer) < len(steps):  # what went may have kept another from its place
            fewer, fit = self._swapped(fewer, fit, last=True)
        fewer, fit = self._more_likely(first, fewer, fit)
        steps, fit = self._in_place_by_forces(first, *self._made_simpler(fewer, fit))
        steps, fit = self._of_each_day(steps, fit)
        return self.selection(base, first, steps, fit)

    def selection(self, base: Fit, first: Ranking, steps: Sequence[Ranking], fit: Fit) -> Selection:
        """What was found, with its last numbers; nothing where it does not help."""
        # one story: what took the place of the first is the first of the ranking that is told
        alone = (s for s in steps if s.reference is first.reference or not s.reference.names)
        found = (first.led_by(row) for row in first.finalists if row.name in fit.names)
        first = next(alone, None) or next(found, first)
        if not steps or not self.helps(base, fit):
            return Selection(base, (), (), first)
        self.progress("the numbers, and how sure they are")
        fit = self.settled(base, fit)
        effects = fit.effects()
        earlier = [self._with_first(effects[:k], steps, fit) for k in range(1, len(effects))]
        return Selection(base, (*earlier, fit), tuple(steps), first)

    def _found(self, base: Fit, first: Ranking, more: bool) -> tuple[list[Ranking], Fit]:
        """From what stands out in the forces where one effect leaves much and several do; else from
        the best of the first ranking, if that should be added: where others are missing what is
        there may lower no error yet.

        Not of many recordings: each has numbers of its own for what is of a day, and forces took
        three times as long as all else on eleven of them.
        """
        one = first.best.fit if more else base
        if are_few(base) and self.most > 1 and self._is_above_noise(one):
            steps = self._begun_with_forces(base)
            if steps:
                steps, fit = self._swapped(steps, steps[-1].best.fit)
                steps, fit = self._grown_and_exchanged(steps, fit, self._next(steps, fit))
                if self.helps(one, fit):
                    return steps, fit
        return self._grown_and_exchanged([], base, [first] if more and self.most else [])

    def _of_each_day(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """What was tried as the boat's, with numbers of each day where these are worth it and there
        is none of it on some: what is there on all recordings stays the boat's, for on another day
        it would be missed.
        """
        for effect in (e for e in self.effects if e.is_alike):
            held = [step for step in steps if step.best.name == effect.name]
            if not held and len(steps) >= self.most:
                continue
            self.progress(f"{effect.name} of each day")
            others = self._without(fit, {fit.names.index(effect.name)}) if held else fit
            ranking = rank(
                self.superset, others.model(), [effect.of_a_day], others, self.progress, self.mapper
            )
            if not ranking.finalists:
                continue
            row = ranking.best
            if held:
                better = is_worth_it(self._gain_over(row.fit, fit))
            else:
                better = self.justified(row, steps, fit)
            rare = better and _is_absent_on_some(row)
            if rare and self.is_believed(row, ranking.reference):
                steps, fit = [*(s for s in steps if s not in held), ranking], row.fit
                steps, fit = self._grown(steps, fit, self._next(steps, fit))
        return steps, fit

    def is_worse(self, before: Fit, after: Fit) -> bool:
        """Whether what takes the place of a fit predicts recordings left out noticeably worse."""
        return is_worse_elsewhere(self.scorer, before, after)

    def settled(self, base: Fit, fit: Fit) -> Fit:
        """The same effects with their last numbers, under the noise that these leave.

        A hull far from the model may run away with them: then as they were. But free runs of one
        that is unstable on course judge poorly where no more than noise is left from one moment to
        the next.
        """
        last = final_fit(fit)
        is_whole = is_at_floor(last.noise_share) and self.helps(base, last)
        return last if is_whole or not self.helps(last, fit) else fit

    def _grown(
        self, steps: list[Ranking], fit: Fit, more: list[Ranking]
    ) -> tuple[list[Ranking], Fit]:
        """One effect after another, beginning with the best of some rankings."""
        while more:
            steps, fit = [*steps, *more], more[-1].best.fit
            if len(steps) > 1:
                steps, fit = self._swapped(steps, fit)
            more = self._next(steps, fit)
        return steps, fit

    def _grown_and_exchanged(
        self, steps: list[Ranking], fit: Fit, more: list[Ranking]
    ) -> tuple[list[Ranking], Fit]:
        """Grown until nothing is worth adding, nor two for one or one for two."""
        steps, fit = self._grown(steps, fit, more)
        for _ in range(thresholds.MAX_EXCHANGES):
            exchanged = self._exchanged(steps, fit)
            if exchanged is None:
                break
            steps, fit = exchanged
            steps, fit = self._grown(steps, fit, self._next(steps, fit))
        return steps, fit

    def _begun_with_forces(self, base: Fit) -> list[Ranking]:
        """Where several causes stand out in the missing forces: these one beside another, how each
        was fitted; empty where fewer do, or are believed.
        """
        self.progress("several causes in the forces that are missing")
        problem = ForceProblem.of(self.superset, base.problem.trials, base.problem.settings)
        found = search_forces(problem, self.effects, self.most, self.mapper)
        if len(found.fit.added) < 2:
            return []
        fit = fit_under_its_noise(found.fit, base.problem)
        steps, added = list[Ranking](), list[AddedEffect]()
        for each in fit.effects():
            ranking = self._led_by(fit, added, each, found.promising[each.effect.name])
            if self.is_believed(ranking.best, ranking.reference):
                steps, added = [*steps, ranking], [*added, each]
        return steps if len(steps) > 1 else []

    def _next(self, steps: list[Ranking], fit: Fit) -> list[Ranking]:
        """What should come next, one effect or two; empty where none should, or no more may."""
        if len(steps) >= self.most or not self._others(fit):
            return []
        ranking, more = self.ranked(fit, steps)
        return [ranking] if more else self._next_two(ranking, steps, fit)

    def _next_two(self, ranking: Ranking, steps: list[Ranking], fit: Fit) -> list[Ranking]:
        """Two effects of which neither alone is more than the form of the earlier ones may be, but
        the second is beside the first: a load and a wind may hide each other. Else empty.
        """
        is_full = len(steps) + 1 >= self.most
        if not steps or is_full or not are_few(fit) or not self._is_above_noise(fit):
            return []
        missed = (r for r in ranking.finalists if is_missed(r.effect, r.gain))
        helping = (r for r in missed if self.helps(fit, r.fit))
        row = next((r for r in helping if self.is_believed(r, ranking.reference)), None)
        if row is None:
            return []
        self.progress(f"what would come with {row.name}")
        first = ranking.led_by(row)
        second, more = self.ranked(row.fit, [*steps, first])
        return [first, second] if more else []

    def _with_first(self, added: Sequence[AddedEffect], steps: Sequence[Ranking], last: Fit) -> Fit:
        """The first effects alone: as they were chosen, where they were chosen one by one."""
        names = tuple(a.effect.name for a in added)
        chosen = (step.best.fit for step in steps if step.best.fit.names == names)
        return next(chosen, None) or self._beside(added, last)

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
        Nothing takes a place that predicts recordings left out worse than what stood there.
        """
        promising = None if last else {row.name for step in steps for row in step.finalists}
        for i, step in enumerate(steps if last else steps[:-1]):
            if is_needed(step.best.effect, fit.added):
                continue
            ranking = self.rank(self._without(fit, {i}), among=promising, present=fit)
            ranking = ranking if ranking.finalists else step
            best, old = ranking.best, step.best.name
            better = best.name != old and is_worth_it(self._gain_over(best.fit, fit))
            better = better and not self.is_worse(fit, best.fit)
            if better and self.is_believed(best, ranking.reference):
                self.progress(f"{best.name} in the place of {old}")
                yield [*(s for k, s in enumerate(steps) if k != i), ranking], best.fit

    def _exchanged(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit] | None:
        """Among what may change while a boat sails, water and wind: a change of one in the place of
        two that stood in for it, or two in the place of one change; None where neither is better.
        """
        changes, weather = self._weather
        special = {e.name: e.general_of for e in self.effects if e.general_of in weather}
        at = [i for i, name in enumerate(fit.names) if name in weather or name in special]
        if len(at) == 2:
            one = self._one_for_two(steps, fit, at, changes)
            return one or self._one_of_two_steady(steps, fit, at, special)
        if len(at) == 1 and len(steps) < self.most and not is_at_floor(fit.noise_share):
            name = fit.names[at[0]]
            if name in special:
                steady = special[name]
                others = weather - {name, steady}
                return self._two_for_one(steps, fit, at[0], steady, others)
        return None

    def _one_for_two(
        self, steps: list[Ranking], fit: Fit, at: list[int], changes: set[str]
    ) -> tuple[list[Ranking], Fit] | None:
        """A change in the place of the two effects `at` these steps, unless the later is missed."""
        self.progress(f"one change in the place of {' and '.join(fit.names[i] for i in at)}")
        one = self.in_place_of(fit, at, changes)
        if not one.finalists or not self.is_believed(one.best, one.reference):
            return None
        if is_missed(steps[at[1]].best.effect, self._gain_over(fit, one.best.fit)):
            return None
        return [*(step for i, step in enumerate(steps) if i not in at), one], one.best.fit

    def _one_of_two_steady(
        self, steps: list[Ranking], fit: Fit, at: list[int], special: Mapping[str, str]
    ) -> tuple[list[Ranking], Fit] | None:
        """Of two changes the one steady, and the other looked for anew beside it: a change that was
        chosen first took a part of the other, and bent what was found of that.
        """
        names = [fit.names[i] for i in at]
        if is_at_floor(fit.noise_share) or not all(name in special for name in names):
            return None
        for steady, other in (names, reversed(names)):
            self.progress(f"{special[steady]} and another {other} in the place of both")
            two = self._steady_and_another(fit, at, special[steady], {other})
            if two and is_worth_it(self._gain_over(two[-1].best.fit, fit)):
                kept = [step for i, step in enumerate(steps) if i not in at]
                return [*kept, *two], two[-1].best.fit
        return None

    def _two_for_one(
        self, steps: list[Ranking], fit: Fit, at: int, steady: str, others: set[str]
    ) -> tuple[list[Ranking], Fit] | None:
        """The steady case of a change, and one of the others beside it, in the change's place."""
        self.progress(f"two effects in the place of {fit.names[at]}")
        two = self._steady_and_another(fit, {at}, steady, others)
        if not two:
            return None
        both = two[-1].best.fit
        if self._gain_over(both, fit).nats <= 0.0 or not self.helps(fit, both):
            return None
        return [*(step for i, step in enumerate(steps) if i != at), *two], both

    def _steady_and_another(
        self, fit: Fit, at: Container[int], steady: str, others: set[str]
    ) -> list[Ranking]:
        """In the place of the effects `at` these places a steady one, and beside it the best of the
        others that is believed: how each was chosen; empty where there is none.
        """
        first = self.in_place_of(fit, at, {steady})
        if not first.finalists:
            return []
        second = self.rank(first.best.fit, among=others)
        if not second.finalists or not self.is_believed(second.best, second.reference):
            return []
        return [first, second]

    def _more_likely(
        self, first: Ranking, steps: list[Ranking], fit: Fit
    ) -> tuple[list[Ranking], Fit]:
        """As long as more is left than noise, the most likely of what can be had by one effect in
        the place of another, or by one current or wind in the place of two, and what comes next.

        On unseen time an exchange may win nothing yet: two errors of a compass show together
        alone. And beside a lift that stood in for a part of it a wind is found bent; without the
        lift no step leads from there to the wind that blew.
        """
        for _ in range(thresholds.MAX_EXCHANGES):
            if len(steps) < 2 or not are_few(fit) or is_at_floor(fit.noise_share):
                break
            found = list(self._likelier(first, steps, fit))
            if not found:
                break
            steps, fit = min(found, key=lambda one: unlikely(fit.problem, one[1]))
            self.progress(f"more likely: {', '.join(fit.names)}")
            steps, fit = self._grown(steps, fit, self._next(steps, fit))
        return steps, fit

    def _made_simpler(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """With special cases in the place of general effects, what stands beside them chosen again:
        a wind that turned may have taken the part of a current, and kept it from its place.

        As it was where the predictions then err noticeably more.
        """
        simpler, at = self._simplified(steps, fit)
        if at is fit:
            return steps, fit
        simpler, at = self._backward(*self._swapped(simpler, at))
        before, after = (self.scorer.score_fit(each).nrmse for each in (fit, at))
        return (simpler, at) if after <= thresholds.MAX_RIVAL_RATIO * before else (steps, fit)

    def _simplified(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """A general effect gives way to its special case where that does as well: from where the
        general one ended, for few steps may not lead there from afar, or anew beside others.
        """
        for step in list(steps):
            special = next((e for e in self.effects if e.name == step.best.effect.general_of), None)
            if special is None or special.name in fit.names:
                continue
            near = self._special_of(fit, step, special)
            if near is not None and not is_better_than_special(self._gain_over(fit, near)):
                self.progress(f"{special.name} in the place of {step.best.name}")
                row = replace(step.best, effect=special, fit=near)
                others = (r for r in step.finalists[1:] if r.name != special.name)
                ranking = replace(step, finalists=(row, *others))
                steps, fit = [ranking if s is step else s for s in steps], near
                continue
            if len(steps) == 1:  # the ranking has compared the two
                continue
            ranking = self.in_place_of(fit, {steps.index(step)}, {special.name})
            if not ranking.finalists or not self.is_believed(ranking.best, ranking.reference):
                continue
            if not is_better_than_special(self._gain_over(fit, ranking.best.fit)):
                self.progress(f"{special.name} in the place of {step.best.name}")
                steps, fit = [*(s for s in steps if s is not step), ranking], ranking.best.fit
        return steps, fit

    def _backward(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """Without each effect in turn: one that is not missed goes, unless recordings left out are
        predicted worse without it. Where these are asked those of a day go first: beside one of
        them an effect of the boat may seem needless, and both would go.
        """
        asked = self.scorer.score_recordings(fit) is not None
        while len(steps) > 1:
            added = fit.effects()
            is_later = [asked and a.effect.scope is Scope.BOAT for a in added]
            order = sorted(range(len(added)), key=is_later.__getitem__)
            fewer = next((found for i in order if (found := self._fewer(steps, fit, i))), None)
            if fewer is None:
                break
            steps, fit = fewer
        return steps, fit

    def _fewer(self, steps: list[Ranking], fit: Fit, i: int) -> tuple[list[Ranking], Fit] | None:
        """Without the i-th effect, where it is not missed."""
        effect = fit.effects()[i].effect
        if is_needed(effect, fit.added):
            return None
        for left, other in self._without_one(steps, fit, i):
            missed = is_missed(effect, self._gain_over(fit, other))
            if not missed and not self.is_worse(fit, other):
                self.progress(f"{effect.name} no longer earns its place")
                return left, other
        return None

    def _without_one(
        self, steps: list[Ranking], fit: Fit, i: int
    ) -> Iterator[tuple[list[Ranking], Fit]]:
        """The others as they are; then with what looks like the i-th and has a choice chosen anew:
        a weak motor to starboard was told as a strong one to port of a boat with two weak motors.
        """
        effect = fit.effects()[i].effect
        left = [step for step in steps if step.best.name != effect.name]
        yield left, self._without(fit, {i})
        for step in left:
            other = step.best.effect
            if not other.has_sides or not other.looks_like_effect(effect):
                continue
            ranking = self.in_place_of(fit, {i, fit.names.index(other.name)}, {other.name})
            if ranking.finalists and self.is_believed(ranking.best, ranking.reference):
                yield [*(s for s in left if s is not step), ranking], ranking.best.fit


def _is_absent_on_some(row: RankedEffect) -> bool:
    """Whether there is next to nothing of an effect of each day on one recording."""
    values = [row.fit.values(row.name, k) for k in range(len(row.fit.problem.trials))]
    sizes = (
        [abs(each[p.name] - p.neutral) for each in values]
        for p in row.effect.parameters
        if p.neutral is not None
    )
    return any(min(size) < thresholds.MAX_ABSENT_SHARE * np.median(size) for size in sizes)
