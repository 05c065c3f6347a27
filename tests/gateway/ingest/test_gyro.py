"""The gyro of a DataFlash log comes with its bias; the filter's own estimate of it goes off."""

import numpy as np
import pytest

from gateway.ingest.dataflash.lanes import gyro_bias, lanes_in_use
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


def test_the_lane_in_use_is_followed() -> None:
    in_use = lanes_in_use(Lanes())
    assert in_use.lane.tolist() == [1, 0]
    assert in_use.at(np.array([5, 10, 20, 21, 30])).tolist() == [1, 1, 1, 0, 0]


def test_the_bias_last_known_to_the_lane_in_use_is_found() -> None:
    """The second lane is in use until 21, then the first one."""
    order = np.array([5, 12, 20, 30])
    raw = Samples(Quantity.YAW_RATE, "IMU", order, order, order, np.full((4, 1), 0.5))
    log = Lanes()
    bias = gyro_bias(raw, log, lanes_in_use(log))
    assert bias == pytest.approx(np.radians([1.0, 1.0, 1.0, 1.0]))
    log.tables["XKF1"] = table(
        "XKF1", np.array([10, 11, 20, 21, 25, 26]), C=np.array([0, 1, 0, 1, 0, 1]),
        GZ=np.array([9.0, 1.0, 9.0, 2.0, 9.0, 1.0]),
    )  # fmt: skip
    bias = gyro_bias(raw, log, lanes_in_use(log))
    assert bias == pytest.approx(np.radians([1.0, 1.0, 1.0, 9.0]))


@pytest.mark.parametrize(
    ("primary", "logged", "followed"),
    [
        ([-1, 1, 1, 1], [0, 1, 0, 1], [1]),  # none yet, then the second one
        ([0, 0, 1, 0], [0, 0, 0, 0], [0]),  # the second one's motion is not in the log
        ([1, 1, 1, 1], [0, 0, 0, 0], [0]),
        ([200, 300, 1e300, np.nan], [0, 1, 0, 1], [0]),  # a damaged field
    ],
)
def test_a_lane_that_cannot_be_read_is_not_followed(
    primary: list[float], logged: list[int], followed: list[int]
) -> None:
    log, order = Lanes(), np.array([10, 11, 20, 21])
    log.tables["XKF4"] = table("XKF4", order, PI=np.array(primary))
    log.tables["XKF1"] = table("XKF1", order, C=np.array(logged), GZ=np.zeros(4))
    assert lanes_in_use(log).lane.tolist() == followed
