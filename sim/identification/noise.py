"""Noise of the measured motion: a first-order process per channel, and the timing of commands.

    ε_k = ρ ε_{k−1} + √(1 − ρ²) σ w_k        whitened:  (ε_k − ρ ε_{k−1}) / (σ √(1 − ρ²))

Errors of receivers, compasses and smoothers wander. Taken for white they bias damping, because a
start state estimated from few correlated rows seems better known than it is. σ and ρ are those that
make the residuals most likely once the start states are projected out (restricted maximum
likelihood: Patterson and Thompson, Biometrika 58, 1971). The covariance that command timing adds
is scaled by the same likelihood.

A singular case has a defined answer: a start state that no row depends on is not corrected, and a
timing covariance that rounding has left indefinite counts without its negative eigenvalues.

**Timing of commands**. When a command changed between two messages is not recorded:

    x_{j+1} = F_j x_j + Σ_k M⁻¹ Δτ_k δ_k,     δ_k ~ N(0, σ²) [s]

Commands hold from message to message, so a change of force Δτ that was in fact δ earlier gives the
boat an impulse M⁻¹ Δτ δ that the model does not have, and the boat carries it on by F over a step.
At 25 messages a second that is ten times the error of a gyro. It is no error of the model: the
covariance of x is part of the noise. (Process noise from the input: Åström, Introduction to
Stochastic Control Theory, 1970, ch. 3.)

Sharpening. A shift of commands by the share f of a row takes f of one mean and 1 − f of its
neighbour, which spreads each change by √(f (1 − f)) rows. Taken for the boat's own sluggishness
that makes a hull turn in a third of a per cent too quickly. κ takes the second moment of that
spread out again:

    c'_k = c_k − κ (c_{k+1} − 2 c_k + c_{k−1}),     κ = ½ f (1 − f)
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.model import InputTable, Model
from sim.prediction import commands_around, forces_along
from sim.prediction.segments import VELOCITY_STEP, shifted_velocities
from sim.state import Floats, Ints
from sim.trial import Trial

# Grids of the likelihood: correlation times [s], and standard deviations of command timing as
# multiples of what message intervals leave open. Chosen, not measured.
CORRELATION_TIMES_S = (0.1, 0.25, 0.5, 0.8, 1.2, 1.8, 2.7, 4.0, 8.0)
COMMAND_TIMING_GRID = (0.0, 0.15, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5)
NOISE_ROWS = 1500  # rows that noise is estimated from; chosen, not measured
SHORT_RUN_ROWS = 5  # runs this short search the whole grid, longer ones the neighbours
CLIP_STD = 3.0  # standard deviations: a larger residual counts as this in σ
CHI2_MEDIAN = 0.455  # of one degree of freedom
# Smallest σ of u, v, r [m/s, m/s, rad/s], even of simulated, exact motion
MIN_SIGMA = np.array([1e-5, 1e-5, 1e-6])


class Noise(NamedTuple):
    """σ (3,) of u, v, r [m/s, m/s, rad/s] and ρ (3,) from row to row.

    command_timing  standard deviation of the times of commands, in multiples of what message
                    intervals leave open
    """

    sigma: Floats
    rho: Floats
    command_timing: float = 0.0

    def with_channel(self, i: int, sigma: float, rho: float) -> "Noise":
        """This noise with another σ and ρ of channel i."""
        chosen = np.arange(3) == i
        sigmas, rhos = np.where(chosen, sigma, self.sigma), np.where(chosen, rho, self.rho)
        return self._replace(sigma=sigmas, rho=rhos)


class RunErrors(NamedTuple):
    """Errors (S, n, 3), ∂ reported / ∂ start (S, n, 3, 3), rows that count (S, n) as 0 and 1.

    timing_covariance  (S, 3n, 3n) that command timing adds (`sim.identification.runs`)
    """

    error: Floats
    phi: Floats
    within: Floats
    timing_covariance: Floats | None = None


def whitened(error: Floats, noise: Noise) -> Floats:
    """Consecutive rows (..., n, 3) -> independent rows of unit variance."""
    unit = error / noise.sigma
    out = unit.copy()
    out[..., 1:, :] -= noise.rho * unit[..., :-1, :]
    out[..., 1:, :] /= np.sqrt(1.0 - noise.rho**2)
    return out


def timing_whitener(e: RunErrors, noise: Noise) -> tuple[Floats | None, float]:
    """W (S, cn, cn) that makes whitened rows independent under command timing, and log det W.

    The covariance may be that of all channels (c = 3), or of the last one alone (c = 1).
    """
    if e.timing_covariance is None or noise.command_timing == 0.0:
        return None, 0.0
    S, n = e.within.shape
    c = e.timing_covariance.shape[1] // n
    last = Noise(noise.sigma[-c:], noise.rho[-c:])
    U = noise.command_timing**2 * e.timing_covariance
    for _ in range(2):  # from the left, and from the right
        rows = np.moveaxis(U.reshape(S, n, c, c * n), -1, 0)
        white = whitened(rows, last) * e.within[..., None]
        U = np.moveaxis(white, 0, 1).reshape(S, c * n, c * n)
    try:
        L = np.linalg.cholesky(U + np.eye(c * n))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (U + np.swapaxes(U, 1, 2)))
        size = 1.0 + np.maximum(values, 0.0)
        W = np.swapaxes(vectors, 1, 2) / np.sqrt(size)[..., None]
        return W, -0.5 * float(np.log(size).sum())
    size = np.log(np.einsum("sii->si", L)).sum()
    return np.linalg.inv(L), -float(size)


def apply_whitener(rows: Floats, whitener: Floats | None) -> Floats:
    """W (S, cn, cn) on whitened rows (..., S, n, 3), on all or the last of their channels."""
    if whitener is None:
        return rows
    c = whitener.shape[1] // rows.shape[-2]
    part = rows[..., -c:]
    flat = part.reshape(*part.shape[:-2], -1)
    out = np.einsum("sij,...sj->...si", whitener, flat, optimize=True).reshape(part.shape)
    return np.concatenate([rows[..., :-c], out], axis=-1)


def project_out_starts(e: RunErrors, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """Whitened residuals (S, n, 3) orthogonal to the start states, and a basis of what those span.

    Basis (S, n, 3, 3), and the correction (S, 3) of the starts [m/s, m/s, rad/s].
    """
    whitener, _ = timing_whitener(e, noise)
    w = apply_whitener(whitened(e.error, noise) * e.within[..., None], whitener)
    A = _start_sensitivity(e, noise, whitener)
    S, n = e.within.shape
    Q, R = np.linalg.qr(A.reshape(S, 3 * n, 3))
    along = np.einsum("smk,sm->sk", Q, w.reshape(S, 3 * n))
    try:
        correction = np.linalg.solve(R, along[..., None])[..., 0]
    except np.linalg.LinAlgError:
        free = np.einsum("skk->sk", R) != 0.0  # the others have no row that depends on them
        Q, along = Q * free[:, None, :], along * free
        correction = (np.linalg.pinv(R) @ along[..., None])[..., 0]
    basis = Q.reshape(S, n, 3, 3)
    return w - np.einsum("sncl,sl->snc", basis, along), basis, correction


def _start_sensitivity(e: RunErrors, noise: Noise, whitener: Floats | None) -> Floats:
    """∂ whitened residuals / ∂ start, but for the sign: (S, n, 3, 3)."""
    white = whitened(np.moveaxis(e.phi, -1, 0), noise) * e.within[..., None]
    return np.moveaxis(apply_whitener(white, whitener), 0, -1)


def estimate_noise(e: RunErrors, dt: float, before: Noise) -> Noise:
    """The most likely noise, channel by channel with the others held, and its command timing."""
    e, noise = _thinned(e), before
    rhos = np.exp(-dt / np.array(CORRELATION_TIMES_S))
    for i in range(2):
        own = e._replace(timing_covariance=None)
        fits = [_channel_fit(own, noise, i, float(rho)) for rho in _near(rhos, noise.rho[i], e)]
        noise = min(fits, key=lambda fit: fit[0])[1]
    timings = np.zeros(1)
    if e.timing_covariance is not None:
        timings = _near(np.array(COMMAND_TIMING_GRID), noise.command_timing, e)
    fits = [
        _channel_fit(e, noise._replace(command_timing=float(timing)), 2, float(rho))
        for timing in timings
        for rho in _near(rhos, noise.rho[2], e)
    ]
    return min(fits, key=lambda fit: fit[0])[1]


def _thinned(e: RunErrors) -> RunErrors:
    """Every so many of the runs, with the timing covariance of the yaw rate alone."""
    step = max(int(e.within.sum()) // NOISE_ROWS, 1)
    timing = None if e.timing_covariance is None else e.timing_covariance[::step, 2::3, 2::3]
    return RunErrors(e.error[::step], e.phi[::step], e.within[::step], timing)


def _near(grid: Floats, at: float, e: RunErrors) -> Floats:
    """Points of a grid to try: all while runs are short, then the nearest and its neighbours."""
    if e.within.shape[1] <= SHORT_RUN_ROWS:
        return grid
    i = int(np.argmin(np.abs(grid - at)))
    return grid[max(i - 1, 0) : i + 2]


def _channel_fit(e: RunErrors, noise: Noise, i: int, rho: float) -> tuple[float, Noise]:
    """−2 log restricted likelihood and the noise, with ρ of channel i given and its σ fitted."""
    for _ in range(2):
        noise = noise.with_channel(i, noise.sigma[i], rho)
        left, basis, _ = project_out_starts(e, noise)
        freedom = max(float(e.within.sum() - np.sum(basis[:, :, i] ** 2)), 1.0)
        typical = np.sqrt(np.median(left[..., i][e.within > 0] ** 2) / CHI2_MEDIAN)
        squares = np.sum(np.clip(left[..., i], -CLIP_STD * typical, CLIP_STD * typical) ** 2)
        size = max(float(noise.sigma[i] * np.sqrt(squares / freedom)), float(MIN_SIGMA[i]))
        noise = noise.with_channel(i, size, rho)
    return restricted_deviance(e, noise), noise


def restricted_deviance(e: RunErrors, noise: Noise) -> float:
    """−2 log of the restricted likelihood, but for a constant."""
    left, _, _ = project_out_starts(e, noise)
    whitener, size = timing_whitener(e, noise)
    rows, steps = e.within.sum(), e.within[:, 1:].sum()
    spread = 2.0 * rows * np.log(noise.sigma).sum() + steps * np.log(1.0 - noise.rho**2).sum()
    spread -= 2.0 * size
    A = _start_sensitivity(e, noise, whitener)
    G = np.einsum("snck,sncl->skl", A, A)
    information = np.linalg.slogdet(G)[1]
    information = np.where(np.isfinite(information), information, 0.0)  # a start without rows
    return float(spread + information.sum() + np.sum(left**2))


MIN_COMMAND_RATE_HZ = 0.5  # slower commands count as this: an interval says little then
MAX_TRANSITION = 2.0  # bound of ∂ velocity / ∂ velocity over one mean, against runs that diverge


def command_timing_covariance(
    trial: Trial, model: Model, first: Ints, every: int, means: int, track: Floats
) -> Floats | None:
    """Covariance (S, 3n, 3n) of n means of u, v, r in runs from rows first (S,) of a track (T, 9).

    The time of each command is uniform over a message interval. None where the rate of commands is
    not known, or there is no run.
    """
    if "commands" not in trial.rates_hz or not len(first):
        return None
    rows = first[:, None] + every * np.arange(means)
    step = _transitions(trial, model, np.minimum(rows, len(trial) - every - 1), every, track)
    each = _impulses(trial, model) / np.sqrt(12.0)
    within = np.minimum(rows[..., None] + np.arange(every), len(trial) - 1)
    impulse = np.einsum("sjki,sjkl->sjil", each[within], each[within])
    return _accumulated(step, impulse).reshape(len(rows), 3 * means, 3 * means)


def _accumulated(step: Floats, impulse: Floats) -> Floats:
    """F (S, n, 3, 3), Σ q qᵀ (S, n, 3, 3) of each mean -> covariance (S, n, 3, n, 3)."""
    S, n = impulse.shape[:2]
    out = np.zeros((S, n, 3, n, 3))
    now = 0.5 * impulse[:, 0]
    out[:, 0, :, 0] = now
    for j in range(1, n):
        F, new = step[:, j - 1], 0.5 * (impulse[:, j - 1] + impulse[:, j])
        before = np.einsum("sab,sbic->saic", F, out[:, j - 1, :, :j])
        out[:, j, :, :j] = before
        out[:, :j, :, j] = np.moveaxis(before, (1, 2, 3), (3, 1, 2))
        now = F @ now @ np.swapaxes(F, 1, 2) + new
        out[:, j, :, j] = now
    return out


def _transitions(trial: Trial, model: Model, rows: Ints, every: int, track: Floats) -> Floats:
    """∂ velocity after `every` rows / ∂ velocity at rows (S, n): (S, n, 3, 3)."""
    flat = rows.reshape(-1)
    steps = np.full(len(flat), every, np.int64)
    nu = shifted_velocities(model, trial, track, flat, steps)[:, :, every]
    F = np.swapaxes((nu[:, 1:] - nu[:, :1]) / VELOCITY_STEP[:, None], 1, 2)
    F = np.clip(np.nan_to_num(F), -MAX_TRANSITION, MAX_TRANSITION)
    return F.reshape(*rows.shape, 3, 3)


def _impulses(trial: Trial, model: Model) -> Floats:
    """M⁻¹ Δτ T: change of velocity (T, 3) if a row's commands had come a message earlier."""
    _, tau = forces_along(trial, model, *commands_around(model, trial))
    mass = model.theta[[model.names.index(name) for name in ("m11", "m22", "m33")]]
    interval = 1.0 / max(trial.rates_hz["commands"], MIN_COMMAND_RATE_HZ)
    change = np.diff(tau, axis=0, prepend=tau[:1])
    return np.nan_to_num(change, posinf=0.0, neginf=0.0) / mass * interval


def sharpening_factor(shift: float, dt: float) -> float:
    """κ of a shift [s]."""
    share = shift / dt % 1.0
    return 0.5 * share * (1.0 - share)


def sharpened_commands(inputs: InputTable, kappa: float) -> InputTable:
    """The inputs of a model, their commands sharpened to make up for the spread of a shift."""
    commands = np.diff(inputs.total, axis=1)
    bend = np.zeros_like(commands)
    bend[:, 1:-1] = commands[:, 2:] - 2.0 * commands[:, 1:-1] + commands[:, :-2]
    total = np.zeros_like(inputs.total)
    np.cumsum(commands - kappa * bend, axis=1, out=total[:, 1:])
    return replace(inputs, total=total)
