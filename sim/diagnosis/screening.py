"""Screening of the whole catalogue: where each effect would best begin, and what it promises.

From each start one damped Gauss–Newton step of the effect's own numbers together with those of the
reference, whose slopes are worked out once; from the best start a few more. This costs little
enough to try a hundred starts: the fit that decides comes later, for the few that promise most.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, start_values, unknowns_for
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.effects.effect import Effect, Kind, Values
from sim.identification.parameters import Unknowns
from sim.identification.search import (
    damped_steps,
    residuals_and_jacobian,
    robust_cost,
    robust_weights,
)
from sim.identification.shooting import residuals_of
from sim.identification.starts import MOMENT_STARTS, start_points
from sim.model import Model
from sim.state import Floats
from sim.vessel import AddedEffect

Progress = Callable[[str], None]  # is given what is being done, in words
Mapper = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # maps as `map` does


@dataclass(frozen=True)
class ScreeningResult:
    """One effect at the best start found: z (n,) of its unknowns, and the cost there."""

    added: AddedEffect
    unknowns: Unknowns
    z: Floats
    cost: float

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.added.effect.name


def screen(
    superset: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    progress: Progress = lambda _: None, mapper: Mapper = map,
) -> list[ScreeningResult]:  # fmt: skip
    """All effects beside those that the reference holds, the most promising first.

    `model` is the vessel as the reference has it: waves are looked for in what it lacks. `mapper`
    may be that of a pool of threads: the kernels leave the interpreter free.
    """
    fine, coarse = (
        _Screening.of(superset, reference, reference.problem.thinned(rows))
        for rows in (thresholds.SCREENED_ROWS, thresholds.COARSE_ROWS)
    )

    def best(effect: Effect) -> ScreeningResult | None:
        progress(effect.name)
        starts = start_points(effect, model, reference.problem.trials)
        return fine.best(
            effect, coarse.few(effect, starts) if len(starts) > thresholds.MANY_STARTS else starts
        )

    results = [r for r in mapper(best, effects) if r is not None]
    return sorted(results, key=lambda r: r.cost)


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
        residuals = partial(residuals_of, unknowns, problem.run_sets_for(unknowns, z))
        _, jacobian = residuals_and_jacobian(residuals, unknowns, z, np.arange(len(unknowns)))
        return cls(superset, reference, problem, jacobian)

    def best(self, effect: Effect, starts: Sequence[Values]) -> ScreeningResult | None:
        """From every start one step; from the best one a few more."""
        tried = [r for r in (self._step(self._at(effect, s)) for s in starts) if r is not None]
        if not tried:
            return None
        best = min(tried, key=lambda r: r.cost)
        for _ in range(thresholds.MAX_SCREENING_STEPS):
            further = self._step(best)
            if further is None or further.cost >= best.cost * (1.0 - thresholds.MIN_COST_DECREASE):
                break
            best = further
        moment = next((p.name for p in effect.parameters if p.kind is Kind.MOMENT), None)
        return best if moment is None else self._closed_in(best, moment)

    def _closed_in(self, best: ScreeningResult, moment: str) -> ScreeningResult:
        """The moment of an event by bisection: no slope leads to it."""
        longest = max(float(t.time[-1]) for t in self.problem.trials)
        apart = 0.5 * longest / (MOMENT_STARTS + 1)
        while apart > thresholds.MOMENT_RESOLUTION_S:
            values, near = best.added.values, []
            for d in (-apart, apart):
                moved = self._at(best.added.effect, {**values, moment: values[moment] + d})
                near.append(self._step(replace(moved, z=best.z)))
            best = min([best, *(r for r in near if r is not None)], key=lambda r: r.cost)
            apart *= 0.5
        return best

    def few(self, effect: Effect, starts: Sequence[Values]) -> list[Values]:
        """The starts that lead furthest in one step."""
        tried = [self._step(self._at(effect, s)) for s in starts]
        costs = [(r.cost, i) for i, r in enumerate(tried) if r is not None]
        return [starts[i] for _, i in sorted(costs)[: thresholds.MANY_STARTS // 2]]

    def _at(self, effect: Effect, start: Values) -> ScreeningResult:
        """A start, before the first step."""
        added = AddedEffect(effect, dict(start))
        trials, settings = len(self.problem.trials), self.problem.settings
        unknowns = unknowns_for(self.superset, [*self.reference.added, added], trials, settings)
        return ScreeningResult(added, unknowns, start_values(unknowns, self.reference), np.inf)

    def _step(self, r: ScreeningResult) -> ScreeningResult | None:
        """The best of a few Levenberg–Marquardt steps; None where the model is lost."""
        unknowns, z = r.unknowns, np.clip(r.z, *r.unknowns.bounds)
        known = {(u.name, u.trial): i for i, u in enumerate(self.reference.unknowns.each)}
        place = np.array([known.get((u.name, u.trial), -1) for u in unknowns.each])
        own, shared = np.flatnonzero(place < 0), np.flatnonzero(place >= 0)
        residuals = partial(residuals_of, unknowns, self.problem.run_sets_for(unknowns, z))
        residual, of_own = residuals_and_jacobian(residuals, unknowns, z, own)
        J = np.zeros((len(residual), len(place)))
        J[:, own], J[:, shared] = of_own, self.jacobian[:, place[shared]]
        if not np.isfinite(J).all():
            return None
        weight = robust_weights(residual, thresholds.ROBUST_SIGMAS)
        tried = np.clip(z + damped_steps(unknowns, z, residual, J, weight), *unknowns.bounds)
        costs = robust_cost(unknowns, tried, residuals(tried), thresholds.ROBUST_SIGMAS)
        k = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
        here = float(robust_cost(unknowns, z, residual, thresholds.ROBUST_SIGMAS))
        if here <= costs[k]:
            return replace(r, z=z, cost=here)
        return replace(r, z=tried[k], cost=float(costs[k]))
