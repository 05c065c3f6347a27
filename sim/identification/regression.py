"""Least squares as in the paper (LQS): the equations of motion are linear in the parameters.

    Φ(ν̇, ν) δ = τ,     δ = Φ⁺ τ  (Moore–Penrose),     std = √ diag(σ² (ΦᵀΦ)⁻¹)

    δ = (m − X_u̇, m − Y_v̇, I_z − N_ṙ, −X_u, −X_uu, −Y_v, −Y_vv, −N_r, −N_rr)
    X:  u̇ δ1 − v r δ2 + u δ4 + |u|u δ5
    Y:  v̇ δ2 + u r δ1 + v δ6 + |v|v δ7
    N:  ṙ δ3 + u v (δ2 − δ1) + r δ8 + |r|r δ9

The printed regressor leaves out the Munk moment u v (δ2 − δ1), although the paper's C(ν) contains
it; the consistent one is the default. Both ν and ν̇ are measured with errors, which biases δ
towards zero, and residuals are autocorrelated, which makes the textbook interval too narrow: it is
offered for comparison. Source: Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124.

A parameter that the rows do not determine (a boat that never turned, commands that were all zero)
has an infinite standard deviation and keeps the value of the vessel file.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from sim.identification import BASE
from sim.identification.parameters import UNITS
from sim.model import Model
from sim.prediction import commands_around, forces_along
from sim.prediction.segments import NotFiniteError
from sim.state import Floats, Nu
from sim.trial import Trial

DELTA_SIGN = np.where(np.arange(len(BASE)) < 3, 1.0, -1.0)  # inertia is δ, damping −δ
MAX_RANK_ERROR = 1e-6  # of the diagonal of Φ⁺Φ, which is 1 for a parameter that is determined


@dataclass(frozen=True)
class Regression:
    """SNAME parameters of `BASE` (9,) with standard deviations and 95 % intervals."""

    value: Floats
    std: Floats
    low: Floats
    high: Floats
    units: tuple[str, ...]

    @classmethod
    def of(cls, value: Floats, std: Floats, factor: float) -> "Regression":
        """`factor`: standard deviations in half an interval."""
        units = tuple(UNITS[name] for name in BASE)
        return cls(value, std, value - std * factor, value + std * factor, units)

    @property
    def delta(self) -> Floats:
        """δ1 … δ9 as the paper prints them."""
        return self.value * DELTA_SIGN


def regressor(nu: Floats, nu_dot: Floats, printed: bool = False) -> Floats:
    """ν, ν̇ (T, 3) -> Φ (T, 3, 9); times δ it is τ [N, N, N m]."""
    u, v, r = nu[:, Nu.U], nu[:, Nu.V], nu[:, Nu.R]
    phi = np.zeros((len(nu), 3, len(BASE)))
    phi[:, 0, 0], phi[:, 0, 1] = nu_dot[:, Nu.U], -v * r
    phi[:, 0, 3], phi[:, 0, 4] = u, np.abs(u) * u
    phi[:, 1, 0], phi[:, 1, 1] = u * r, nu_dot[:, Nu.V]
    phi[:, 1, 5], phi[:, 1, 6] = v, np.abs(v) * v
    phi[:, 2, 2], phi[:, 2, 7], phi[:, 2, 8] = nu_dot[:, Nu.R], r, np.abs(r) * r
    if not printed:
        phi[:, 2, 0], phi[:, 2, 1] = -u * v, u * v
    return phi


def ordinary_least_squares(phi: Floats, tau: Floats) -> tuple[Floats, Floats]:
    """Φ (T, 3, 9), τ (T, 3) -> δ (9,) and its textbook standard deviation (9,), inf where free."""
    A, b = phi.reshape(-1, phi.shape[-1]), tau.reshape(-1)
    inverse = np.linalg.pinv(A)
    delta = inverse @ b
    freedom = max(len(b) - len(delta), 1)
    variance = float(np.sum((b - A @ delta) ** 2)) / freedom
    std = np.sqrt(variance * np.diag(np.linalg.pinv(A.T @ A)))
    determined = np.abs(np.einsum("im,mi->i", inverse, A) - 1.0) < MAX_RANK_ERROR
    return delta, np.where(determined & b.any(), std, np.inf)


def fit_by_regression(trials: Sequence[Trial], model: Model, printed: bool = False) -> Regression:
    """The nine parameters from all usable rows; forces are those that the commands make."""
    phi, tau = [], []
    for trial in trials:
        rows = trial.usable
        phi.append(regressor(trial.nu[rows], trial.nu_dot[rows], printed))
        tau.append(command_forces(trial, model)[rows])
        if not np.isfinite(tau[-1]).all():
            raise NotFiniteError(f"{trial.name}: commanded forces are not finite")
    delta, std = ordinary_least_squares(np.concatenate(phi), np.concatenate(tau))
    degrees = max(3 * sum(map(len, phi)) - len(BASE), 1)
    value = np.where(np.isfinite(std), delta * DELTA_SIGN, base_values(model))
    return Regression.of(value, std, float(stdtrit(degrees, 0.975)))


def base_values(model: Model) -> Floats:
    """The nine parameters (9,) of `BASE` of a model."""
    return model.theta[[model.names.index(name) for name in BASE]]


def command_forces(trial: Trial, model: Model) -> Floats:
    """τ(commands) (T, 3) at the rows of the trial: between the commands before and after."""
    before, after = commands_around(model, trial)
    return forces_along(trial, model, before, 0.5 * (before + after))[1]
