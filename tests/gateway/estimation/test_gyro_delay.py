"""The delay of the yaw rate where no parameter tells it: a turn is no jump, a jump still is one."""

import numpy as np
import pytest

from gateway.estimation import FilterSettings, Flag, MeasurementKind, State
from gateway.estimation.filter import Estimator
from gateway.estimation.gyro_delay import assumed_texts, gyro_delay_of, gyro_delay_s
from tests.gateway.estimation.boat import STEP, integrate, telemetry

TRUE_DELAY = FilterSettings(gyro_delay_s=gyro_delay_s(4.0))
SETTINGS = {name: FilterSettings().with_parameters({}, name) for name in ("", "ArduPilot", "PX4")}


def steered(seconds=60.0):
    """A boat that is steered from side to side, hard: 0.5 rad/s within a second."""
    time = STEP * np.arange(round(seconds / STEP) + 1)
    rate = 0.5 * np.tanh(5.0 * np.sin(0.9 * time))
    nu = np.column_stack([np.full(len(time), 1.5), np.zeros(len(time)), rate])
    return integrate(nu, np.gradient(nu, STEP, axis=0), 0.3)


@pytest.fixture(scope="module")
def reported():
    """What such a boat tells: its gyro behind a low-pass of 4 Hz."""
    return telemetry(np.random.default_rng(4), steered(), TRUE_DELAY)


def headings_that(flag, events, settings):
    """How many headings got that flag."""
    estimator = Estimator(settings)
    _, rows = estimator.advance(estimator.start(), events)
    return int(np.count_nonzero(rows.has(flag) & (events.kind == MeasurementKind.YAW)))


@pytest.mark.parametrize("autopilot", SETTINGS)
def test_a_turn_is_no_jump_where_nothing_tells_the_delay(reported, autopilot):
    assert headings_that(Flag.JUMP, reported, FilterSettings()) > 3  # as if there were none
    assert headings_that(Flag.GATED, reported, SETTINGS[autopilot]) == 0


@pytest.mark.parametrize("autopilot", SETTINGS)
def test_the_yaw_rate_is_as_good_as_it_says(reported, autopilot):
    estimator, late = Estimator(SETTINGS[autopilot]), reported.time_s > 10.0
    _, rows = estimator.advance(estimator.start(), reported)
    error = rows.motion[late, State.R] - steered().at(reported.time_s[late])[:, State.R]
    assert np.sqrt(np.mean(error**2)) < 2.0 * np.mean(rows.std[late, State.R])


@pytest.mark.parametrize("autopilot", SETTINGS)
def test_a_compass_that_jumps_still_does(reported, autopilot):
    jumped = reported.z.copy()
    jumped[(reported.kind == MeasurementKind.YAW) & (reported.time_s > 31.0), 0] += np.radians(15.0)
    events = type(reported)(reported.time_s, reported.kind, jumped, reported.std)
    assert headings_that(Flag.JUMP, events, SETTINGS[autopilot]) == 1


@pytest.mark.parametrize("absurd", [0.2, -4.0, 1e-30, 1e5, np.inf, np.nan])
def test_a_cut_off_that_cannot_be_tells_nothing(absurd):
    parameters = {"INS_GYRO_FILTER": absurd}
    assert gyro_delay_of(parameters, "ArduPilot") == gyro_delay_of({}, "ArduPilot")
    assert assumed_texts(parameters, "ArduPilot") == assumed_texts({}, "ArduPilot")


def test_what_is_assumed_is_the_usual_filter_and_is_said():
    assert gyro_delay_of({"IMU_GYRO_CUTOFF": 20.0}, "PX4") == (gyro_delay_s(20.0), 0.0)
    assert gyro_delay_of({"INS_GYRO_FILTER": 0.0}, "ArduPilot") == (0.0, 0.0)
    assert gyro_delay_of({}, "ArduPilot").seconds == gyro_delay_s(4.0)
    assert gyro_delay_of({}, "PX4").seconds == gyro_delay_s(40.0)
    assert gyro_delay_of({}).seconds == 0.0
    assert assumed_texts({"INS_GYRO_FILTER": 4.0}, "ArduPilot") == ()
    (text,) = assumed_texts({}, "ArduPilot")
    assert "(INS_GYRO_FILTER): the 56 ms of ArduPilot's usual 4 Hz are taken" in text
    assert "up to 60 ms" in assumed_texts({}, "")[0]
    set_by_hand = FilterSettings(gyro_delay_std_s=0.01)
    assert set_by_hand.with_parameters({}, "PX4") is set_by_hand
