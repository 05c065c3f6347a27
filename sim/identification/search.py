"""The search that all fits share: robust least squares within bounds, with priors.

    minimise over z   Σ ρ(rᵢ(z)) + ‖(z − z₀) / prior‖²

Jacobians are differences: all changes of z are one call of the model, of many short recordings
too, and a recording is run only for the parameters that act on it. Source: Branch, Coleman and Li,
SIAM J. Sci. Comput. 21, 1999 (the search of `scipy.optimize.least_squares`).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from sim.identification.parameters import Unknowns
from sim.state import Floats

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
    known = np.array([1.0 / u.prior for u in unknowns.each])
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
    """How much each residual counts beside small ones, (...): those beyond `robust` less."""
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
    """Gauss–Newton steps (K, n) from z (n,), damped more and more.

    residual (N,), jacobian (N, n), weight (N,). Damped, and not shortened: what the rows hardly
    determine (the mass of a hull that does not slip) would run far along a line that is bent, and a
    share of the whole step holds back with it all that they do. Source: Marquardt, J. SIAM 11,
    1963.
    """
    known = np.array([u.prior for u in unknowns.each]) ** -2.0
    H = jacobian.T @ (weight[:, None] * jacobian) + np.diag(known)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    s = jacobian.T @ (weight * residual) + known * (z - unknowns.start)
    w, V = np.linalg.eigh(H * np.outer(scale, scale))
    stiff = np.where(w > MIN_CURVATURE * w[-1], w + DAMPING[:, None], np.inf)
    return np.asarray(-scale * ((V.T @ (scale * s) / stiff) @ V.T))


def moved_by_steps(
    unknowns: Unknowns, z: Floats, columns: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """z (n,), then with some of its numbers moved within bounds: (k + 1, n), and the steps (k,)."""
    _, upper = unknowns.bounds
    step = np.array([u.step for u in unknowns.each])
    step = np.where(z + step > upper, -step, step)[columns]
    moved = np.tile(z, (len(columns) + 1, 1))
    moved[np.arange(len(columns)) + 1, columns] += step
    return moved, step


def residuals_and_jacobian(
    residuals: ResidualsOfTrials, trials: Sequence[int], unknowns: Unknowns, z: Floats,
    columns: NDArray[np.int64] | None = None,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Residuals (N,) at z (n,) of trials by number, one after another, and their Jacobian (N, n).

    Only some `columns` of it, if given; the others are zero. A trial is run for those of its own.
    """
    wanted = np.arange(len(z)) if columns is None else columns
    mine = [np.intersect1d(wanted, unknowns.columns_of_trial(trial)) for trial in trials]
    moved = [moved_by_steps(unknowns, z, own) for own in mine]
    each = residuals([points for points, _ in moved])
    J = np.zeros((sum(r.shape[1] for r in each), len(z)))
    done = 0
    for r, own, (_, step) in zip(each, mine, moved, strict=True):
        J[done : done + r.shape[1], own] = ((r[1:] - r[0]) / step[:, None]).T
        done += r.shape[1]
    return np.concatenate([r[0] for r in each]), J
