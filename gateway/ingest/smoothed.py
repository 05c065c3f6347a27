"""Rates that were smoothed towards both sides: found by the values they are the rates of.

    B(f) = S(reported, differentiated) / S(reported, reported)

Both are means over `STEP_S`; S are their cross- and power spectrum. Where nothing was done to the
reported rate B = 1, errors of its own make B smaller, and those of the values leave it. A filter
that only looks back, a first-order lag 1/(1 + j2πfτ) or a delay, leaves Re B at 1 or below it: what
it takes in size it takes in phase. A window that looks both ways takes in size alone: Re B rises
above 1, also if the two are some hundredths of a second apart, B e^{j2πfs}. Such a rate shows
motion before its cause: an actuator's lag found from it is too short, or negative.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.state import Floats

Complex = NDArray[np.complex128]

STEP_S = 0.2
PIECE = 50  # means in a piece of time that is transformed, half of it shared with the next
FEWEST = 5  # pieces
BANDS_HZ = (0.15, 0.35, 0.55, 0.75, 0.95, 1.25, 1.75)
ABOVE = 1.05  # of Re B
APART_S = 0.06  # s: rate and values may be apart by so much either way
SURE = 3.0  # standard deviations from piece to piece
SPREAD = 0.02  # of Re B, that all have: few pieces may agree by chance


class Smoothing(NamedTuple):
    """Whether a rate was smoothed to both sides, and the frequency [Hz] that it lacks from on."""

    found: bool
    from_hz: float

    @property
    def window_s(self) -> float:
        """About how long a window takes that away."""
        return 1.0 / self.from_hz


NOTHING = Smoothing(False, np.inf)


def smoothing(time: Floats, x: Floats, rate_time: Floats, rate: Floats) -> Smoothing:
    """Values (K, n) at times (K,), rates (L, n) at (L,) [s], ascending, one frame -> what was done.

    The lowest band counts that B shows it in.
    """
    edges = np.arange(max(time[0], rate_time[0]), min(time[-1], rate_time[-1]), STEP_S)
    columns = range(x.shape[1])
    if len(edges) <= PIECE:
        return NOTHING
    moved = np.stack([np.interp(edges, time, x[:, i]) for i in columns], axis=1)
    total = np.stack([_integral(rate_time, rate[:, i], edges) for i in columns], axis=1)
    true, said = (_spectra(np.diff(path, axis=0) / STEP_S) for path in (moved, total))
    if len(true) < FEWEST:
        return NOTHING
    frequency = np.asarray(np.fft.rfftfreq(PIECE, STEP_S), np.float64)
    cross, own = (np.conj(said) * true).sum(axis=1), (np.abs(said) ** 2).sum(axis=1)
    for low, high in pairwise(BANDS_HZ):
        inside = (frequency >= low) & (frequency < high)
        if all(_above(cross, own, frequency, inside, apart) for apart in (-APART_S, 0.0, APART_S)):
            return Smoothing(True, low)
    return NOTHING


def _spectra(rows: Floats) -> Complex:
    """Means (M, n) -> transforms (pieces, n, frequencies) of what moves within each piece."""
    starts = range(0, len(rows) - PIECE + 1, PIECE // 2)
    pieces = np.stack([rows[k : k + PIECE].T for k in starts])
    return np.fft.rfft((pieces - pieces.mean(axis=-1, keepdims=True)) * np.hanning(PIECE))


def _above(
    cross: Complex, own: Floats, frequency: Floats, inside: NDArray[np.bool_], apart: float
) -> bool:
    """Spectra (pieces, frequencies), a band, s [s] -> Re B is surely above 1 there."""
    shared = np.real(cross * np.exp(2j * np.pi * frequency * apart))
    b, std = _ratio(shared[:, inside].sum(axis=1), own[:, inside].sum(axis=1))
    return b - ABOVE > SURE * std


def _ratio(above: Floats, below: Floats) -> tuple[float, float]:
    """Sums (pieces,) -> their ratio and its standard deviation (jackknife)."""
    if not below.sum() > 0.0:
        return 1.0, np.inf
    without = (above.sum() - above) / np.maximum(below.sum() - below, 1e-300)
    share = (len(above) - 1) / len(above)
    std = np.sqrt(share * np.sum((without - without.mean()) ** 2))
    return float(above.sum() / below.sum()), float(np.hypot(std, SPREAD))


def _integral(time: Floats, values: Floats, at: Floats) -> Floats:
    """Integral of values (L,) between their times, at moments (T,)."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    return np.interp(at, time, np.concatenate([[0.0], np.cumsum(steps)]))
