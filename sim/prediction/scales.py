"""What one comparison measures all vessels by: segments, scales of the errors and the noise floor.

The noise floor is what a perfect model would still show. Started at the estimate it carries the
estimate's error ε₀ along; the row that it is compared with has an error ε_j of its own:

    e_j = ε_j − Φ_j ε₀,     var e_j = R_j + Φ_j P₀ Φ_jᵀ − 2 Φ_j C_j,     C_j = cov(ε₀, ε_j)

A smoother's errors are correlated in time, and the trial holds only P and R. But the error of a
velocity changes at the error of its acceleration, which the trial does hold: a stationary error
of variance p whose rate has variance q has the correlation 1 − t² q / 2p to second order. Taken
on as ρ(t) = exp(−t² q / 2p) this gives C_j = P₀ ρ(t_j), scaled down where R_j < P₀. White errors
are its limit q → ∞. Slow sensor errors are correlated for longer: for them the floor is too high
rather than too low. Source: the Taylor microscale of a random process (Rice 1944).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.prediction.segments import (
    STATE,
    CompareSettings,
    Segments,
    nodes_within_limit,
    require_finite,
    segments_of,
    start_transitions,
    start_variance,
)
from sim.state import Floats, Ints
from sim.trial import Trial

# Smallest scales of u, v, r [m/s, m/s, rad/s]: a channel that moves less is at rest. Chosen, not
# measured.
MIN_SCALES = np.array([0.05, 0.05, 0.02])


@dataclass(frozen=True)
class Ruler:
    """Segments with their horizons, the scales of the errors and the noise floor.

    segments             horizons already cut where the start state's spread passes its limit
    cut_short            share of the segments whose horizon was cut
    scales    (3,)       of u, v, r [m/s, m/s, rad/s]
    variance  (S, J, 6)  of a perfect model's error at each node; NaN past the uncut horizon
    blocks    (S,)       number of the block of time that the segment starts in
    """

    settings: CompareSettings
    segments: Segments
    cut_short: float
    scales: Floats
    variance: Floats
    blocks: Ints

    @classmethod
    def of(cls, trial: Trial, model: Model, settings: CompareSettings | None = None) -> "Ruler":
        """The ruler of a trial and a vessel; NoUsableTimeError if nothing can be compared."""
        settings = settings or CompareSettings()
        require_finite(trial)
        whole, scales = segments_of(trial, settings), scales_of(trial)
        phi = start_transitions(model, trial, whole)
        spread = start_variance(trial, whole, phi)
        nodes = nodes_within_limit(spread, whole, scales, trial.dt, settings)
        return cls(
            settings,
            replace(whole, nodes=nodes),
            float(np.mean(nodes < whole.nodes)),
            scales,
            perfect_variance(trial, whole, phi, spread),
            segment_blocks(trial, whole, settings.block),
        )

    def subset(self, which: NDArray[np.bool_]) -> "Ruler":
        """The ruler of some of its segments (S,)."""
        own = self.segments
        return replace(
            self, segments=replace(own, rows=own.rows[which], nodes=own.nodes[which]),
            variance=self.variance[which], blocks=self.blocks[which],
        )  # fmt: skip

    @property
    def noise_floor(self) -> float:
        """The nrmse that a perfect model would show."""
        mean = mean_over_horizon(self.variance[..., 3:], self.segments)
        return float(np.sqrt(np.mean(mean / self.scales**2)))


def scales_of(trial: Trial) -> Floats:
    """Standard deviation of u, v, r over the usable rows: (3,) [m/s, m/s, rad/s].

    It is `MIN_SCALES` at least, and on a trial without usable rows.
    """
    if not trial.usable.any():
        return MIN_SCALES.copy()
    return np.maximum(trial.nu[trial.usable].std(axis=0), MIN_SCALES)


def segment_blocks(trial: Trial, segments: Segments, length: float) -> Ints:
    """Number of the block of `length` [s] in which each segment starts: (S,).

    On a short trial blocks shrink towards six, but never below the longest horizon: segments of
    different blocks should share as little time as possible.
    """
    start = trial.time[segments.rows]
    horizon = float(segments.steps.max()) * trial.dt
    width = min(length, max((start[-1] - start[0] + horizon) / 6.0, horizon))
    return ((start - start[0]) // width).astype(np.int64)


def perfect_variance(trial: Trial, segments: Segments, phi: Floats, spread: Floats) -> Floats:
    """Variance (S, J+1, 6) of a perfect model's error in (eta, nu), SI units.

    phi (S, J+1, 6, 6); spread (S, J+1, 6): variance that the start state leaves at each node.
    """
    rows = segments.rows[:, None] + segments.stride * np.arange(phi.shape[1])
    variance: Floats = np.einsum("tii->ti", trial.covariance)
    R: Floats = variance[np.minimum(rows, len(trial) - 1), :STATE]
    P = trial.covariance[segments.rows, :STATE, :STATE]
    t = segments.stride * trial.dt * np.arange(phi.shape[1])
    carried = np.einsum("sjik,ski->sji", phi, P, optimize=True)
    own = R[:, :1]
    shared = np.sqrt(np.minimum(np.divide(R, own, out=np.ones_like(R), where=own > 0), 1.0))
    rho = correlation(variance[segments.rows], np.asarray(t)) * shared
    return np.maximum(R + spread - 2.0 * carried * rho, 0.0)


def correlation(variance: Floats, t: Floats) -> Floats:
    """Variances (S, 9) of (eta, nu, nu_dot), lags (J,) [s] -> correlation (S, J, 6) of errors."""
    ground = 0.5 * (variance[:, 3] + variance[:, 4])
    rate = np.column_stack([ground, ground, variance[:, 5:]])
    with np.errstate(divide="ignore", invalid="ignore"):
        exponent = -0.5 * t[None, :, None] ** 2 * (rate / variance[:, :STATE])[:, None, :]
    # errors whose rate is not known are taken for white
    known = (rate > 0.0)[:, None, :] | (t == 0.0)[None, :, None]
    return np.where(known, np.exp(np.nan_to_num(exponent, nan=0.0)), 0.0)


def mean_over_horizon(variance: Floats, segments: Segments) -> Floats:
    """Variance (S, J+1, n) at the nodes -> its mean (n,) over all rows of all segments."""
    weight = np.minimum(segments.nodes[:, None] - np.arange(variance.shape[1]), 1.0)
    weight = np.maximum(np.where(weight == 0.0, 0.5, weight), 0.0)
    weight[:, 0] *= 0.5
    total = np.einsum("sj,sjn->n", weight, np.nan_to_num(variance))
    return np.asarray(total / weight.sum())
