"""Steps of the screening: one effect beside a reference, on few rows, from where it may begin.

A damped Gauss–Newton step moves the effect's own numbers together with those of the reference,
whose slopes are worked out once. Starts, and moments of an event, are told apart by what their
slopes promise before any step is tried.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import (
    Fit,
    fit_effects,
    places_in,
    start_values,
    unknowns_for,
    with_event_at,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel, nats_of
from sim.effects.effect import Effect, Kind, Values
from sim.identification import BASE
from sim.identification.parameters import Unknowns
from sim.identification.search import (
    MOMENT_STARTS,
    damped_steps,
    residuals_and_jacobian,
    robust_cost,
    robust_weights,
)
from sim.identification.shooting import jacobian_of, residuals_of, residuals_of_trials
from sim.state import Floats, Ints
from sim.vessel import AddedEffect


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


def least_cost(r: ScreeningResult) -> float:
    """Key of the order in which starts of one effect are preferred."""
    return r.cost


@dataclass(frozen=True)
class Screening:
    """The reference on few rows, with its slopes there."""

    superset: SupersetModel
    reference: Fit
    problem: FitProblem
    jacobian: Floats

    @classmethod
    def of(cls, superset: SupersetModel, reference: Fit, problem: FitProblem) -> "Screening":
        unknowns, z = reference.unknowns, reference.z
        jacobian = jacobian_of(unknowns, problem.run_sets_for(unknowns, z), z)
        return cls(superset, reference, problem, jacobian)

    def begun(self, begins: Sequence[ScreeningResult]) -> "Begun | None":
        """From every beginning one step, from the best a few; None where the model is lost."""
        tried = self._steps(begins)
        if not tried:
            return None
        r, settled, promised = min(tried, key=least_cost), False, np.inf
        for _ in range(thresholds.LOOK_STEPS):
            slopes = [] if settled else self._slopes([r])
            if not slopes:
                break
            less, promised = r.cost * (1.0 - thresholds.SETTLED_DECREASE), slopes[0].promised
            (r,) = self._best_steps(slopes)
            settled = r.cost > less
        # what fell so much falls on, whatever slopes promise
        further = r.cost * (1.0 - thresholds.SETTLED_DECREASE)
        return Begun(self, r, r.cost if settled else min(promised, further))

    def to_the_end(self, r: ScreeningResult) -> ScreeningResult:
        """As many steps as lead on; an event is closed in on."""
        for _ in range(thresholds.MAX_SCREENING_STEPS):
            further = self._steps([r])
            if not further or further[0].cost >= r.cost * (1.0 - thresholds.MIN_COST_DECREASE):
                break
            (r,) = further
        moment = moment_of(r.added.effect)
        return r if moment is None else self.closed_in(r, moment)

    def closed_in(self, best: ScreeningResult, moment: str) -> ScreeningResult:
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
        return min([best, *self._promised(moved, thresholds.PROMISED_MOMENTS)], key=least_cost)

    def fitted(self, r: ScreeningResult) -> ScreeningResult:
        """Everything fitted from there, with slopes of its own at each step."""
        return self._fitted(r, r.unknowns)

    def beside_base(self, r: ScreeningResult) -> ScreeningResult:
        """All but the base fitted from there, the base held as it was given: together the first
        steps would go along what the two have in common, and far beyond it.
        """
        base = np.array([u.name in BASE for u in r.unknowns.each])
        return self._fitted(r, r.unknowns.fixed(base))

    def _fitted(self, r: ScreeningResult, unknowns: Unknowns) -> ScreeningResult:
        added = (*self.reference.added, r.added)
        try:
            fit = fit_effects(added, unknowns, self.problem, np.clip(r.z, *unknowns.bounds))
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

    def _stepped(self, results: Sequence[ScreeningResult], steps: int) -> list[ScreeningResult]:
        """So many steps from each, the least cost first."""
        for _ in range(steps):
            results = self._steps(results)
        return sorted(results, key=least_cost)

    @cached_property
    def own_cost(self) -> float:
        """What the reference leaves of these rows."""
        return self.cost_of(self.reference)

    def cost_of(self, fit: Fit) -> float:
        """What another fit leaves of these rows, as the starts are judged."""
        run_sets = self.problem.run_sets_for(fit.unknowns, fit.z)
        left = residuals_of(fit.unknowns, run_sets, fit.z[None])
        cost = robust_cost(fit.unknowns, fit.z[None], left, thresholds.ROBUST_SIGMAS)
        return float(cost[0])

    def deviance_of(self, fit: Fit) -> float:
        """Of another fit, or the reference, under the noise that it leaves of these rows."""
        return self.problem.deviance(fit.unknowns, fit.z)

    def is_better(self, r: ScreeningResult, before: float) -> bool:
        """Whether a result is worth as much over a deviance as what is left has to be."""
        thinned = len(self.reference.problem.block) / len(self.problem.block)
        return nats_of((before - r.deviance) * thinned) > thresholds.MIN_RESIDUAL_NATS

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
        # what is known beforehand is no place to begin at: a table may be filled
        priors = {p.name for p in effect.parameters if p.prior} & start.keys()
        begin = {f"{effect.name}.{name}": start[name] for name in priors}
        z = np.array([begin.get(u.name, x) for u, x in zip(unknowns.each, z, strict=True)])
        place = places_in(self.reference.unknowns, unknowns)
        return ScreeningResult(added, unknowns, z, np.inf, place)

    def _promised(
        self, begins: Sequence[ScreeningResult], most: int, below: float = np.inf
    ) -> list[ScreeningResult]:
        """One step from those for which the slopes promise the least cost, `below` some."""
        known = [slopes for slopes in self._slopes(begins) if slopes.promised < below]
        return self._best_steps(sorted(known, key=lambda slopes: slopes.promised)[:most])

    def _steps(self, results: Sequence[ScreeningResult]) -> list[ScreeningResult]:
        """From each the best of a few Levenberg–Marquardt steps; none where the model is lost."""
        return self._best_steps(self._slopes(results))

    def _slopes(self, results: Sequence[ScreeningResult]) -> list["Slopes"]:
        """Residuals and slopes at results of one effect, and where they lead; none where the model
        is lost.
        """
        return [slopes for some in self._together(results) for slopes in self._slopes_of(some)]

    def _slopes_of(self, some: Sequence[ScreeningResult]) -> Iterator["Slopes"]:
        unknowns, place = some[0].unknowns, some[0].place
        lower, upper = unknowns.bounds
        some = [replace(r, z=np.clip(r.z, lower, upper)) for r in some]
        z = np.stack([r.z for r in some])
        own, shared = np.flatnonzero(place < 0), np.flatnonzero(place >= 0)
        before = [r.residual for r in some if r.residual is not None]
        residual, J = residuals_and_jacobian(
            lambda each: self._residuals(some, each), range(len(self.problem.trials)), unknowns, z,
            own, np.stack(before) if len(before) == len(some) else None,
        )  # fmt: skip
        J[..., shared] = self.jacobian[:, place[shared]]
        known = np.asarray(np.isfinite(J).all(axis=(-1, -2)))
        z, residual, J = z[known], residual[known], J[known]
        weight = robust_weights(residual, thresholds.ROBUST_SIGMAS)
        steps = damped_steps(unknowns, z, residual, J, weight)
        tried = np.clip(z[:, None] + steps, lower, upper)
        after = residual[:, None] + (tried - z[:, None]) @ J.swapaxes(-1, -2)
        promised = robust_cost(unknowns, tried, after, thresholds.ROBUST_SIGMAS).min(axis=-1)
        cost = robust_cost(unknowns, z, residual, thresholds.ROBUST_SIGMAS)
        for i, k in enumerate(np.flatnonzero(known)):
            here = replace(some[k], residual=residual[i], cost=float(cost[i]), deviance=np.inf)
            yield Slopes(here, tried[i], float(promised[i]))

    def _best_steps(self, slopes: Sequence["Slopes"]) -> list[ScreeningResult]:
        """The best of the steps from each; where it stands if none leads down."""
        best, done = [], 0
        for some in self._together([s.here for s in slopes]):
            own = slopes[done : done + len(some)]
            tried = np.stack([s.tried for s in own])
            each = [tried.reshape(-1, tried.shape[-1])] * len(self.problem.trials)
            left = np.concatenate(self._residuals(some, each), axis=1)
            left = left.reshape(*tried.shape[:-1], left.shape[-1])
            costs = robust_cost(some[0].unknowns, tried, left, thresholds.ROBUST_SIGMAS)
            costs = np.where(np.isfinite(costs), costs, np.inf)
            for i, (r, k) in enumerate(zip(some, np.argmin(costs, axis=1), strict=True)):
                down = costs[i, k] < r.cost
                further = replace(r, z=tried[i, k], cost=float(costs[i, k]), residual=left[i, k])
                best.append(further if down else r)
            done += len(some)
        return best

    def _together(self, results: Sequence[ScreeningResult]) -> Iterator[list[ScreeningResult]]:
        """In groups that one call of the model can run; what has a memory of its own begins with
        what its own numbers left in it.
        """
        if not results:
            return
        model = results[0].unknowns.model
        is_shared = model.kernel is self.problem.run_sets[0].model.kernel or model.state_size == 6
        most = thresholds.STARTS_TOGETHER if is_shared else 1
        for i in range(0, len(results), most):
            yield list(results[i : i + most])

    def _residuals(
        self, some: Sequence[ScreeningResult], each: Sequence[Floats]
    ) -> Sequence[Floats]:
        """Of each trial at z (K, n), as many of each result in turn -> (K, N).

        Results differ in what is fitted, and in what is not: moments, choices.
        """
        unknowns = some[0].unknowns
        thetas = np.stack([r.unknowns.model.theta for r in some])
        fitted = {u.name for u in unknowns.each}
        differ = [
            i for i in np.flatnonzero(np.ptp(thetas, axis=0))
            if unknowns.model.names[i] not in fitted
        ]  # fmt: skip
        run_sets = self.problem.run_sets_for(unknowns, some[0].z)
        wide = [
            np.hstack([z, np.repeat(thetas[:, differ], len(z) // len(some), axis=0)]) for z in each
        ]
        further = unknowns.beside([unknowns.model.names[i] for i in differ]) if differ else unknowns
        return residuals_of_trials(further, run_sets, wide)


class Slopes(NamedTuple):
    """A result with its residuals and cost, numbers (K, n) that its slopes lead to, the least cost
    that they promise there.
    """

    here: ScreeningResult
    tried: Floats
    promised: float


class Begun(NamedTuple):
    """An effect after a few steps, on which rows and base, and the cost that slopes still promise:
    what it has where the last step brought little.
    """

    screening: Screening
    result: ScreeningResult
    promised: float

    @property
    def is_settled(self) -> bool:
        """Whether no less is promised."""
        return self.promised >= self.result.cost


def moment_of(effect: Effect) -> str | None:
    """The parameter that is the moment of an event; None where there is none."""
    return next((p.name for p in effect.parameters if p.kind is Kind.MOMENT), None)
