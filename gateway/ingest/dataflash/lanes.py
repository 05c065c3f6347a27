"""Lanes of the autopilot's filter: EKF2 and EKF3 run several at once, and the boat follows one.

Which one is in XKF4 (NKF4) of every lane, as PI. It is followed here as the boat followed it, so
that a lane that went wrong and was left is not read. A switch is a step of the estimate and no
motion: when it happened is told, and time around it judges no model.

Source: the messages XKF1 and XKF4 of ArduPilot's log documentation.
"""

from typing import NamedTuple

import numpy as np

from gateway.ingest.dataflash.mapping import LANE
from gateway.ingest.log import LaneSwitch, Log, numbers
from gateway.samples import Samples
from sim.state import Floats, Ints

PRIMARY_LANE = (("XKF4", "PI"), ("NKF4", "PI"))  # message and column with the primary lane
MOTION = ("XKF1", "NKF1")  # column C where there are several lanes
MAX_LANES = 16  # more than there are
GYRO_BIAS = (*MOTION, "EKF1")  # column GZ [deg/s]


class LanesInUse(NamedTuple):
    """The lane (K,) in use from each place in the log (K,) on, by receipt (K,) [ns]; the first one
    also before. Each differs from the one before it.
    """

    order: Ints
    receive_time_ns: Ints
    lane: Ints

    def at(self, order: Ints) -> Ints:
        """Places in the log (M,) -> the lane in use (M,)."""
        return self.lane[np.maximum(np.searchsorted(self.order, order, side="right") - 1, 0)]

    def switches(self, vehicle_time_ns: Ints) -> tuple[LaneSwitch, ...]:
        """Where the lane changes; times of the boat's clock of all places (K,)."""
        rows = zip(
            vehicle_time_ns[1:].tolist(), self.receive_time_ns[1:].tolist(),
            self.lane[:-1].tolist(), self.lane[1:].tolist(), strict=True,
        )  # fmt: skip
        return tuple(LaneSwitch(*row) for row in rows)


def lanes_in_use(log: Log) -> LanesInUse:
    """Which lane of a log was in use when; lane 0 where that is not logged."""
    for name, column in PRIMARY_LANE:
        table = log.table(name)
        if not len(table) or column not in table.columns:
            continue
        told = numbers(table.columns[column])
        known = (told >= 0.0) & (told < MAX_LANES)  # below: none yet
        if known.any():
            lane = _logged(told[known].astype(np.int64), log)
            new = np.append(True, np.diff(lane) != 0)
            order, receipt = table.order[known][new], table.receive_time_ns[known][new]
            return LanesInUse(order, receipt, lane[new])
    return LanesInUse(*np.zeros((3, 1), np.int64))


def _logged(lane: Ints, log: Log) -> Ints:
    """The same lanes; in place of those whose motion is not in the log the one most in use."""
    tables = [log.table(name) for name in MOTION]
    own = next((numbers(t.columns[LANE]) for t in tables if LANE in t.columns and len(t)), None)
    if own is None:
        return lane
    there = np.isin(lane, own)
    if there.any():
        return np.where(there, lane, np.bincount(lane[there]).argmax())
    own = own[(own >= 0.0) & (own < MAX_LANES)]
    return np.full_like(lane, own.min()) if len(own) else lane


def gyro_bias(samples: Samples, log: Log, in_use: LanesInUse) -> Floats | None:
    """The gyro's bias about z that the lane in use knew last at each row (K,) [rad/s]."""
    for name in GYRO_BIAS:
        table = log.table(name)
        if len(table) and "GZ" in table.columns:
            lane = in_use.at(table.order)
            mine = np.asarray(table.columns.get(LANE, lane)) == lane
            bias = np.radians(numbers(table.columns["GZ"])[mine])
            if len(bias):
                last = np.searchsorted(table.order[mine], samples.order) - 1
                return bias[np.maximum(last, 0)]
    return None
