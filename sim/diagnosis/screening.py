"""Screening of the whole catalogue: where each effect would best begin, and what it promises.

From each start a damped Gauss–Newton step or two of the effect's own numbers together with those
of the reference, whose slopes are worked out once; from the best start a few, and of the effects
that promise most as many as lead on. This costs little enough to try a hundred starts: the fit
that decides comes later, for the few that promise most.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import (
    Fit,
    fit_effects,
    start_values,
    unknowns_for,
    with_event_at,
    with_given_base,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Kind, Values
from sim.identification.parameters import Unknowns
from sim.identification.search import (
    MOMENT_STARTS,
    damped_steps,
    robust_cost,
    robust_weights,
    start_points,
)
from sim.identification.shooting import jacobian_of, residuals_and_slopes, residuals_of
from sim.model import Model
from sim.state import Floats, Ints
from sim.vessel import AddedEffect

Progress = Callable[[str], None]  # is given what is being done, in words
Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # maps as `map` does
CATALOGUE = frozenset(effect.name for effect in EFFECTS)
FIRST_IMPRESSION = "first impression"  # begins the line of progress that is worth keeping


@dataclass(frozen=True)
class ScreeningResult:
    """One effect at the best start found: z (n,) of its unknowns, and the cost there.

    place     column (n,) of each unknown in the reference's z, −1 of what that does not hold
    deviance  −2 log likelihood under the noise that it leaves itself; known once it is the best
    residual  at z, on the rows that it was screened on last; None where it was moved since
    """

    added: AddedEffect
    unknowns: Unknowns
    z: Floats
    cost: float
    place: Ints
    deviance: float = np.inf
    residual: Floats | None = None

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.added.effect.name


def screen(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map, closer: bool = False,
    rival: Fit | None = None,
) -> list[ScreeningResult]:  # fmt: skip
    """All effects beside those that the reference holds, the most promising first.

    A few steps from the starts of each; then those that promise most go on, and events are closed
    in on. Each start is judged under the noise that the reference leaves; the effects are then put
    in order under the noise that each of them leaves. What is missing may be most of the noise of
    the reference, and under that noise the cause itself is forgiven (a compass that is off by a few
    degrees is as good as a receiver whose sway errs by as much).

    `model` is the vessel as the reference has it: waves are looked for in what it lacks. Where the
    reference moved the base far, the search begins from the base as it was given too: what stands
    in for the missing effect keeps it from its place. `mapper` may be that of a pool of threads:
    the kernels leave the interpreter free. `closer`: effects that declare further starts are fitted
    whole from each of them, on few rows. `rival`: another fit; an effect that does not explain
    these rows better than that, by as much as would be told of what is left, is left out.
    """
    given = with_given_base(reference.unknowns, reference.z)
    references = [reference] if given is None else [reference, replace(reference, z=given)]
    # of a stiff hull fewer rows, for the same work
    stiffness = max(like.problem.stiffness(like.unknowns, like.z) for like in references)
    share = max(1.0 / stiffness, thresholds.MIN_SCREENED_SHARE)
    pairs = [
        [
            _Screening.of(superset, like, like.problem.thinned(round(share * rows)))
            for rows in (thresholds.SCREENED_ROWS, thresholds.COARSE_ROWS)
        ]
        for like in references
    ]
    main = pairs[0][0]

    def begun(effect: Effect) -> list[_Begun]:
        progress(effect.name)
        starts, found = start_points(effect, model, reference.problem.trials), []
        measured = effect.measured is not None and effect.name in superset.measured
        if effect.measured is not None and measured:
            starts = [effect.measured.values]
        for fine, coarse in pairs:
            begins = [fine.at(effect, start) for start in starts]
            if len(starts) > thresholds.MANY_STARTS or rival is not None:
                enough = np.inf if rival is None else coarse.cost_of(rival)
                begins = coarse.few(begins, thresholds.MAX_PROMISED_COST * enough)
                if min((r.cost for r in begins), default=np.inf) >= enough:
                    continue
            found.append(fine.begun(begins))
        if closer and effect.more_starts is not None and not measured:
            length = max(float(t.time[-1]) for t in reference.problem.trials)
            found.append(_closer(effect, effect.more_starts(length), *pairs[0]))
        return [each for each in found if each is not None]

    def to_the_end(begun: Sequence[_Begun]) -> ScreeningResult:
        return min((each.screening.to_the_end(each.result) for each in begun), key=_cost)

    every = {each[0].result.name: each for each in mapper(begun, effects) if each}
    least = [min((each.result for each in some), key=_cost) for some in every.values()]
    looked = sorted(mapper(main.with_deviance, least), key=_deviance)
    if looked and not reference.names and rival is None:
        progress(first_impression(looked))
    followed = _followed(looked, every, main.deviance)
    results = {r.name: r for r in looked}
    for r in mapper(to_the_end, followed):
        results[r.name] = min(results[r.name], r, key=_cost)
    for general in list(results.values()):
        special = results.get(general.added.effect.general_of)
        again = _from_general(main, special, general) if special else None
        if again is not None and again.cost < results[again.name].cost:
            results[again.name] = again
    judged = sorted(mapper(main.with_deviance, results.values()), key=_deviance)
    return judged if rival is None else [r for r in judged if main.is_better_than(rival, r)]


def _followed(
    looked: Sequence[ScreeningResult], every: Mapping[str, Sequence["_Begun"]], before: float
) -> list[list["_Begun"]]:
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
    effect: Effect, starts: Sequence[Values], fine: "_Screening", coarse: "_Screening"
) -> "_Begun | None":
    """The best of whole fits from each of the further starts; None where none can be fitted."""
    begins = [coarse.at(effect, start) for start in starts]
    fits = sorted((coarse.fitted(r) for r in begins), key=_cost)
    again = [fine.fitted(r) for r in fits[: thresholds.MAX_CLOSER_FITS]]
    best, moment = min(again, key=_cost), _moment_of(effect)
    if not np.isfinite(best.cost):
        return None
    best = best if moment is None else fine.fitted(fine._closed_in(best, moment))
    return _Begun(fine, best, best.cost)


def _from_general(
    screening: "_Screening", special: ScreeningResult, general: ScreeningResult
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


@dataclass(frozen=True)
class _Screening:
    """The reference on few rows, with its slopes there."""

    superset: SupersetModel
    reference: Fit
    problem: FitProblem
    jacobian: Floats

    @classmethod
    def of(cls, superset: SupersetModel, reference: Fit, problem: FitProblem) -> "_Screening":
        unknowns, z = reference.unknowns, reference.z
        jacobian = jacobian_of(unknowns, problem.run_sets_for(unknowns, z), z)
        return cls(superset, reference, problem, jacobian)

    def begun(self, begins: Sequence[ScreeningResult]) -> "_Begun | None":
        """From every beginning one step, from the best a few; None where the model is lost."""
        tried = [r for r in map(self._step, begins) if r is not None]
        if not tried:
            return None
        r, last, promised = min(tried, key=_cost), np.inf, np.inf
        for _ in range(thresholds.LOOK_STEPS):
            slopes = self._slopes(r)
            if slopes is None or r.cost > last * (1.0 - thresholds.SETTLED_DECREASE):
                break
            last, promised, r = r.cost, slopes.promised, self._best_step(slopes)
        settled = r.cost > last * (1.0 - thresholds.SETTLED_DECREASE)
        return _Begun(self, r, r.cost if settled else promised)

    def to_the_end(self, r: ScreeningResult) -> ScreeningResult:
        """As many steps as lead on; an event is closed in on."""
        for _ in range(thresholds.MAX_SCREENING_STEPS):
            further = self._step(r)
            if further is None or further.cost >= r.cost * (1.0 - thresholds.MIN_COST_DECREASE):
                break
            r = further
        moment = _moment_of(r.added.effect)
        return r if moment is None else self._closed_in(r, moment)

    def _closed_in(self, best: ScreeningResult, moment: str) -> ScreeningResult:
        """The moment of an event by bisection: no slope leads to it.

        First all along the recording again: few rows may have none around the moment itself.
        """
        longest = max(float(t.time[-1]) for t in self.problem.trials)
        every = np.linspace(0.0, longest, 2 * MOMENT_STARTS + 3)[1:-1]
        best = self._best_moment(best, moment, every)
        apart = 0.25 * longest / (MOMENT_STARTS + 1)
        while apart > thresholds.MOMENT_RESOLUTION_S:
            now = best.added.values[moment]
            best = self._best_moment(best, moment, (now - apart, now + apart))
            apart *= 0.5
        return best

    def _best_moment(
        self, best: ScreeningResult, moment: str, times: Iterable[float]
    ) -> ScreeningResult:
        """One step from those of the moments that promise most; the best if none leads down."""
        moved = []
        for time in map(float, times):
            added = AddedEffect(best.added.effect, {**best.added.values, moment: time})
            unknowns = with_event_at(best.unknowns, f"{best.name}.{moment}", time)
            moved.append(replace(best, added=added, unknowns=unknowns, residual=None))
        return min([best, *self._promised(moved, thresholds.PROMISED_MOMENTS)], key=_cost)

    def fitted(self, r: ScreeningResult) -> ScreeningResult:
        """Everything fitted from there, with slopes of its own at each step."""
        added = (*self.reference.added, r.added)
        try:
            fit = fit_effects(added, r.unknowns, self.problem, np.clip(r.z, *r.unknowns.bounds))
        except (ValueError, np.linalg.LinAlgError):  # the model is lost at this start
            return replace(r, cost=np.inf)
        return replace(r, z=fit.z, cost=fit.cost, residual=None, deviance=np.inf)

    def few(self, begins: Sequence[ScreeningResult], most: float = np.inf) -> list[ScreeningResult]:
        """Where those lead that lead furthest: slopes at all, two steps from every second, two
        more from every fourth; none from where the slopes promise a cost beyond `most`.
        """
        half, quarter = (max(len(begins) // n, thresholds.MANY_STARTS) for n in (2, 4))
        left = self._stepped(self._promised(begins, half, most), thresholds.COARSE_STEPS - 1)
        left = self._stepped(left[:quarter], thresholds.COARSE_STEPS)
        # they go on to other rows
        return [replace(r, residual=None) for r in left[: thresholds.MANY_STARTS // 2]]

    def _stepped(self, results: Iterable[ScreeningResult], steps: int) -> list[ScreeningResult]:
        """So many steps from each, the least cost first."""
        for _ in range(steps):
            results = [r for r in map(self._step, results) if r is not None]
        return sorted(results, key=_cost)

    def cost_of(self, fit: Fit) -> float:
        """What another fit leaves of these rows, as the starts are judged."""
        run_sets = self.problem.run_sets_for(fit.unknowns, fit.z)
        left = residuals_of(fit.unknowns, run_sets, fit.z[None])
        cost = robust_cost(fit.unknowns, fit.z[None], left, thresholds.ROBUST_SIGMAS)
        return float(cost[0])

    def is_better_than(self, rival: Fit, r: ScreeningResult) -> bool:
        """Whether a result is worth as much over another fit as what is left has to be."""
        own = self.problem.deviance(rival.unknowns, rival.z) - r.deviance
        thinned = len(self.reference.problem.block) / len(self.problem.block)
        nats = 0.5 * own * thinned / thresholds.ROWS_PER_INDEPENDENT_ROW
        return nats > thresholds.MIN_RESIDUAL_NATS

    @property
    def deviance(self) -> float:
        """That of the reference."""
        return self.problem.deviance(self.reference.unknowns, self.reference.z)

    def with_deviance(self, r: ScreeningResult) -> ScreeningResult:
        """The same, judged under its own noise."""
        if np.isfinite(r.deviance):
            return r
        return replace(r, deviance=self.problem.deviance(r.unknowns, r.z))

    def at(self, effect: Effect, start: Values) -> ScreeningResult:
        """A start, before the first step."""
        added = AddedEffect(effect, dict(start))
        trials, settings = len(self.problem.trials), self.problem.settings
        unknowns = unknowns_for(self.superset, [*self.reference.added, added], trials, settings)
        z = start_values(unknowns, self.reference)
        known = {(u.name, u.trial): i for i, u in enumerate(self.reference.unknowns.each)}
        place = np.array([known.get((u.name, u.trial), -1) for u in unknowns.each])
        return ScreeningResult(added, unknowns, z, np.inf, place)

    def _promised(
        self, begins: Iterable[ScreeningResult], most: int, below: float = np.inf
    ) -> list[ScreeningResult]:
        """One step from those for which the slopes promise the least cost, `below` some."""
        known = [s for s in map(self._slopes, begins) if s is not None and s.promised < below]
        chosen = sorted(known, key=lambda slopes: slopes.promised)[:most]
        return [r for r in map(self._best_step, chosen) if r is not None]

    def _step(self, r: ScreeningResult) -> ScreeningResult | None:
        """The best of a few Levenberg–Marquardt steps; None where the model is lost."""
        slopes = self._slopes(r)
        return None if slopes is None else self._best_step(slopes)

    def _slopes(self, r: ScreeningResult) -> "_Slopes | None":
        """Residuals and slopes at a result, and where they lead; None where the model is lost."""
        unknowns, z = r.unknowns, np.clip(r.z, *r.unknowns.bounds)
        own, shared = np.flatnonzero(r.place < 0), np.flatnonzero(r.place >= 0)
        run_sets = self.problem.run_sets_for(unknowns, z)
        residual, J = residuals_and_slopes(unknowns, run_sets, z, own, known=r.residual)
        J[:, shared] = self.jacobian[:, r.place[shared]]
        if not np.isfinite(J).all():
            return None
        weight = robust_weights(residual, thresholds.ROBUST_SIGMAS)
        tried = np.clip(z + damped_steps(unknowns, z, residual, J, weight), *unknowns.bounds)
        after = residual + (tried - z) @ J.T
        promised = robust_cost(unknowns, tried, after, thresholds.ROBUST_SIGMAS)
        here = replace(r, z=z, residual=residual, deviance=np.inf)
        return _Slopes(here, residual, tried, float(promised.min()))

    def _best_step(self, slopes: "_Slopes") -> ScreeningResult:
        """The best of the steps; where it stands if none leads down."""
        r, tried = slopes.here, slopes.tried
        unknowns, bend = r.unknowns, thresholds.ROBUST_SIGMAS
        left = residuals_of(unknowns, self.problem.run_sets_for(unknowns, r.z), tried)
        costs = robust_cost(unknowns, tried, left, bend)
        k = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        here = float(robust_cost(unknowns, r.z, slopes.residual, bend))
        if here <= costs[k]:
            return replace(r, cost=here)
        return replace(r, z=tried[k], cost=float(costs[k]), residual=left[k])


class _Slopes(NamedTuple):
    """A result with its residuals (N,), numbers (K, n) that its slopes lead to, the least cost that
    they promise there.
    """

    here: ScreeningResult
    residual: Floats
    tried: Floats
    promised: float


class _Begun(NamedTuple):
    """An effect after a few steps, on which rows and base, and the cost that slopes still promise:
    what it has where the last step brought little.
    """

    screening: _Screening
    result: ScreeningResult
    promised: float

    @property
    def is_settled(self) -> bool:
        """Whether no less is promised."""
        return self.promised >= self.result.cost


def _cost(r: ScreeningResult) -> float:
    return r.cost


def _deviance(r: ScreeningResult) -> float:
    return r.deviance


def _moment_of(effect: Effect) -> str | None:
    """The parameter that is the moment of an event; None where there is none."""
    return next((p.name for p in effect.parameters if p.kind is Kind.MOMENT), None)
