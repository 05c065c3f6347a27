"""A quantity that holds until the next one comes: commands, voltage, wind, armed."""

from dataclasses import dataclass

import numpy as np

from gateway.samples import Samples
from sim.state import Floats, Ints


@dataclass(frozen=True)
class Series:
    """Values that hold from their time on.

    time    (K,)    s, ascending
    values  (K, n)  NaN = not known from here on
    """

    time: Floats
    values: Floats

    def __len__(self) -> int:
        return len(self.time)

    def at(self, moments: Floats) -> Floats:
        """(T,) s -> (T, n): the values held there; NaN before the first."""
        if not len(self):
            return np.full((len(moments), self.values.shape[1]), np.nan)
        last = np.searchsorted(self.time, moments, side="right") - 1
        return np.where((last >= 0)[:, None], self.values[np.maximum(last, 0)], np.nan)

    def silence(self, moments: Floats) -> Floats:
        """(T,) s -> (T,): length of the silence around each moment [s], infinite at the ends."""
        edges = np.concatenate([[-np.inf], self.time, [np.inf]])
        after = np.searchsorted(self.time, moments, side="right")
        return np.asarray(edges[after + 1] - edges[after])

    def mean(self, edges: Floats) -> Floats:
        """(T + 1,) s -> (T, n): mean over each interval; NaN where it is unknown for half of it."""
        known = np.isfinite(self.values)
        total = _integral(self, np.where(known, self.values, 0.0), edges)
        share = _integral(self, known.astype(np.float64), edges)
        enough = share > 0.5 * np.diff(edges)[:, None]
        return np.where(enough, total / np.where(enough, share, 1.0), np.nan)


def series(samples: Samples, epoch_ns: int) -> Series:
    """Samples of one source, ordered by the boat's clock."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return Series(seconds(samples.vehicle_time_ns[order], epoch_ns), samples.values[order])


def seconds(time_ns: Ints, epoch_ns: int) -> Floats:
    """Unix ns -> s after the epoch."""
    return np.asarray((time_ns - epoch_ns) * 1e-9, np.float64)


def _integral(held: Series, values: Floats, edges: Floats) -> Floats:
    """Integral of the held values over each interval between edges: (T, n)."""
    if not len(held):
        return np.zeros((len(edges) - 1, values.shape[1]))
    knots = np.append(held.time, max(held.time[-1], edges[-1]) + 1.0)
    steps = np.diff(knots)[:, None] * values
    upto = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    columns = [np.interp(edges, knots, upto[:, i], left=0.0) for i in range(values.shape[1])]
    return np.diff(np.stack(columns, axis=1), axis=0)
