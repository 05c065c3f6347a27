"""The ruler of a comparison: it comes from the trial and the first vessel, and serves them all."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.floor import mean_over_horizon, perfect_variance
from sim.diagnosis.segments import Segments, segments_of
from sim.diagnosis.settings import CompareSettings
from sim.diagnosis.spread import limited, start_variance
from sim.diagnosis.transition import carried
from sim.model import Model
from sim.state import Floats, Ints
from sim.trial import Trial

SMALLEST = np.array([0.05, 0.05, 0.02])  # m/s, m/s, rad/s: below this a channel is at rest


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
    def of(cls, trial: Trial, first: Model, settings: CompareSettings | None = None) -> "Ruler":
        """From the trial and the first vessel; NoUsableTimeError if nothing can be compared."""
        settings = settings or CompareSettings()
        whole, scales = segments_of(trial, settings), scales_of(trial)
        phi = carried(first, trial, whole)
        nodes = limited(start_variance(trial, whole, phi), whole, scales, trial.dt, settings)
        return cls(
            settings,
            replace(whole, nodes=nodes),
            float(np.mean(nodes < whole.nodes)),
            scales,
            perfect_variance(trial, whole, phi),
            blocks_of(trial, whole, settings.block),
        )

    def only(self, which: NDArray[np.bool_]) -> "Ruler":
        """The same with some of its segments (S,)."""
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
    """Size of each velocity channel over the usable rows: (3,) [m/s, m/s, rad/s]."""
    return np.maximum(trial.nu[trial.usable].std(axis=0), SMALLEST)


def blocks_of(trial: Trial, segments: Segments, length: float) -> Ints:
    """Which block of `length` [s] each segment starts in: (S,).

    On a short trial blocks shrink towards six, but never below the longest horizon: segments of
    different blocks should share as little time as possible.
    """
    start = trial.time[segments.rows]
    horizon = float(segments.steps.max()) * trial.dt
    width = min(length, max((start[-1] - start[0] + horizon) / 6.0, horizon))
    return ((start - start[0]) // width).astype(np.int64)
