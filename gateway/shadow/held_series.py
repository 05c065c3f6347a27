"""Quantities that hold until the next message: commands, voltage, wind, armed, fix."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.log import BoatSamples
from gateway.ingest.sources import Choice
from gateway.samples import CHANNELS, Quantity, Samples
from sim.state import Floats, Ints


@dataclass(frozen=True)
class HeldSeries:
    """Values that hold from their time on.

    time    (K,)    s (or position in the log), ascending
    values  (K, n)  NaN = not known from here on
    """

    time: NDArray[np.float64] | Ints
    values: Floats

    def __len__(self) -> int:
        return len(self.time)

    def at(self, moments: NDArray[np.float64] | Ints) -> Floats:
        """(T,) moments -> (T, n): the values held there; NaN before the first."""
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
        total = self._integral(np.where(known, self.values, 0.0), edges)
        share = self._integral(known.astype(np.float64), edges)
        enough = share > 0.5 * np.diff(edges)[:, None]
        return np.where(enough, total / np.where(enough, share, 1.0), np.nan)

    def _integral(self, values: Floats, edges: Floats) -> Floats:
        """Integral of held values (K, n) over each interval between edges: (T, n)."""
        if not len(self):
            return np.zeros((len(edges) - 1, values.shape[1]))
        knots = np.append(self.time, max(self.time[-1], edges[-1]) + 1.0)
        steps = np.diff(knots)[:, None] * values
        upto = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
        columns = [np.interp(edges, knots, upto[:, i], left=0.0) for i in range(values.shape[1])]
        return np.diff(np.stack(columns, axis=1), axis=0)


def held_series(samples: Samples, epoch_ns: int) -> HeldSeries:
    """Samples of one source, ordered by the boat's clock."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return HeldSeries(seconds(samples.vehicle_time_ns[order], epoch_ns), samples.values[order])


def seconds(time_ns: Ints, epoch_ns: int) -> Floats:
    """Unix ns -> s after the epoch."""
    return np.asarray((time_ns - epoch_ns) * 1e-9, np.float64)


@dataclass(frozen=True)
class HeldInputs:
    """The inputs of a log that hold until the next message, on one time axis.

    pulses (K, 32) µs, voltage (K, 1) V, wind (K, 2) m/s, armed (K, 1) 0 or 1, fix (K, 1),
    estimator (K, 1) bits of `EstimatorFault`
    """

    pulses: HeldSeries
    voltage: HeldSeries
    wind: HeldSeries
    armed: HeldSeries
    fix: HeldSeries
    estimator: HeldSeries


def held_inputs(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> HeldInputs:
    """Of each quantity the chosen source; empty where the log has none."""

    def of(name: str, width: int) -> HeldSeries:
        if name not in choices:
            return HeldSeries(np.zeros(0), np.zeros((0, width)))
        return held_series(choices[name].samples, epoch_ns)

    return HeldInputs(
        _pulses(decoded, choices, epoch_ns),
        of("voltage", 1),
        of("wind", 2),
        _armed(of("armed", 1), choices),
        of("fix", 1),
        of("estimator", 1),
    )


def _armed(series: HeldSeries, choices: Mapping[str, Choice]) -> HeldSeries:
    """Armed or not; before the first of the changes that some logs write, it was the other."""
    if not len(series) or not choices["armed"].samples.on_change:
        return series
    values = np.concatenate([1.0 - series.values[:1], series.values])
    return HeldSeries(np.concatenate([[-np.inf], series.time]), values)


def _pulses(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> HeldSeries:
    """Pulses of all channels [µs], on the times of all messages that report some."""
    family = command_family(decoded, choices)
    if not family:
        return HeldSeries(np.zeros(0), np.zeros((0, CHANNELS)))
    times = seconds(np.unique(np.concatenate([s.vehicle_time_ns for s in family])), epoch_ns)
    parts = [held_series(samples, epoch_ns) for samples in family]
    return HeldSeries(times, merged_channels(family, [part.at(times) for part in parts]))


def command_family(decoded: BoatSamples, choices: Mapping[str, Choice]) -> list[Samples]:
    """The chosen source of commands and those that report other channels in the same way."""
    if "commands" not in choices:
        return []
    chosen = choices["commands"].samples.equivalent
    return [p for p in decoded.of(Quantity.ACTUATORS) if p.equivalent == chosen]


def merged_channels(family: list[Samples], pulses: list[Floats]) -> Floats:
    """Pulses (K, 32) of each source -> those of the channels that it reports: (K, 32)."""
    merged = np.full(pulses[0].shape, np.nan)
    for samples, part in zip(family, pulses, strict=True):
        first, last = samples.channels
        merged[:, first - 1 : last] = part[:, first - 1 : last]
    return merged
