"""What the filter is fed: readings in order of receipt, as columns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.names import Kind
from gateway.estimation.settings import FilterSettings
from gateway.samples import Quantity, Samples
from sim.state import Floats

KIND_OF = {
    Quantity.YAW: Kind.YAW,
    Quantity.YAW_RATE: Kind.YAW_RATE,
    Quantity.VELOCITY: Kind.VELOCITY,
    Quantity.POSITION: Kind.POSITION,
    Quantity.BODY_VELOCITY: Kind.BODY_VELOCITY,
    Quantity.ACCELERATION: Kind.ACCELERATION,
}


@dataclass(frozen=True)
class Events:
    """K readings in order of receipt.

    time_s  (K,)    the boat's clock, seconds after an epoch fixed for the session
    kind    (K,)    `Kind`
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
        return Events(self.time_s[part], self.kind[part], self.z[part], self.std[part])


def make_events(kind: Kind, time_s: Floats, z: Floats, std: float) -> Events:
    """Readings of one kind: times (K,) [s], values (K,) or (K, 1) or (K, 2), one std."""
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
    """Moments (K,) [s] at which only a prediction is wanted."""
    return make_events(Kind.TICK, time_s, np.zeros(len(time_s)), 1.0)


def join(parts: Sequence[Events]) -> Events:
    """All events of the parts, one part after another."""
    return Events(
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.kind for part in parts]),
        np.concatenate([part.z for part in parts]),
        np.concatenate([part.std for part in parts]),
    )


def from_samples(columns: Sequence[Samples], settings: FilterSettings, epoch_ns: int) -> Events:
    """Columns of a log -> events in the order of the log. Quantities the filter has no use for
    are left out; the caller chooses one source per quantity."""
    chosen = [samples for samples in columns if samples.quantity in KIND_OF and len(samples)]
    if not chosen:
        return ticks(np.zeros(0))
    parts = [_from_one(samples, settings, epoch_ns) for samples in chosen]
    order = np.concatenate([samples.order for samples in chosen])
    # Stable: of the facts in one message, yaw stands before what depends on it.
    kinds = np.concatenate([part.kind for part in parts])
    return join(parts)[np.lexsort((kinds, order))]


def _from_one(samples: Samples, settings: FilterSettings, epoch_ns: int) -> Events:
    kind = KIND_OF[samples.quantity]
    time_s = np.asarray((samples.vehicle_time_ns - epoch_ns) * 1e-9, np.float64)
    return make_events(kind, time_s, samples.values, settings.white_std(kind, samples.source))
