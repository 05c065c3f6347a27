"""A quick look at every effect of the catalogue: where it would best begin, and what it promises.

From each start one damped Gauss–Newton step of the effect's own numbers together with those of the
reference, whose slopes are worked out once; from the best start a few more. What it costs is little
enough to try a hundred starts: the fit that decides comes later, for the few that promise most.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sim.diagnosis.fit import ROBUST, Fit, started, unknowns_for
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

ROWS = 2500  # that a quick look is taken at
FEWER = 1000  # where many starts are compared
MANY = 4  # starts
MORE = 4  # steps from the best start
CLOSE = 1.0  # s, to which the moment of an event is closed in on

Tell = Callable[[str], None]  # hears in words what is being done
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # maps as `map` does


@dataclass(frozen=True)
class Promise:
    """One effect at the best start found: z (n,) of its unknowns, and the cost there."""

    effect: Effect
    added: AddedEffect
    unknowns: Unknowns
    z: Floats
    cost: float


def screened(
    wide: SupersetModel, model: Model, effects: Iterable[Effect], reference: Fit,
    tell: Tell = lambda _: None, each: Each = map,
) -> list[Promise]:  # fmt: skip
    """All effects beside those that the reference holds, the most promising first.

    `model` is the vessel as the reference has it: waves are looked for in what it lacks. `each`
    maps as `map` does; that of a pool of threads serves, as the kernels leave the interpreter free.
    """
    trials = reference.ground.trials
    look, glance = (
        _Look.of(wide, reference, reference.ground.thinned(rows)) for rows in (ROWS, FEWER)
    )

    def one(effect: Effect) -> Promise | None:
        tell(effect.name)
        starts = start_points(effect, model, trials)
        return look.best(effect, glance.few(effect, starts) if len(starts) > MANY else starts)

    found = [p for p in each(one, effects) if p is not None]
    return sorted(found, key=lambda p: p.cost)


@dataclass(frozen=True)
class _Look:
    """What every quick look shares: the reference on few rows, and its slopes there."""

    wide: SupersetModel
    reference: Fit
    ground: FitProblem
    slope: Floats

    @classmethod
    def of(cls, wide: SupersetModel, reference: Fit, ground: FitProblem) -> "_Look":
        windows = ground.seen_by(reference.unknowns, reference.z)
        residuals = partial(residuals_of, reference.unknowns, windows)
        every = np.arange(len(reference.unknowns))
        _, slope = residuals_and_jacobian(residuals, reference.unknowns, reference.z, every)
        return cls(wide, reference, ground, slope)

    def best(self, effect: Effect, starts: Sequence[Values]) -> Promise | None:
        """From every start one step; from the best one a few more."""
        tried = [p for p in (self.stepped(self.begun(effect, s)) for s in starts) if p]
        if not tried:
            return None
        chosen = self.followed(min(tried, key=lambda p: p.cost))
        moment = next((p.name for p in effect.parameters if p.kind is Kind.MOMENT), None)
        return chosen if moment is None else self.timed(chosen, moment)

    def followed(self, p: Promise) -> Promise:
        """Step after step, as long as they help."""
        for _ in range(MORE):
            further = self.stepped(p)
            if further is None or further.cost >= p.cost * (1.0 - 1e-4):
                break
            p = further
        return p

    def timed(self, p: Promise, moment: str) -> Promise:
        """The moment of an event closed in on: no slope tells where it is."""
        longest = max(float(t.time[-1]) for t in self.ground.trials)
        apart = 0.5 * longest / (MOMENT_STARTS + 1)
        while apart > CLOSE:
            at = p.added.values[moment]
            near = [self.moved(p, {moment: at + d}) for d in (-apart, apart)]
            p = min([p, *(q for q in near if q is not None)], key=lambda q: q.cost)
            apart *= 0.5
        return p

    def moved(self, p: Promise, values: Values) -> Promise | None:
        """The same with some of what is held changed, and one step from there."""
        fresh = self.begun(p.effect, {**p.added.values, **values})
        return self.stepped(replace(fresh, z=p.z))

    def few(self, effect: Effect, starts: Sequence[Values]) -> list[Values]:
        """The starts that lead furthest in one step."""
        tried = [(s, self.stepped(self.begun(effect, s))) for s in starts]
        told = [(p.cost, i, s) for i, (s, p) in enumerate(tried) if p is not None]
        return [s for _, _, s in sorted(told, key=lambda t: t[:2])[: MANY // 2]]

    def begun(self, effect: Effect, start: Values) -> Promise:
        """Before the first step."""
        added = AddedEffect(effect, dict(start))
        trials, settings = len(self.ground.trials), self.ground.settings
        unknowns = unknowns_for(self.wide, [*self.reference.added, added], trials, settings)
        return Promise(effect, added, unknowns, started(unknowns, self.reference), np.inf)

    def stepped(self, p: Promise) -> Promise | None:
        """The best of a few Levenberg–Marquardt steps; None where the model is lost."""
        p = replace(p, z=np.clip(p.z, *p.unknowns.bounds))
        windows = self.ground.seen_by(p.unknowns, p.z)
        known = {(u.name, u.trial): i for i, u in enumerate(self.reference.unknowns.each)}
        place = [known.get((u.name, u.trial), -1) for u in p.unknowns.each]
        own = np.flatnonzero(np.array(place) < 0)
        residuals = partial(residuals_of, p.unknowns, windows)
        residual, mine = residuals_and_jacobian(residuals, p.unknowns, p.z, own)
        J = np.zeros((len(residual), len(place)))
        J[:, own] = mine
        shared = np.flatnonzero(np.array(place) >= 0)
        J[:, shared] = self.slope[:, np.array(place)[shared]]
        if not np.isfinite(J).all():
            return None
        steps = damped_steps(p.unknowns, p.z, residual, J, robust_weights(residual, ROBUST))
        tried = np.clip(p.z + steps, *p.unknowns.bounds)
        costs = robust_cost(p.unknowns, tried, residuals(tried), ROBUST)
        k = int(np.argmin(costs))
        here = float(robust_cost(p.unknowns, p.z, residual, ROBUST))
        if here <= costs[k]:
            return Promise(p.effect, p.added, p.unknowns, p.z, here)
        return Promise(p.effect, p.added, p.unknowns, tried[k], float(costs[k]))
