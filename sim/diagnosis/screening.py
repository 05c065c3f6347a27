"""Screening of the whole catalogue: where each effect would best begin, and what it promises.

From each start a damped Gauss–Newton step or two of the effect's own numbers together with those
of the reference, whose slopes are worked out once; from the best start a few, and of the effects
that promise most as many as lead on. This costs little enough to try a hundred starts: the fit
that decides comes later, for the few that promise most.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, with_given_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.screening_steps import (
    Begun,
    Screening,
    ScreeningResult,
    least_cost,
    moment_of,
)
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Values
from sim.model import Model
from sim.state import CountedStep, Progress

Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # maps as `map` does
CATALOGUE = frozenset(effect.name for effect in EFFECTS)
FIRST_IMPRESSION = "first impression"  # begins the line of progress that is worth keeping


def screen(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map, closer: bool = False,
    rival: Fit | None = None, present: Fit | None = None,
) -> list[ScreeningResult]:  # fmt: skip
    """All effects beside those that the reference holds, the most promising first.

    A few steps from the starts of each; then those that promise most go on, and events are closed
    in on. Each start is judged under the noise that the reference leaves; the effects are then put
    in order under the noise that each of them leaves. What is missing may be most of the noise of
    the reference, and under that noise the cause itself is forgiven (a compass that is off by a few
    degrees is as good as a receiver whose sway errs by as much).

    `model` is the vessel as the reference has it: waves are looked for in what it lacks. Where the
    reference moved the base far, the first search, and one `closer`, begins from the base as it was
    given too: what stands in for the missing effect keeps it from its place. `mapper` may be that
    of a pool of threads: the kernels leave the interpreter free. `closer`: effects that declare
    further starts are fitted whole from each of them, on few rows. `rival`: another fit; an effect
    that does not explain these rows better than that, by as much as would be told of what is left,
    is left out. `present`: a fit whose place is in question; what promises but a part of what that
    has is left out.
    """
    both = closer or not reference.names
    given = with_given_base(reference.unknowns, reference.z) if both else None
    references = [reference] if given is None else [reference, replace(reference, z=given)]
    # of a stiff hull fewer rows, for the same work
    stiffness = max(like.problem.stiffness(like.unknowns, like.z) for like in references)
    share = max(1.0 / stiffness, thresholds.MIN_SCREENED_SHARE)
    main = _Base.of(superset, reference, share, rival)
    trials = reference.problem.trials
    length = max(float(t.time[-1]) for t in trials)

    effects, numbers = list(effects), count(1)  # counted as they end: threads take several at once

    def begun(tried: tuple[Effect, Sequence[Values]]) -> list[Begun]:
        effect, _ = tried
        found = [main.begun(tried)]
        if closer and effect.more_starts is not None and effect.name not in superset.measured:
            found.append(_closer(effect, effect.more_starts(length), main.fine, main.coarse))
        progress(_looked_at(next(numbers), len(effects), effect.name))
        return [each for each in found if each is not None]

    starts = list(mapper(lambda effect: superset.starts(effect, model, trials), effects))
    pairs, judged = list(zip(effects, starts, strict=True)), partial(_best_judged, main.fine)
    found = list(mapper(begun, pairs))
    if not reference.names and rival is None and any(found):
        # the search from the other base goes on while this is read
        found = list(mapper(judged, found))
        progress(first_impression(sorted((s[0].result for s in found if s), key=_deviance)))
    for like in references[1:]:
        also = mapper(_Base.of(superset, like, share, rival, given=True).begun, pairs)
        found = [[*some, *([r] if r else [])] for some, r in zip(found, also, strict=True)]
    every = {some[0].result.name: some for some in mapper(judged, found) if some}
    results = _to_the_end(main.fine, every, main.fine.deviance_of(reference), mapper)
    in_order = sorted(mapper(main.fine.with_deviance, results), key=_deviance)
    if present is not None:
        without, with_it = (main.fine.deviance_of(fit) for fit in (reference, present))
        in_order = in_its_place(in_order, without, with_it)
    if rival is None:
        return in_order
    before = main.fine.deviance_of(rival)
    return [r for r in in_order if main.fine.is_better(r, before)]


@dataclass(frozen=True)
class _Base:
    """Numbers of the base that effects begin from, on the rows that decide and on fewer.

    enough  what a rival leaves of the fewer [cost]; infinite where there is none
    given   whether they are those of the vessel as it was given
    """

    fine: Screening
    coarse: Screening
    enough: float
    given: bool = False

    @classmethod
    def of(
        cls, superset: SupersetModel, like: Fit, share: float, rival: Fit | None,
        given: bool = False,
    ) -> "_Base":  # fmt: skip
        """The numbers of a fit; `share`: of the rows that are screened on otherwise."""
        fine, coarse = (
            Screening.of(superset, like, like.problem.thinned(round(share * rows)))
            for rows in (thresholds.SCREENED_ROWS, thresholds.COARSE_ROWS)
        )
        return cls(fine, coarse, np.inf if rival is None else coarse.cost_of(rival), given)

    def begun(self, tried: tuple[Effect, Sequence[Values]]) -> Begun | None:
        """An effect from its starts; None where none leads further than the rival."""
        effect, starts = tried
        begins, has_rival = [self.fine.at(effect, start) for start in starts], self.enough < np.inf
        if self.given and effect.is_like_the_base:
            begins = [self.coarse.beside_base(r) for r in begins]
        if has_rival or len(begins) > thresholds.MANY_STARTS:
            most = promised = thresholds.MAX_PROMISED_COST * self.enough
            if has_rival:  # many times its error: slopes promise but a part of the way
                promised = max(most, np.sqrt(self.enough * self.coarse.own_cost))
            begins = self.coarse.few(begins, promised)
            if min((r.cost for r in begins), default=np.inf) >= most:
                return None
        return self.fine.begun(begins)


def _best_judged(screening: Screening, begun: Sequence[Begun]) -> list[Begun]:
    """What was begun of one effect, the best first, that with its deviance."""
    if not begun:
        return []
    first, *others = sorted(begun, key=lambda each: each.result.cost)
    return [first._replace(result=screening.with_deviance(first.result)), *others]


def _to_the_end(
    screening: Screening, every: Mapping[str, Sequence[Begun]], before: float, mapper: Mapper
) -> list[ScreeningResult]:
    """One result of each effect, of those that promise most after as many steps as lead on, and
    special cases also from where their general form ended; `before`: deviance without any.
    """
    looked = sorted((some[0].result for some in every.values()), key=_deviance)
    results = {r.name: r for r in looked}
    for r in mapper(_best_at_the_end, _followed(looked, every, before)):
        results[r.name] = min(results[r.name], r, key=least_cost)
    for general in list(results.values()):
        special = results.get(general.added.effect.general_of)
        again = _from_general(screening, special, general) if special else None
        if again is not None and again.cost < results[again.name].cost:
            results[again.name] = again
    return list(results.values())


def _best_at_the_end(begun: Sequence[Begun]) -> ScreeningResult:
    """Of one effect, from each of its beginnings as far as steps lead on."""
    return min((each.screening.to_the_end(each.result) for each in begun), key=least_cost)


def _followed(
    looked: Sequence[ScreeningResult], every: Mapping[str, Sequence[Begun]], before: float
) -> list[list[Begun]]:
    """Of what was begun, per effect, what promises most, and the best where it is not settled; the
    other too, while it promises less than the best has.

    looked   the best of each effect, the most promising first; before: deviance without any
    """
    promise = np.array([before - r.deviance for r in looked])
    enough = thresholds.MIN_PROMISE_FOLLOWED * promise.max(initial=0.0)
    promising = {
        r.name for i, r in enumerate(looked) if i < thresholds.MIN_FOLLOWED or promise[i] > enough
    }
    followed = []
    for name, begun in every.items():
        best = min(begun, key=lambda each: each.result.cost)
        wanted = name in promising or name not in CATALOGUE or not best.is_settled
        others = [each for each in begun if each is not best and each.promised < best.result.cost]
        followed.append([*([best] if wanted else ()), *others])
    return [some for some in followed if some]


def in_its_place(
    results: Sequence[ScreeningResult], without: float, present: float
) -> list[ScreeningResult]:
    """Those that promise a share of what an effect has, to be fitted in its place.

    without, present   deviance of what is beside it, and with it
    """
    most = without - thresholds.MIN_PROMISE_IN_PLACE * (without - present)
    return [r for r in results if r.deviance < most]


def _looked_at(done: int, total: int, last: str) -> CountedStep:
    """How far a look at all effects is, for a line of progress."""
    return CountedStep(f"{done} of {total} effects looked at, last {last}", done, total)


def first_impression(results: Sequence[ScreeningResult]) -> str:
    """What a first look at all effects, the most promising first, is worth telling of."""
    name, *others = (r.name for r in results[:3])
    then = f", then {' or '.join(others)}" if others else ""
    return f"{FIRST_IMPRESSION}: most like {name}{then}, if anything is missing"


def most_promising(
    results: Sequence[ScreeningResult], least: int, most: int, share: float
) -> list[ScreeningResult]:
    """Of all, the most promising first, those that promise a share of what the best one does: so
    many at `least`, and at `most`.

    In any case: an effect that is not of the catalogue, for somebody asks for it, and the special
    case of a general form, which comes first if it does as well.
    """
    if not results:
        return []
    deviance = [r.deviance for r in results]
    enough = max(deviance) - share * (max(deviance) - deviance[0])
    chosen = [r for i, r in enumerate(results[:most]) if i < least or r.deviance < enough]
    special = {r.added.effect.general_of for r in chosen}
    wanted = [r for r in results if r.name in special or r.name not in CATALOGUE]
    return [*chosen, *(r for r in wanted if r not in chosen)]


def _closer(
    effect: Effect, starts: Sequence[Values], fine: Screening, coarse: Screening
) -> Begun | None:
    """The best of whole fits from each of the further starts; None where none can be fitted."""
    begins = [coarse.at(effect, start) for start in starts]
    fits = sorted((coarse.fitted(r) for r in begins), key=least_cost)
    again = [fine.fitted(r) for r in fits[: thresholds.MAX_CLOSER_FITS]]
    best, moment = min(again, key=least_cost), moment_of(effect)
    if not np.isfinite(best.cost):
        return None
    best = best if moment is None else fine.fitted(fine.closed_in(best, moment))
    return Begun(fine, best, best.cost)


def _from_general(
    screening: Screening, special: ScreeningResult, general: ScreeningResult
) -> ScreeningResult | None:
    """A special case begun where its general form ended; None where they share no parameter.

    A general form with more starts may lead where those of the special case do not.
    """
    found, name = general.unknowns, general.name
    theta = found.theta(np.clip(general.z, *found.bounds)[None], 0)[0]
    own = {
        key.partition(".")[2]: float(x)
        for key, x in zip(found.model.names, theta, strict=True)
        if key.startswith(f"{name}.")
    }
    start = {key: own.get(key, value) for key, value in special.added.values.items()}
    if not own.keys() & start.keys():
        return None
    begun = screening.begun([screening.at(special.added.effect, start)])
    return None if begun is None else screening.to_the_end(begun.result)


def _deviance(r: ScreeningResult) -> float:
    return r.deviance
