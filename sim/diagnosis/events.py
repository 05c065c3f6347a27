"""When an event happened, and how sure that is: a fault, a load taken aboard.

    rise(t) = c(t) − min c,     c(t) = ½ min over δ of ‖√w (r_t + J δ)‖² + priors

A moment has no slope: nothing changes until it passes a sample, nor while the motor that failed
rests. So it is moved along the trial, with all other numbers following to first order, and the
interval holds all moments around the best whose rise stays below that of a Gaussian at its limit
(profile likelihood: Venzon and Moolgavkar, Applied Statistics 37, 1988).
"""

from dataclasses import replace

import numpy as np

from sim.diagnosis.fit import Fit
from sim.diagnosis.weights import RELIEF
from sim.effects.effect import Kind
from sim.identification.shooting import residuals_of
from sim.model import Model
from sim.state import Floats

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
        left, pull = r + fit.slope @ step, fit.unknowns.prior(fit.z + step)
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
