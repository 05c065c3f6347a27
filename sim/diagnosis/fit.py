"""A vessel with effects, fitted on common ground: base, effects and offsets in time together.

    minimise  Σ ρ(rᵢ(z)) + ‖(z − z₀) / prior‖²,     r: whitened errors without what starts explain

The base is fitted along with every effect: a base that is frozen where it is a little off is
blamed on whatever effect lies nearest.

When an event happened, and how sure that is: a fault, a load taken aboard.

    rise(t) = c(t) − min c,     c(t) = ½ min over δ of ‖√w (r_t + J δ)‖² + priors

A moment has no slope: nothing changes until it passes a sample, nor while the motor that failed
rests. So it is moved along the trial, with all other numbers following to first order, and the
interval holds all moments around the best whose rise stays below that of a Gaussian at its limit
(profile likelihood: Venzon and Moolgavkar, Applied Statistics 37, 1988).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.thresholds import RELIEF
from sim.effects.effect import Kind
from sim.identification.parameters import Unknown, Unknowns, unknowns_of
from sim.identification.search import (
    SearchLimits,
    damped_steps,
    robust_cost,
    robust_weights,
    search,
)
from sim.identification.settings import BASE, IdentifySettings
from sim.identification.shooting import jacobian_of, residuals_of
from sim.model import Model
from sim.state import Floats
from sim.vessel import AddedEffect

Rows = NDArray[np.bool_] | slice
ROBUST = 4.0  # standard deviations: a residual beyond counts less
STEPS = 6  # of the search
FURTHEST = 3.0  # standard deviations of a number that was given
FAR = 1.0  # standard deviations: a base that has moved so may have lost its way


class Refits(NamedTuple):
    """Numbers (K, n) without each fold of the ground in turn, and all residuals then (K, N)."""

    z: Floats
    residual: Floats


@dataclass(frozen=True)
class Fit:
    """Effects beside the re-fitted base: z (n,) and what is left, (N,) whitened."""

    added: tuple[AddedEffect, ...]
    unknowns: Unknowns
    ground: FitProblem
    z: Floats
    residual: Floats

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(a.effect.name for a in self.added)

    @cached_property
    def slope(self) -> Floats:
        """∂ residual / ∂ z: (N, n)."""
        windows = self.ground.seen_by(self.unknowns, self.z)
        return jacobian_of(self.unknowns, windows, self.z)

    @cached_property
    def weight(self) -> Floats:
        """How much each residual counts, (N,): outliers less."""
        return robust_weights(self.residual, ROBUST)

    def steps(self, residual: Floats, rows: Rows = slice(None)) -> Floats:
        """Gauss–Newton steps (K, n) that some residuals ask for, the first not damped."""
        return damped_steps(
            self.unknowns, self.z, residual[rows], self.slope[rows], self.weight[rows]
        )

    @cached_property
    def refits(self) -> Refits:
        """The best of a few damped Gauss–Newton steps for each fold; none where all are worse."""
        seen = np.array([rows for rows, _ in self.ground.folds()])[:, None]
        steps = np.array([self.steps(self.residual, rows) for rows, _ in self.ground.folds()])
        steps = np.concatenate([np.zeros_like(steps[:, :1]), steps], axis=1)
        z = np.clip(self.z + steps, *self.unknowns.bounds)
        residual = self.at(z.reshape(-1, len(self.z))).reshape(*z.shape[:2], -1)
        best = robust_cost(self.unknowns, z, residual, ROBUST, seen).argmin(axis=1)
        fold = np.arange(len(z))
        return Refits(z[fold, best], residual[fold, best])

    @property
    def cost(self) -> float:
        """What the search lowered."""
        return float(robust_cost(self.unknowns, self.z, self.residual, ROBUST))

    def at(self, z: Floats) -> Floats:
        """Residuals (K, N) at other numbers z (K, n)."""
        return residuals_of(self.unknowns, self.ground.seen_by(self.unknowns, z[0]), z)

    def values(self, effect: str, trial: int = 0) -> Mapping[str, float]:
        """The parameters of one of the effects, as found on a trial."""
        theta, model = self.unknowns.theta(self.z[None], trial)[0], self.unknowns.model
        places = {n: i for i, n in enumerate(model.names) if n.startswith(f"{effect}.")}
        return {n.partition(".")[2]: float(theta[i]) for n, i in places.items()}

    def found(self, trial: int = 0) -> tuple[AddedEffect, ...]:
        """The effects with the parameters found."""
        return tuple(
            AddedEffect(a.effect, dict(self.values(a.effect.name, trial))) for a in self.added
        )


def unknowns_for(
    wide: SupersetModel, added: Sequence[AddedEffect], trials: int, settings: IdentifySettings
) -> Unknowns:
    """What is looked for with these effects in the vessel; they give where its effects start."""
    free = [f"{a.effect.name}.{key}" for a in added for key in a.effect.fit_parameters]
    model = wide.with_added(added)
    found = unknowns_of(model, trials, replace(settings, free=(*settings.free, *free)))
    return replace(found, each=tuple(_within_reason(u) for u in found.each))


def _within_reason(u: Unknown) -> Unknown:
    """A number that was given may be off by a few times its doubt, and no more.

    Without a limit the base takes a shape that no hull has, to stand in for what is missing; from
    there no effect finds its way back.
    """
    if u.name not in BASE or u.assumed:
        return u
    lower, upper = u.start - FURTHEST * u.prior, u.start + FURTHEST * u.prior
    return replace(u, lower=max(u.lower, lower), upper=min(u.upper, upper))


def started(unknowns: Unknowns, like: "Fit | None") -> Floats:
    """z (n,) that begins where another fit ended, as far as both look for the same numbers."""
    z = unknowns.start.copy()
    if like is not None:
        known = {(u.name, u.trial): x for u, x in zip(like.unknowns.each, like.z, strict=True)}
        for i, u in enumerate(unknowns.each):
            z[i] = known.get((u.name, u.trial), z[i])
    return z


def as_given(unknowns: Unknowns, z: Floats) -> Floats | None:
    """z (n,) with the base as it was given; None where it has hardly left that.

    A base that stood in for what is missing may have ended where no effect finds its way back.
    """
    base = np.array([u.name in BASE for u in unknowns.each])
    if not np.any(base & (np.abs(unknowns.prior_residuals(z)) > FAR)):
        return None
    return np.where(base, unknowns.start, z)


def fitted(
    added: Sequence[AddedEffect],
    unknowns: Unknowns,
    ground: FitProblem,
    z: Floats,
    steps: int = STEPS,
) -> Fit:
    """The best z from a start, by least squares with bounds."""
    windows = ground.seen_by(unknowns, z)
    residuals = partial(residuals_of, unknowns, windows)
    slope = partial(jacobian_of, unknowns, windows)
    found = search(residuals, slope, unknowns, z, SearchLimits(ROBUST, steps))
    left = found.fun[: len(ground.block)]
    return Fit(tuple(added), unknowns, ground, np.asarray(found.x), left)


POINTS = 28  # to either side, wider apart the further away
LIMIT = 0.5 * 2.0**2 * RELIEF  # nats, of rows that hang together: two standard deviations


def moments_in(fit: Fit) -> tuple[str, ...]:
    """Names `effect.parameter` of all events of a fit."""
    return tuple(
        f"{a.effect.name}.{p.name}"
        for a in fit.added
        for p in a.effect.parameters
        if p.kind is Kind.MOMENT
    )


def at_its_moment(fit: Fit, name: str) -> Fit:
    """The same with an event moved to where the data have it."""
    times, rise, z = _profile(fit, name)
    best = int(np.argmin(rise))
    unknowns = replace(fit.unknowns, model=_moved(fit, name, times[best]))
    windows = fit.ground.seen_by(unknowns, z[best])
    residual = residuals_of(unknowns, windows, z[best][None])[0]
    return Fit(fit.added, unknowns, fit.ground, z[best], residual)


def interval(fit: Fit, name: str) -> tuple[float, float]:
    """95 % interval [s] of the moment of an event: from where it stands to where the data have it.

    The two are one after `at_its_moment`; a rival's event may stand beside.
    """
    times, rise, _ = _profile(fit, name)
    here, best = int(np.argmin(np.abs(times - _moment(fit, name)))), int(np.argmin(rise))
    low, high = min(here, best), max(here, best)
    while low > 0 and rise[low] < LIMIT:
        low -= 1
    while high < len(times) - 1 and rise[high] < LIMIT:
        high += 1
    return float(times[low]), float(times[high])


def _profile(fit: Fit, name: str) -> tuple[Floats, Floats, Floats]:
    """Moments (M,) [s], how much worse than the best of them (M,), the other numbers (M, n)."""
    trial = max(fit.ground.trials, key=len)
    apart = np.geomspace(trial.dt, trial.time[-1], POINTS)
    times = _moment(fit, name) + np.concatenate([-apart[::-1], [0.0], apart])
    times = times[(times >= 0.0) & (times <= trial.time[-1])]
    cost, z = [], []
    for t in times:
        unknowns = replace(fit.unknowns, model=_moved(fit, name, t))
        r = residuals_of(unknowns, fit.ground.seen_by(unknowns, fit.z), fit.z[None])[0]
        step = fit.steps(r)[0]
        left, pull = r + fit.slope @ step, fit.unknowns.prior_residuals(fit.z + step)
        cost.append(0.5 * (fit.weight @ left**2 + pull @ pull))
        z.append(np.clip(fit.z + step, *fit.unknowns.bounds))
    return times, np.array(cost) - min(cost), np.array(z)


def _moment(fit: Fit, name: str) -> float:
    model = fit.unknowns.model
    return float(model.theta[model.names.index(name)])


def _moved(fit: Fit, name: str, time: float) -> Model:
    """The model with the event at another time."""
    theta = fit.unknowns.model.theta.copy()
    theta[fit.unknowns.model.names.index(name)] = time
    return replace(fit.unknowns.model, theta=theta)
