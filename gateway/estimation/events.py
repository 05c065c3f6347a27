"""Measurements as columns: in order of receipt for the filter, of time for the smoother."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.names import KINDS, MeasurementKind
from gateway.estimation.settings import FilterSettings
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

KIND_OF = {
    Quantity.YAW: MeasurementKind.YAW,
    Quantity.YAW_RATE: MeasurementKind.YAW_RATE,
    Quantity.VELOCITY: MeasurementKind.VELOCITY,
    Quantity.POSITION: MeasurementKind.POSITION,
    Quantity.BODY_VELOCITY: MeasurementKind.BODY_VELOCITY,
    Quantity.ACCELERATION: MeasurementKind.ACCELERATION,
}


@dataclass(frozen=True)
class Events:
    """K measurements in order of receipt.

    time_s  (K,)    the boat's clock, seconds after an epoch fixed for the session
    kind    (K,)    `MeasurementKind`
    z       (K, 2)  values in the unit of the kind; the second is unused where there is one
    std     (K, 2)  of the white part of their errors
    """

    time_s: Floats
    kind: NDArray[np.int64]
    z: Floats
    std: Floats

    def __post_init__(self) -> None:
        shapes = (self.time_s.shape, self.kind.shape, self.z.shape, self.std.shape)
        count = len(self.time_s)
        if shapes != ((count,), (count,), (count, 2), (count, 2)):
            raise ValueError(f"events: shapes {shapes} do not belong together")

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, part: slice | NDArray[np.generic]) -> "Events":
        return Events(*(column[part] for column in vars(self).values()))

    def thinned(self, rate_hz: float) -> "Events":
        """The first of each kind in each step of time."""
        step = np.floor(self.time_s * rate_hz)
        _, first = np.unique(np.column_stack([self.kind, step]), axis=0, return_index=True)
        return self[np.sort(first)]


def make_events(kind: MeasurementKind, time_s: Floats, z: Floats, std: float) -> Events:
    """Measurements of one kind: times (K,) [s], values (K,) or (K, 1) or (K, 2), one std."""
    count = len(time_s)
    values = np.zeros((count, 2))
    columns = np.asarray(z, float)
    columns = columns[:, np.newaxis] if columns.ndim == 1 else columns
    values[:, : columns.shape[1]] = columns
    return Events(
        np.asarray(time_s, float),
        np.full(count, int(kind), np.int64),
        values,
        np.full((count, 2), float(std)),
    )


def ticks(time_s: Floats) -> Events:
    """Times (K,) [s] at which only a prediction is wanted."""
    return make_events(MeasurementKind.TICK, time_s, np.zeros(len(time_s)), 1.0)


def join(parts: Sequence[Events]) -> Events:
    """All events of the parts, one part after another."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return Events(*(np.concatenate(column) for column in columns))


def from_samples(columns: Sequence[Samples], settings: FilterSettings, epoch_ns: int) -> Events:
    """Columns of a log -> events in the order of the log, without quantities that are not measured.

    The caller chooses one source per quantity.
    """
    chosen = [samples for samples in columns if samples.quantity in KIND_OF and len(samples)]
    if not chosen:
        return ticks(np.zeros(0))
    parts = [_from_one(samples, settings, epoch_ns) for samples in chosen]
    order = np.concatenate([samples.order for samples in chosen])
    # of the facts in one message, yaw stands before what depends on it
    kinds = np.concatenate([part.kind for part in parts])
    return join(parts)[np.lexsort((kinds, order))]


def _from_one(samples: Samples, settings: FilterSettings, epoch_ns: int) -> Events:
    kind = KIND_OF[samples.quantity]
    white = settings.white_std(kind, samples.equivalent)
    return make_events(kind, samples.seconds(epoch_ns), samples.values, white)


NO_GRID = -1


class Timeline(NamedTuple):
    """n steps: time (n,), span since the step before (n,) [s], the event, the row of the grid."""

    time: Floats
    span: Floats
    kind: Ints
    z: Floats
    std: Floats
    grid: Ints

    def cut(self, part: slice) -> "Timeline":
        """Some of the steps."""
        return Timeline._make(column[part] for column in self)


def timelines(events: Events, grid: Floats, settings: FilterSettings) -> Iterator[Timeline]:
    """The stretches without a gap longer than the filter bridges, each with its grid points."""
    usable = np.isfinite(events.time_s) & (events.kind >= 0) & (events.kind < KINDS)
    events = events[usable]
    events = events[np.lexsort((events.kind, events.time_s))]
    cuts = np.flatnonzero(np.diff(events.time_s) > settings.gap_s) + 1
    for part in np.split(np.arange(len(events)), cuts):
        if len(part):
            yield _merge(events[part], grid, settings.max_step_s)


def _merge(events: Events, grid: Floats, max_step_s: float) -> Timeline:
    """Events of one stretch, the grid points inside it, and steps between where they are far."""
    first, last = events.time_s[[0, -1]]
    rows = np.flatnonzero((grid >= first) & (grid <= last))
    filler = _between(np.sort(np.concatenate([events.time_s, grid[rows]])), max_step_s)
    line = join([events, ticks(grid[rows]), ticks(filler)])
    row = np.full(len(line), NO_GRID)
    row[len(events) : len(events) + len(rows)] = rows
    order = np.argsort(line.time_s, kind="stable")
    line, row = line[order], row[order]
    span = np.diff(line.time_s, prepend=line.time_s[0])
    return Timeline(line.time_s, span, line.kind, line.z, line.std, row)


def _between(times: Floats, max_step_s: float) -> Floats:
    """Ascending times (n,) [s] -> times that cut their gaps into steps short enough."""
    step = np.diff(times)
    pieces = np.ceil(step / max_step_s - 1e-9).astype(np.int64)
    wide = np.flatnonzero(pieces > 1)
    parts = [times[k] + step[k] * np.arange(1, pieces[k]) / pieces[k] for k in wide]
    return np.concatenate(parts) if parts else np.zeros(0)
