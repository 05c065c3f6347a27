"""The search for effects: one after another, as long as each is worth it on held-out time.

    rank → add the best → rank beside it …  then swap: choose the earlier ones again beside the
    later;  exchange: two effects for one, or one for two;  and backward: what no longer earns its
    place goes, and the others are chosen again;  at last the final fit

The first choice is made while the second effect is still missing, and may stand in for both: a
change of current for a wind that turned while a current ran. No swap of one effect for another
leads from there to those two, or from a current and a steady wind to a wind that turned. So where
the first leaves much, and several stand out in the missing forces (`force_search`), the search
begins with these, and goes on from there as from any other beginning. The final
fit is as `shadow identify` fits: moments of events once, then starts → noise → numbers in
turn until they settle. While effects are compared, starts are taken from the measured motion and
noise from a leader, the same for all; numbers with an interval deserve starts where this model has
them, and the noise that it leaves.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from sim.diagnosis import thresholds
from sim.diagnosis.fit import (
    Fit,
    final_fit,
    fit_effects,
    is_held,
    start_values,
    unknowns_for,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.force_search import (
    ForceProblem,
    fit_from_forces,
    in_place_by_forces,
    search_forces,
)
from sim.diagnosis.generality import doubt_of
from sim.diagnosis.heldout import (
    Gain,
    HeldOutScorer,
    RankedEffect,
    Ranking,
    gain_under,
    is_better_than_special,
    rank,
    ranked_over,
)
from sim.diagnosis.screening import Mapper, Progress
from sim.diagnosis.worth import (
    helps,
    is_at_floor,
    is_missed,
    is_worse_elsewhere,
    is_worth_it,
)
from sim.effects.effect import Effect, Scope
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
class EffectSearch:
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

    def run(self, base: Fit) -> Selection:
        """Greedy, with swaps and exchanges, then backward."""
        first, more = self.ranked(base, [])
        steps, fit = self._found(base, first, more)
        fewer, fit = self._backward(steps, fit)
        if 1 < len(fewer) < len(steps):  # what went may have kept another from its place
            fewer, fit = self._swapped(fewer, fit, last=True)
        steps, fit = self._in_place_by_forces(*self._made_simpler(fewer, fit))
        # one story: what took the place of the first is the first of the ranking that is told
        alone = (s for s in steps if s.reference is first.reference or not s.reference.names)
        first = next(alone, first)
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
        if _are_few(base) and self.most > 1 and self._is_above_noise(one):
            steps = self._begun_with_forces(base)
            if steps:
                steps, fit = self._swapped(steps, steps[-1].best.fit)
                steps, fit = self._grown_and_exchanged(steps, fit, self._next(steps, fit))
                if self.helps(one, fit):
                    return steps, fit
        return self._grown_and_exchanged([], base, [first] if more and self.most else [])

    def _is_above_noise(self, fit: Fit) -> bool:
        """Whether more is left than a complete model leaves."""
        scorer = self.scorer.shared_with(fit)
        return scorer.score_fit(fit).nrmse > thresholds.MAX_FLOORS * scorer.noise_floor

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
        fit = fit_from_forces(found.fit, base.problem)
        steps, added = list[Ranking](), list[AddedEffect]()
        for each in fit.effects():
            ranking = self._led_by(fit, added, each, found.promising[each.effect.name])
            if self.is_believed(ranking.best, ranking.reference):
                steps, added = [*steps, ranking], [*added, each]
        return steps if len(steps) > 1 else []

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
        if not steps or is_full or not _are_few(fit) or not self._is_above_noise(fit):
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
        """The effects that a fit does not hold, whole or as a part of another."""
        return [e for e in self.effects if not is_held(e, fit.added)]

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
            ranking = self.rank(self._without(fit, {i}), among=promising, present=fit)
            ranking = ranking if ranking.finalists else step
            best, old = ranking.best, step.best.name
            better = best.name != old and is_worth_it(self._gain_over(best.fit, fit))
            better = better and not is_worse_elsewhere(self.scorer, fit, best.fit)
            if better and self.is_believed(best, ranking.reference):
                self.progress(f"{best.name} in the place of {old}")
                yield [*(s for k, s in enumerate(steps) if k != i), ranking], best.fit

    @property
    def _weather(self) -> tuple[set[str], set[str]]:
        """Changes of water and wind; and these with the steady cases that they hold as a whole."""
        changes = {e.name: e.contains for e in self.effects if e.contains}
        return set(changes), {*changes, *changes.values()}

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

    def _in_place_by_forces(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """Each of several effects chosen once more beside the others, among its look-alikes and
        what promised enough to be fitted: from numbers that the missing forces give. What needs
        fewer numbers takes a place more easily, see `_takes_place`.
        """
        if len(steps) < 2 or not _are_few(fit):
            return steps, fit
        promising = sorted({row.name for step in steps for row in step.finalists})
        problem = ForceProblem.of(self.superset, fit.problem.trials, fit.problem.settings)
        for step in list(steps):
            self.progress(f"what does as well as {step.best.name}, from the missing forces")
            place, present = fit.names.index(step.best.name), step.best.effect
            effects = [
                e for e in self._others(fit)
                if e.name in promising or e.looks_like_effect(present)
            ]  # fmt: skip
            for other in in_place_by_forces(problem, fit, place, effects, self.mapper):
                if not self._takes_place(other, fit):
                    continue
                *others, last = other.effects()
                ranking = self._led_by(other, others, last, promising)
                if self.is_believed(ranking.best, ranking.reference):
                    self.progress(f"{last.effect.name} in the place of {present.name}")
                    steps = [*(s for s in steps if s is not step), ranking]
                    fit = ranking.best.fit
                    break
        return steps, fit

    def _takes_place(self, other: Fit, fit: Fit) -> bool:
        """Whether another fit is worth it; or does as well with two numbers fewer, or wins with one
        fewer, be it little, under the noise that either leaves.
        """
        over, under = self._gain_over(other, fit), self._gain_over(fit, other)
        fewer = len(fit.z) - len(other.z)
        if fewer > 1 and not is_better_than_special(under):
            return True
        return is_worth_it(over) or (fewer == 1 and over.nats > 0.0 > under.nats)

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

    def _backward(self, steps: list[Ranking], fit: Fit) -> tuple[list[Ranking], Fit]:
        """Without each effect in turn: one that is not missed goes, unless recordings left out are
        predicted worse without it. Where these are asked those of a day go first: beside one of
        them an effect of the boat may seem needless, and both would go.
        """
        asked = self.scorer.score_recordings(fit) is not None
        while len(steps) > 1:
            added = fit.effects()
            is_later = [asked and a.effect.scope is Scope.BOAT for a in added]
            for i in sorted(range(len(added)), key=is_later.__getitem__):
                without, effect = self._without(fit, {i}), added[i].effect
                missed = is_missed(effect, self._gain_over(fit, without))
                if not missed and not is_worse_elsewhere(self.scorer, fit, without):
                    self.progress(f"{effect.name} no longer earns its place")
                    steps = [s for s in steps if s.best.name != effect.name]
                    fit = without
                    break
            else:
                break
        return steps, fit

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
        return gain_under(fit.renewed_problem, other, fit)


def _are_few(fit: Fit) -> bool:
    """Whether a fit is of so few recordings that none can be left out in turn."""
    return len(fit.problem.trials) < thresholds.MIN_RECORDINGS
