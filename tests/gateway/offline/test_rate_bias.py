"""A gyro's bias: where it is plain, and that it bends no heading and no speed sideways."""

import numpy as np
import pytest

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import Events
from gateway.offline.rate_bias import rate_bias, smooth_with_bias
from sim.state import Floats, wrap

HZ, SECONDS = 10.0, 240.0
TIME = np.arange(0.0, SECONDS, 1.0 / HZ)


def sailed(
    bias: float = 0.0,
    scale: float = 1.0,
    silent: tuple[float, float] = (0.0, 0.0),
    jump: float = 0.0,
) -> tuple[Events, Floats]:
    """Weaving at 1.5 m/s: its events, with noise, and its heading (T,) without.

    bias [rad/s] and scale of the gyro; no heading between two moments; a compass that jumps [rad]
    """
    rng = np.random.default_rng(4)
    psi = 0.9 * np.sin(0.15 * TIME) + 0.01 * TIME
    turn = 0.135 * np.cos(0.15 * TIME) + 0.01
    velocity = 1.5 * np.stack([np.cos(psi), np.sin(psi)], axis=1)
    yaw = wrap(psi + jump * (TIME > 100.0) + rng.normal(0.0, 0.01, len(TIME)))
    rate = scale * turn + bias + rng.normal(0.0, 0.003, len(TIME))
    velocity += rng.normal(0.0, 0.02, velocity.shape)
    heard = (TIME < silent[0]) | (TIME >= silent[1])
    zero = np.zeros(len(TIME))
    parts = [
        (MeasurementKind.YAW, np.stack([yaw, zero], axis=1), 0.01, heard),
        (MeasurementKind.YAW_RATE, np.stack([rate, zero], axis=1), 0.003, heard | True),
        (MeasurementKind.VELOCITY, velocity, 0.02, heard | True),
    ]
    time = np.concatenate([TIME[rows] for *_, rows in parts])
    kind = np.concatenate([np.full(rows.sum(), int(k)) for k, *_, rows in parts])
    z = np.concatenate([z[rows] for _, z, _, rows in parts])
    std = np.concatenate([np.full((rows.sum(), 2), s) for *_, s, rows in parts])
    order = np.argsort(time, kind="stable")
    return Events(time[order], kind[order], z[order], std[order]), psi


@pytest.mark.parametrize(
    "also", [{}, {"jump": 1.2}, {"silent": (60.0, 90.0)}, {"scale": 0.95}], ids=str
)
@pytest.mark.parametrize("bias", [0.05, -0.012])
def test_a_plain_bias_is_found_to_a_tenth(bias: float, also: dict[str, float]) -> None:
    assert rate_bias(sailed(bias, **also)[0]) == pytest.approx(bias, abs=2e-3)


@pytest.mark.parametrize("also", [{}, {"scale": 0.8}, {"jump": -2.0}, {"silent": (30.0, 200.0)}])
def test_no_bias_is_found_where_there_is_none(also: dict[str, float]) -> None:
    assert rate_bias(sailed(0.0, **also)[0]) == 0.0
    assert rate_bias(sailed(0.004, **also)[0]) == 0.0  # as an estimator leaves it


def test_of_a_minute_nothing_is_said() -> None:
    events, _ = sailed(0.05)
    assert rate_bias(events[events.time_s < 60.0]) == 0.0
    turns = events.kind == int(MeasurementKind.YAW_RATE)
    assert rate_bias(events[turns]) == 0.0
    assert rate_bias(events[~turns]) == 0.0


def test_a_bias_stays_in_the_rate_and_bends_nothing_else() -> None:
    grid = np.arange(5.0, SECONDS - 5.0, 0.2)
    events, psi = sailed(0.05)
    motion = smooth_with_bias(events, grid, FilterSettings())
    plain = smooth_with_bias(sailed()[0], grid, FilterSettings())
    np.testing.assert_allclose(motion.nu[:, 2] - plain.nu[:, 2], 0.05, atol=2e-3)
    apart = wrap(motion.eta[:, 2] - np.interp(grid, TIME, psi))
    assert np.abs(apart).mean() < 0.01
    np.testing.assert_allclose(motion.nu[:, 1], plain.nu[:, 1], atol=0.01)
