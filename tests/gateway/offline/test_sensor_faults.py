"""Sensors that contradict each other judge no model afterwards; what rightly stands still does."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.estimation import MeasurementKind
from gateway.estimation.events import Events, join, make_events
from gateway.offline.usable_time import compass_jumped, frozen
from gateway.shadow.sensor_checks import SETTLE_S
from sim.state import Floats

SECONDS, BEGIN, END = 120.0, 50.0, 70.0
GRID = np.arange(0.0, SECONDS, 0.1)


def motion(turn: float = 0.1, speed: float = 1.5) -> dict[str, tuple[Floats, Floats]]:
    """A steady turn without noise: heading and gyro at 10 Hz, velocity and position at 5 Hz."""
    fast, slow = np.arange(0.0, SECONDS, 0.1), np.arange(0.0, SECONDS, 0.2)
    psi = 0.3 + turn * slow
    velocity = speed * np.stack([np.cos(psi), np.sin(psi)], axis=1)
    if turn:
        place = speed / turn * np.stack([np.sin(psi), -np.cos(psi)], axis=1)
    else:
        place = velocity * slow[:, None]
    return {
        "YAW": (fast, np.angle(np.exp(1j * (0.3 + turn * fast)))),
        "YAW_RATE": (fast, np.full(len(fast), turn)),
        "VELOCITY": (slow, velocity),
        "POSITION": (slow, place),
    }


def events(sources: dict[str, tuple[Floats, Floats]]) -> Events:
    parts = [make_events(MeasurementKind[n], t, z, 0.01) for n, (t, z) in sources.items()]
    found = join(parts)
    return found[np.argsort(found.time_s, kind="stable")]


def held(source: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """The same, keeping from BEGIN to END what it was at BEGIN."""
    time, values = source
    inside = (time >= BEGIN) & (time <= END)
    kept = values.copy()
    kept[inside] = values[np.flatnonzero(inside)[0]]
    return time, kept


def edges(flags: np.ndarray) -> tuple[float, float]:
    """First and last moment of the one stretch."""
    rows = np.flatnonzero(flags)
    assert len(rows) == rows[-1] - rows[0] + 1
    return GRID[rows[0]], GRID[rows[-1]]


@pytest.mark.parametrize("what", ["YAW", "VELOCITY", "POSITION"])
def test_what_stands_still_while_the_boat_turns_is_left_out_from_its_first_moment(
    what: str,
) -> None:
    sources = motion()
    flags = frozen(events({**sources, what: held(sources[what])}), GRID)
    assert edges(flags) == pytest.approx((BEGIN, END + SETTLE_S), abs=0.31)


def test_a_gyro_that_stands_still_while_the_heading_swings_is_left_out() -> None:
    sources = motion(turn=0.0)
    time = sources["YAW"][0]
    sources["YAW"] = (time, 0.5 * np.sin(0.4 * time))
    sources["YAW_RATE"] = (time, 0.2 * np.cos(0.4 * time))
    del sources["VELOCITY"], sources["POSITION"]
    assert not frozen(events(sources), GRID).any()
    flags = frozen(events({**sources, "YAW_RATE": held(sources["YAW_RATE"])}), GRID)
    assert edges(flags) == pytest.approx((BEGIN, END + SETTLE_S), abs=0.31)


def test_a_velocity_in_the_boats_own_axes_is_turned_first() -> None:
    """Steady in the body while the boat turns: right. Kept though the boat slows down: wrong."""
    sources = motion()
    time = sources.pop("VELOCITY")[0]
    steady = np.tile([1.5, 0.0], (len(time), 1))
    assert not frozen(events({**sources, "BODY_VELOCITY": (time, steady)}), GRID).any()
    place = sources["POSITION"][1].copy()
    stopped = time >= BEGIN
    place[stopped] = place[np.flatnonzero(stopped)[0]] + np.outer(time[stopped] - BEGIN, [0.01, 0])
    sources["POSITION"] = (time, place)
    assert frozen(events({**sources, "BODY_VELOCITY": (time, steady)}), GRID).any()


@pytest.mark.parametrize(("turn", "speed"), [(0.0, 1.5), (0.1, 1.5), (0.0, 0.0)])
def test_a_table_without_noise_contradicts_nothing(turn: float, speed: float) -> None:
    found = events(motion(turn, speed))
    assert not frozen(found, GRID).any()
    assert not compass_jumped(found, GRID).any()


def test_one_source_alone_and_none_are_nothing_to_compare() -> None:
    for name, source in motion().items():
        assert not frozen(events({name: held(source)}), GRID).any()
    assert not frozen(replace(events(motion()))[:0], GRID).any()


def test_at_anchor_a_wandering_receiver_and_an_uncorrected_gyro_are_no_contradiction() -> None:
    rng = np.random.default_rng(3)
    sources = motion(turn=0.0, speed=0.0)
    time, place = sources["POSITION"]
    sources["POSITION"] = (time, 1.0 * np.cumsum(rng.normal(0.0, 0.05, place.shape), axis=0))
    fast = sources["YAW_RATE"][0]
    sources["YAW_RATE"] = (fast, 0.01 + rng.normal(0.0, 0.002, len(fast)))
    assert not frozen(events(sources), GRID).any()


def test_a_heading_that_jumps_is_left_out_until_it_is_back() -> None:
    sources = motion(turn=0.05)
    time, yaw = sources["YAW"]
    off = np.where((time >= BEGIN) & (time < END), 0.6, 0.0)
    flags = compass_jumped(
        events({**sources, "YAW": (time, np.angle(np.exp(1j * (yaw + off))))}), GRID
    )
    assert edges(flags) == pytest.approx((BEGIN, END + SETTLE_S), abs=0.31)


@pytest.mark.parametrize(("back", "left_out"), [(100.0, 100.0), (1e9, 0.0)])
def test_a_heading_that_never_comes_back_is_believed_once_it_has_settled(
    back: float, left_out: float
) -> None:
    """Four minutes of them, the compass 34° off from the fiftieth second on."""
    fast = np.arange(0.0, 240.0, 0.1)
    off = np.where((fast >= BEGIN) & (fast < BEGIN + back), 0.6, 0.0)
    yaw = np.angle(np.exp(1j * (0.3 + 0.05 * fast + off)))
    found = events({"YAW": (fast, yaw), "YAW_RATE": (fast, np.full(len(fast), 0.05))})
    rows = fast[compass_jumped(found, fast)]
    assert rows[[0, -1]] == pytest.approx([BEGIN, BEGIN + left_out + SETTLE_S], abs=0.6)


def test_a_heading_that_jumps_near_the_end_is_not_believed() -> None:
    """Whether it comes back is not known."""
    sources = motion(turn=0.05)
    time, yaw = sources["YAW"]
    jumped = np.angle(np.exp(1j * (yaw + np.where(time >= BEGIN, 0.6, 0.0))))
    flags = compass_jumped(events({**sources, "YAW": (time, jumped)}), GRID)
    assert edges(flags) == pytest.approx((BEGIN, GRID[-1]), abs=0.31)
