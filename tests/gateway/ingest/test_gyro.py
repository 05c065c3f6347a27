"""The gyro of a DataFlash log comes with its bias; the filter's own estimate of it goes off."""

import numpy as np
import pytest

from gateway.ingest.dataflash.log import primary_lane, without_bias
from gateway.ingest.log import Statistics, Table
from gateway.samples import Quantity, Samples


class Lanes:
    """A log with two lanes of the filter, of which the second is in use."""

    path, kind, statistics = "two-lanes.BIN", "dataflash", Statistics()

    def __init__(self) -> None:
        order = np.array([10, 11, 20, 21])
        lane = np.array([0, 1, 0, 1])
        self.tables = {
            "XKF1": table("XKF1", order, C=lane, GZ=np.array([9.0, 1.0, 9.0, 2.0])),
            "XKF4": table("XKF4", order, C=lane, PI=np.array([1, 1, 1, 0])),
        }

    def counts(self) -> dict[str, int]:
        return {name: len(part) for name, part in self.tables.items()}

    def table(self, name: str) -> Table:
        return self.tables.get(name) or table(name, np.zeros(0, np.int64))


def table(name: str, order: np.ndarray, **columns: np.ndarray) -> Table:
    nobody = np.zeros(len(order), np.uint8)
    return Table(name, order, order * 1000, nobody, nobody, columns)


def test_the_lane_most_in_use_counts() -> None:
    assert primary_lane(Lanes()) == 1


def test_the_bias_last_known_is_taken_off() -> None:
    order = np.array([5, 12, 30])
    raw = Samples(Quantity.YAW_RATE, "IMU", order, order, order, np.full((3, 1), 0.5))
    values = without_bias(raw, Lanes(), lane=1).values[:, 0]
    assert values == pytest.approx(0.5 - np.radians([1.0, 1.0, 2.0]))
