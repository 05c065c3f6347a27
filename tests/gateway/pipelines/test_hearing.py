"""One message at a time: sources, what holds, origins, parameters; and the health that counts."""

import math
from typing import Any

import numpy as np
import orjson
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.gyro_delay import gyro_delay_s
from gateway.ingest.log import Boat
from gateway.ingest.mapping import to_degrees
from gateway.live.boats import LiveBoat
from gateway.live.intake import BETTER_SOURCE_NS, MessageIntake
from gateway.samples import Measurement, Quantity
from gateway.shadow import FilterInputs
from gateway.shadow.health import LiveHealth, SequenceNumbers
from gateway.shadow.path import ShadowPath
from sim.following.follower import Reference, VesselFollower
from sim.model import Model
from tests.sim.vessels import WAMV

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PLACE = (634470000, 104000000)  # 1e-7 deg


class Boatswain:
    """Hears messages of a boat that booted a minute ago, with 10 ms of delay."""

    def __init__(self) -> None:
        self.hearing = MessageIntake(Boat(1, 1), FilterSettings())
        self.mav = dialect.MAVLink(None, 1, 1)

    def hear(self, t: float, message: Any) -> FilterInputs | None:
        raw = message.pack(self.mav)
        return self.hearing.take(self.mav.decode(bytearray(raw)), START + round((t + 0.01) * 1e9))


def ms(t: float) -> int:
    return round((60.0 + t) * 1000)


def attitude(t: float, yaw: float = 0.1) -> Any:
    return dialect.MAVLink_attitude_message(ms(t), 0.0, 0.0, yaw, 0.0, 0.0, 0.2)


def local(t: float, north: float = 1.0, east: float = 2.0) -> Any:
    return dialect.MAVLink_local_position_ned_message(ms(t), north, east, 0.0, 0.5, 0.1, 0.0)


def place(t: float, lat: int = PLACE[0], lon: int = PLACE[1]) -> Any:
    return dialect.MAVLink_global_position_int_message(ms(t), lat, lon, 0, 0, 50, 10, 0, 65535)


def servo(t: float, *pulses: int, port: int = 0) -> Any:
    return dialect.MAVLink_servo_output_raw_message(
        ms(t) * 1000, port, *pulses, *([0] * (16 - len(pulses)))
    )


def outputs(t: float, value: float) -> Any:
    return dialect.MAVLink_actuator_output_status_message(ms(t) * 1000, 1, [value] * 32)


def heartbeat(armed: bool) -> Any:
    return dialect.MAVLink_heartbeat_message(11, 3, 128 * armed, 0, 4, 3)


def test_facts_of_one_message_stand_in_order_and_only_the_last_completes_it() -> None:
    feed = Boatswain().hear(0.0, attitude(0.0))
    assert feed is not None
    assert feed.events.kind.tolist() == [MeasurementKind.YAW, MeasurementKind.YAW_RATE]
    assert feed.complete.tolist() == [False, True]
    assert feed.events.z[:, 0] == pytest.approx([0.1, 0.2])
    assert (feed.receive_time_ns - feed.vehicle_time_ns).tolist() == [0, 0]  # the first sets it


def test_a_worse_source_is_heard_only_while_the_better_one_is_silent() -> None:
    boat = Boatswain()
    assert boat.hear(0.0, place(0.0)) is None  # a better one may yet speak up
    assert boat.hear(0.1, local(0.1)) is not None
    patience = BETTER_SOURCE_NS / SECOND
    assert boat.hear(patience, place(patience)) is None
    late = boat.hear(patience + 0.2, place(patience + 0.2))
    assert late is not None
    assert late.events.kind.tolist() == [MeasurementKind.VELOCITY, MeasurementKind.POSITION]
    assert boat.hear(patience + 0.3, local(patience + 0.3)) is not None
    assert boat.hear(patience + 0.4, place(patience + 0.4)) is None


def test_a_clock_set_back_by_an_hour_does_not_silence_a_boat_without_the_best_source() -> None:
    """What came before it is of no time to come, for which a worse source would have to wait."""
    boat, patience, back = Boatswain(), BETTER_SOURCE_NS / SECOND, -3600.0
    assert boat.hear(0.0, local(0.0)) is not None
    assert boat.hear(0.1, place(0.1)) is None
    for k in range(3):  # the boat's own clock goes on
        message = place(2.0 * patience + 0.1 * k)
        assert boat.hear(back + 0.1 * k, message) is not None


def test_ports_of_one_message_join_and_another_message_does_not_mix_in() -> None:
    boat = Boatswain()
    boat.hear(0.0, servo(0.0, 1600, 1400))
    boat.hear(0.1, servo(0.1, 1700, port=1))
    boat.hear(0.2, outputs(0.2, 1900.0))
    feed = boat.hear(0.3, attitude(0.3))
    assert feed is not None
    assert feed.pulses[1, [0, 1, 16]].tolist() == [1600.0, 1400.0, 1700.0]
    assert np.isnan(feed.pulses[1, 2:16]).all()


def test_a_disarmed_boat_commands_nothing() -> None:
    boat = Boatswain()
    boat.hear(0.0, servo(0.0, 1600))
    for armed, pulse in ((False, math.nan), (True, 1600.0)):
        boat.hear(0.1, heartbeat(armed))
        feed = boat.hear(0.2 + armed, attitude(0.2 + armed))
        assert feed is not None
        assert feed.pulses[0, 0] == pytest.approx(pulse, nan_ok=True)


@pytest.mark.parametrize("speed", [math.nan, math.inf, 1e30, -1e30])
def test_absurd_wind_and_voltage_are_not_noted(speed: float) -> None:
    boat = Boatswain()
    boat.hear(0.0, dialect.MAVLink_wind_message(180.0, 5.0, 0.0))
    boat.hear(0.1, dialect.MAVLink_wind_message(180.0, speed, 0.0))
    boat.hear(0.1, dialect.MAVLink_sys_status_message(0, 0, 0, 0, 12600, 0, 0, 0, 0, 0, 0, 0, 0))
    boat.hear(0.2, dialect.MAVLink_sys_status_message(0, 0, 0, 0, 65535, 0, 0, 0, 0, 0, 0, 0, 0))
    feed = boat.hear(0.3, attitude(0.3))
    assert feed is not None
    assert feed.wind[0] == pytest.approx([5.0, 0.0])
    assert feed.voltage[0] == pytest.approx(12.6)


def told_origin(lat: int, lon: int) -> Any:
    return dialect.MAVLink_gps_global_origin_message(lat, lon, 0)


def test_an_origin_that_is_stated_is_taken_and_an_impossible_one_is_not() -> None:
    boat = Boatswain()
    boat.hear(0.0, told_origin(2**31 - 1, 0))
    assert boat.hearing.origin is None
    boat.hear(0.0, told_origin(*PLACE))
    assert boat.hearing.origin == pytest.approx((63.447, 10.4))
    boat.hear(0.0, told_origin(0, -(2**31)))
    assert boat.hearing.origin == pytest.approx((63.447, 10.4))


def pair(boat: Boatswain, t: float, lat: int = PLACE[0], **metres: float) -> None:
    boat.hear(t, local(t, **metres))
    boat.hear(t + 0.02, place(t + 0.02, lat))


def test_two_pairs_of_local_and_global_position_tell_the_origin() -> None:
    boat = Boatswain()
    pair(boat, 0.0)
    assert boat.hearing.origin is None
    pair(boat, 0.2)
    assert boat.hearing.origin is not None
    here = to_degrees(np.array([1.0, 2.0]), boat.hearing.origin)
    assert here == pytest.approx([63.447, 10.4], abs=1e-7)


@pytest.mark.parametrize("north", [1e30, 5e5])
def test_one_wild_position_moves_no_origin(north: float) -> None:
    boat = Boatswain()
    pair(boat, 0.0, north=north)
    pair(boat, 0.2)
    pair(boat, 0.4)
    known = boat.hearing.origin
    pair(boat, 0.6, north=north)
    pair(boat, 0.8)
    assert boat.hearing.origin == known
    assert known is not None
    assert known.latitude_deg == pytest.approx(63.447, abs=1e-4)


def test_a_frame_that_starts_elsewhere_after_a_reboot_moves_the_origin() -> None:
    boat = Boatswain()
    for t in (0.0, 0.2):
        pair(boat, t)
    boat.hearing._origin = boat.hearing._origin.rebooted()
    assert boat.hearing.origin is None
    for t in (0.4, 0.6):
        pair(boat, t, north=3.0)
    assert boat.hearing.origin is not None
    here = to_degrees(np.array([3.0, 2.0]), boat.hearing.origin)
    assert here == pytest.approx([63.447, 10.4], abs=1e-7)


def test_a_boat_that_gives_degrees_alone_counts_from_its_first_place_for_good() -> None:
    boat = Boatswain()
    start = BETTER_SOURCE_NS / SECOND
    boat.hear(0.0, attitude(0.0))
    assert boat.hear(start, place(start, lat=2**31 - 1, lon=2**31 - 1)) is not None  # velocity
    first = boat.hear(start + 0.1, place(start + 0.1))
    boat.hear(start + 0.15, told_origin(0, 0))
    second = boat.hear(start + 0.2, place(start + 0.2, lat=PLACE[0] + 1000))
    assert first is not None
    assert second is not None
    assert first.events.z[-1].tolist() == [0.0, 0.0]
    assert second.events.z[-1] == pytest.approx([11.1, 0.0], abs=0.1)


def test_the_best_fix_of_all_receivers_holds() -> None:
    boat = Boatswain()
    for t, first, second in ((0.0, 1, 3), (1.0, 1, 1), (2.0, 4, 0)):
        boat.hear(t, dialect.MAVLink_gps_raw_int_message(0, first, *PLACE, 0, 1, 1, 0, 0, 9))
        more = dialect.MAVLink_gps2_raw_message(0, second, *PLACE, 0, 1, 1, 0, 0, 9, 0, 0)
        boat.hear(t + 0.1, more)
        heard = boat.hear(t + 0.2, attitude(t))
        assert heard is not None
        assert set(heard.gps_fix.tolist()) == {max(first, second)}


def parameter(value: float, name: bytes = b"INS_GYRO_FILTER") -> Any:
    return dialect.MAVLink_param_value_message(name, value, 9, 1, 0)


def test_the_gyro_filter_is_learnt_from_parameters_that_pass_by() -> None:
    model = Model.of(WAMV)
    path = ShadowPath(model, Reference(model), VesselFollower.of(model))
    boats = [LiveBoat(Boat(system, 1), "b", path) for system in (1, 2)]
    mav = dialect.MAVLink(None, 1, 1)

    def delay(message: Any) -> float:
        list(boats[0].datagram([mav.decode(bytearray(message.pack(mav)))], START))
        return boats[0]._path.estimator.settings.gyro_delay_s

    assert delay(parameter(20.0, b"INS_ACCEL_FILTER")) == 0.0
    assert delay(parameter(4.0)) == pytest.approx(gyro_delay_s(4.0))
    for absurd in (math.nan, math.inf, -4.0, 1e-30):
        assert delay(parameter(absurd)) == pytest.approx(gyro_delay_s(4.0))
    assert delay(parameter(0.0)) == 0.0
    assert boats[1]._path.estimator.settings.gyro_delay_s == 0.0
    assert delay(parameter(40.0, b"IMU_GYRO_CUTOFF")) == pytest.approx(gyro_delay_s(40.0))


def test_until_the_gyro_filter_is_known_the_usual_one_of_the_firmware_is_assumed() -> None:
    model = Model.of(WAMV)
    path = ShadowPath(model, Reference(model), VesselFollower.of(model))
    boat = LiveBoat(Boat(1, 1, "ArduPilot"), "b", path)
    assert boat._path.estimator.settings.gyro_delay_s == gyro_delay_s(4.0)
    assert boat._path.estimator.settings.gyro_delay_std_s > 0.0
    assert path.estimator.settings.gyro_delay_s == 0.0  # other boats share it


def test_numbers_tell_loss_from_lateness_doubles_and_wraps() -> None:
    numbers = SequenceNumbers(250, SECOND)
    heard = [251, 253, 252, 253, 255, 0, 3, 1, 1]
    assert [numbers.note(n, SECOND) for n in heard] == [0, 1, -1, 0, 1, 0, 2, -1, 0]
    assert numbers.missing == {254, 258}
    assert numbers.note(254, 5 * SECOND) == 250  # after a silence it is a new one


def test_numbers_forget_what_can_no_longer_be_late() -> None:
    numbers = SequenceNumbers(0, SECOND)
    for n in range(0, 20_000, 2):
        numbers.note(n % 256, SECOND)
    assert len(numbers.missing) <= 129


def health_row(health: LiveHealth, now_ns: int, backlog: int, drops: int) -> dict[str, float]:
    """The one message of a row of health, as subscribers read it."""
    (payload,) = health.row(now_ns, backlog, drops).payloads
    return orjson.loads(payload)


def test_the_health_row_counts_rates_loss_and_age() -> None:
    health = LiveHealth()
    for k in range(300):
        if k % 3 != 2:
            health.frame(START + k * SECOND // 50, "ATTITUDE", 1, k % 256)
    row = health_row(health, START + 6 * SECOND, 4, 2)
    assert row["rate_attitude_hz"] == pytest.approx(50.0 * 2 / 3, abs=0.3)
    assert row["rate_hz"] == row["rate_attitude_hz"]
    assert row["loss"] == pytest.approx(1 / 3, abs=0.01)
    assert row["link_age_s"] == pytest.approx(0.04)
    assert (row["recorder_backlog"], row["recorder_drops"]) == (4, 2)
    silent = health_row(health, START + 60 * SECOND, 0, 0)
    assert silent["link_age_s"] == pytest.approx(54.04)
    assert (silent["rate_hz"], silent["loss"]) == (0.0, 0.0)


def test_a_clock_set_back_leaves_no_frames_of_the_future_in_the_health() -> None:
    health = LiveHealth()
    for k in range(500):
        health.frame(START + k * SECOND // 50, "ATTITUDE", 1, k % 256)
    back = START - 3600 * SECOND
    for k in range(500, 750):
        health.frame(back + k * SECOND // 50, "ATTITUDE", 1, k % 256)
    assert health_row(health, back + 15 * SECOND, 0, 0)["rate_hz"] == pytest.approx(50.0, abs=0.3)


def test_whatever_is_no_position_tells_no_place() -> None:
    boat = Boatswain()
    fact = Measurement(Quantity.YAW, "ATTITUDE", START, START, (0.1,))
    before = boat.hearing._origin
    assert before.update(fact) is before


@pytest.mark.parametrize("hz", [0.5, 1.0, 20.0])
def test_a_rate_is_that_of_the_last_seconds_however_many_are_kept(hz: float) -> None:
    """Of 1 Hz "1.2 Hz arrive" was told: six messages of the last six seconds, over five."""
    health = LiveHealth()
    for n in range(round(10 * hz)):
        health.frame(round(n * 1e9 / hz), "ATTITUDE", 1, n % 256)
    assert health.rates_hz()["ATTITUDE"] == pytest.approx(hz, abs=0.11)
