"""The search that all fits share: robust least squares within bounds, with priors.

    minimise over z   Σ ρ(rᵢ(z)) + ‖(z − z₀) / prior‖²

Jacobians are differences: all changes of z are one call of the model, of many short recordings
too, and a recording is run only for the parameters that act on it. Source: Branch, Coleman and Li,
SIAM J. Sci. Comput. 21, 1999 (the search of `scipy.optimize.least_squares`).

**Start points** of the search for an effect's parameters are a grid.

A number begins at its `start`, on either side of zero where its limits are symmetric; an angle at
the four quarters, unless it is the direction of a magnitude, which is fitted as north and east
parts; the moment of an event every so often along the trial, because nothing changes until it
passes a sample; a choice at each thruster. A parameter may declare starts of its own
(`Parameter.starts`), and an effect its own search (`Effect.search`).
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from sim.effects.effect import QUARTERS, Effect, Kind, Parameter, ResidualForce, Role, Values
from sim.identification.parameters import Unknowns
from sim.model import Model
from sim.prediction import missing_force_only, vessel_commands
from sim.state import Eta, Floats, turned
from sim.trial import Trial
from sim.vessel import Vessel

# Chosen, not measured:
DAMPING = np.array([0.0, 0.01, 0.1, 1.0])  # of each parameter's own curvature, added to it
MIN_CURVATURE = 1e-10  # of the largest: what has less is not determined, and does not move
COST_CHANGE = 1e-5  # relative: a smaller one ends a search

Residuals = Callable[[Floats], Floats]  # z (K, n) -> residuals (K, N)
ResidualsOfTrials = Callable[[Sequence[Floats]], Sequence[Floats]]  # the same of each trial


class SearchLimits(NamedTuple):
    """When a search ends, and from how large a residual on one counts less.

    iterative: inner steps by conjugate gradients, for searches of many parameters
    """

    robust: float
    steps: int
    change: float = 1e-4  # of z
    iterative: bool = False


def search(
    residuals: Residuals, jacobian: Callable[[Floats], Floats], unknowns: Unknowns, z: Floats,
    limits: SearchLimits,
) -> OptimizeResult:  # fmt: skip
    """The best z from a start (n,); `fun` and `jac` end with the rows of the priors.

    `jacobian` gives ∂ residuals / ∂ z (N, n) at z (n,).
    """
    known = 1.0 / unknowns.prior
    has_prior = known > 0.0
    lower, upper = unknowns.bounds

    def with_priors(z: Floats) -> Floats:
        return np.append(residuals(z[None])[0], unknowns.prior_residuals(z)[has_prior])

    def jacobian_with_priors(z: Floats) -> Floats:
        return np.vstack([jacobian(z), np.diag(known)[has_prior]])

    how = {"tr_solver": "lsmr", "tr_options": {"atol": 1e-10, "btol": 1e-10}}
    return least_squares(
        with_priors, np.clip(z, lower, upper), jacobian_with_priors, bounds=(lower, upper),
        loss="soft_l1", f_scale=limits.robust, x_scale=np.array([u.scale for u in unknowns.each]),
        max_nfev=limits.steps, xtol=limits.change, ftol=COST_CHANGE,
        **(how if limits.iterative else {}),
    )  # fmt: skip


def robust_weights(residual: Floats, robust: float) -> Floats:
    """Weight of each residual (...), 1 for small ones: those beyond `robust` count less."""
    return np.asarray(1.0 / np.sqrt(1.0 + (residual / robust) ** 2))


def robust_cost(
    unknowns: Unknowns, z: Floats, residual: Floats, robust: float,
    rows: NDArray[np.bool_] | None = None,
) -> Floats:  # fmt: skip
    """Half the robust sum of squares at each z (..., n), priors included: (...).

    `rows`, like the residuals (..., N): those that count; else all.
    """
    each = robust**2 * (np.sqrt(1.0 + (residual / robust) ** 2) - 1.0)
    if rows is not None:
        each = each * rows
    prior = unknowns.prior_residuals(z)
    return np.asarray(np.sum(each, axis=-1) + 0.5 * np.sum(prior**2, axis=-1))


def damped_steps(
    unknowns: Unknowns, z: Floats, residual: Floats, jacobian: Floats, weight: Floats
) -> Floats:
    """Gauss–Newton steps (..., K, n) from z (..., n), damped more and more.

    residual (..., N), jacobian (..., N, n), weight (..., N). Damped, and not shortened: what the
    rows hardly determine (the mass of a hull that does not slip) would run far along a line that is
    bent, and a share of the whole step holds back with it all that they do. Source: Marquardt, J.
    SIAM 11, 1963.
    """
    known = unknowns.prior**-2.0
    transposed = jacobian.swapaxes(-1, -2)
    H = transposed @ (weight[..., None] * jacobian) + np.diag(known)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H, axis1=-2, axis2=-1), 1e-300))
    s = np.einsum("...jn,...n->...j", transposed, weight * residual) + known * (z - unknowns.start)
    w, V = np.linalg.eigh(H * scale[..., :, None] * scale[..., None, :])
    w = w[..., None, :]
    stiff = np.where(w > MIN_CURVATURE * w[..., -1:], w + DAMPING[:, None], np.inf)
    along = np.einsum("...ij,...i->...j", V, scale * s)[..., None, :] / stiff
    return np.asarray(-scale[..., None, :] * (along @ V.swapaxes(-1, -2)))


def moved_by_steps(
    unknowns: Unknowns, z: Floats, columns: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """z (..., n), then with some of its numbers moved within bounds: (..., k + 1, n), and the steps
    (..., k).
    """
    _, upper = unknowns.bounds
    step = np.where(z + unknowns.step > upper, -unknowns.step, unknowns.step)[..., columns]
    moved = np.repeat(z[..., None, :], len(columns) + 1, axis=-2)
    moved[..., np.arange(len(columns)) + 1, columns] += step
    return moved, step


def residuals_and_jacobian(
    residuals: ResidualsOfTrials, trials: Sequence[int], unknowns: Unknowns, z: Floats,
    columns: NDArray[np.int64] | None = None, known: Floats | None = None,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Residuals (..., N) at z (..., n) of trials by number, one after another, and their Jacobian
    (..., N, n).

    Only some `columns` of it, if given; the others are zero. A trial is run for those of its own;
    where there are several z, for all that belongs to the first, then the second, and so on.
    `known`: the residuals at z, where they are at hand.
    """
    wanted = np.arange(z.shape[-1]) if columns is None else columns
    mine = [np.intersect1d(wanted, unknowns.columns_of_trial(trial)) for trial in trials]
    moved = [moved_by_steps(unknowns, z, own) for own in mine]
    here = known if all(map(len, mine)) else None
    points = [p if here is None else p[..., 1:, :] for p, _ in moved]
    found = residuals([p.reshape(-1, z.shape[-1]) for p in points])
    each = [r.reshape(*p.shape[:-1], r.shape[-1]) for r, p in zip(found, points, strict=True)]
    if here is None:
        here = np.concatenate([r[..., 0, :] for r in each], axis=-1)
        each = [r[..., 1:, :] for r in each]
    J, done = np.zeros((*here.shape, z.shape[-1])), 0
    for r, own, (_, step) in zip(each, mine, moved, strict=True):
        rows = slice(done, done + r.shape[-1])
        slopes = (r - here[..., None, rows]) / step[..., None]
        J[..., rows, own] = slopes.swapaxes(-1, -2)
        done = rows.stop
    return here, J


# Chosen, not measured:
MOMENT_STARTS = 12  # times of an event along a trial
PERIOD_STARTS = 7
SHORTEST_PERIOD_S = 30.0
LONGEST_PERIOD = 2.0  # lengths of the longest trial: a slower oscillation is a trend


def start_points(effect: Effect, model: Model, trials: Sequence[Trial]) -> list[Values]:
    """All points that a search for the effect begins from."""
    if effect.search is not None:
        longest_trial = max(trials, key=lambda trial: (trial.usable.any(), len(trial)))
        return list(effect.search(model.vessel, partial(residual_force, model, longest_trial)))
    if effect.tables is not None:
        nu = np.concatenate([trial.nu[trial.usable] for trial in trials])
        low, high = nu.min(axis=0), nu.max(axis=0)
        extent = {n: (float(low[i]), float(high[i])) for i, n in enumerate("uvr")}
        place = np.concatenate([trial.eta[trial.usable, : Eta.YAW] for trial in trials])
        for i, n in enumerate(("north", "east")):
            extent[n] = (float(place[:, i].min()), float(place[:, i].max()))
        swing = np.quantile(nu[:, 0] * nu[:, 2], [0.005, 0.995])
        extent["swing"] = (float(swing[0]), float(swing[1]))
        volts = np.concatenate([trial.voltage[trial.usable] for trial in trials])
        if np.isfinite(volts).any():  # a reading while a battery is changed is no voltage
            low_volts, high_volts = np.nanquantile(volts, [0.005, 0.995])
            extent["voltage"] = (float(low_volts), float(high_volts))
        if model.vessel.thrusters:
            commands = [vessel_commands(model, trial)[trial.usable] for trial in trials]
            motors = np.concatenate(commands)[:, : len(model.vessel.thrusters)]
            extent["motor"] = (float(motors.min()), float(motors.max()))
        extent["time"] = (0.0, max(float(trial.time[-1]) for trial in trials))
        return list(effect.tables(model.vessel, extent))
    longest = max(float(t.time[-1]) for t in trials)
    directions = {p.direction for p in effect.parameters}
    values = [_values(p, p.name in directions, model.vessel, longest) for p in effect.parameters]
    names = [p.name for p in effect.parameters]
    return [dict(zip(names, point, strict=True)) for point in product(*values)]


def residual_force(model: Model, trial: Trial) -> ResidualForce:
    """Horizontal missing force of a model in a trial's usable rows, without its mean."""
    force, yaw = missing_force_only(trial, model), trial.eta[:, Eta.YAW]
    world = turned(force[:, :2], yaw)
    use = trial.usable
    world = (world - world[use].mean(axis=0))[use]
    commands = vessel_commands(model, trial)[use, : len(model.vessel.thrusters)]
    return ResidualForce(
        trial.time[use], trial.eta[use, : Eta.YAW], world, force[use], trial.nu[use], commands,
        yaw[use],
    )  # fmt: skip


def _values(p: Parameter, paired: bool, vessel: Vessel, longest: float) -> Sequence[float]:
    """Starts of one parameter; `paired`: the direction of a magnitude; `longest` trial [s]."""
    if p.starts:
        return p.starts
    if p.kind is Kind.MOMENT:
        return [float(t) for t in np.linspace(0.0, longest, MOMENT_STARTS + 2)[1:-1]]
    if p.kind is Kind.CHOICE:
        count = len(vessel.thrusters)
        first = 1 if count == 1 else int(p.lower)  # of a single one "all" would say the same again
        return [float(i) for i in range(first, count + 1)]
    if p.role is Role.PERIOD:
        shortest = max(p.lower, SHORTEST_PERIOD_S)
        return [float(t) for t in np.geomspace(shortest, LONGEST_PERIOD * longest, PERIOD_STARTS)]
    if p.kind is Kind.CIRCLE and not paired:
        return QUARTERS
    return (p.start, -p.start) if p.lower == -p.upper and p.start != 0.0 else (p.start,)
