"""Decoded measurements of a boat: quantities in SI units with two clocks.

A `Measurement` is one fact from a live link; `Samples` is a column of them from a log. Both come
from the same mapping functions (`gateway.ingest.mapping`), which take scalars or columns alike.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CHANNELS = 32  # servo outputs that are known


class Quantity(IntEnum):
    """What is measured, and the columns of its values."""

    YAW = 0  # yaw_rad
    YAW_RATE = 1  # yaw_rate_radps (body z axis)
    TILT = 2  # roll_rad, pitch_rad
    VELOCITY = 3  # north_mps, east_mps over ground
    POSITION = 4  # north_m, east_m from the autopilot's local origin
    GLOBAL_POSITION = 5  # latitude_deg, longitude_deg
    ACCELERATION = 6  # forward, starboard specific force [m/s²] (contains gravity through tilt)
    BODY_VELOCITY = 7  # u_mps, v_mps over ground
    ACTUATORS = 8  # pulse width of channels 1 … 32 [µs]; NaN = channel not reported
    VOLTAGE = 9  # battery voltage_v
    WIND = 10  # velocity of the air towards north_mps, east_mps
    ARMED = 11  # 1 armed, 0 disarmed
    FIX = 12  # GNSS fix type (0–1 none, 2 2-D, 3 3-D, 4 DGPS, 5 RTK float, 6 RTK fixed)
    ORIGIN = 13  # latitude_deg, longitude_deg of the autopilot's local origin
    UNIX_TIME = 14  # Unix time by the boat's own clock [s]
    ESTIMATOR = 15  # bits of `gateway.ingest.mapping.EstimatorFault`: 0 the autopilot's EKF is well


class Measurement(NamedTuple):
    """One decoded fact, in SI units, on the boat's clock and on the receiver's."""

    quantity: Quantity
    source: str  # name of the message it came from
    vehicle_time_ns: int
    receive_time_ns: int
    values: tuple[float, ...]


@dataclass(frozen=True)
class Samples:
    """All measurements of one quantity from one message of one boat in a log.

    order            (K,)    position of the message in the log: what came first
    vehicle_time_ns  (K,)    int64
    receive_time_ns  (K,)    int64
    values           (K, n)  SI units, see `Quantity`
    equivalent       the message of `sources.PRIORITY` with the same rank and errors: the source
                     itself, unless its format names messages otherwise
    channels         first and last actuator channel that the source reports, from 1
    on_change        written when the value changes: before the first one it was another
    """

    quantity: Quantity
    source: str
    order: NDArray[np.int64]
    vehicle_time_ns: NDArray[np.int64]
    receive_time_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    equivalent: str = ""
    channels: tuple[int, int] = (1, CHANNELS)
    on_change: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "equivalent", self.equivalent or self.source)

    def __len__(self) -> int:
        return len(self.order)

    def where(self, kept: NDArray[np.bool_]) -> "Samples":
        """Those rows (K,) alone."""
        return replace(
            self, order=self.order[kept], vehicle_time_ns=self.vehicle_time_ns[kept],
            receive_time_ns=self.receive_time_ns[kept], values=self.values[kept],
        )  # fmt: skip

    def seconds(self, start_ns: int = 0) -> NDArray[np.float64]:
        """Vehicle time (K,) [s] after a moment."""
        return np.asarray((self.vehicle_time_ns - start_ns) * 1e-9, np.float64)
