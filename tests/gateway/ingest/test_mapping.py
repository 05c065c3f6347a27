"""Message -> facts: scale, sentinel, unit, frame; scalars and columns alike."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.dataflash import mapping as dataflash
from gateway.ingest.dataflash.mapping import RULES as DATAFLASH
from gateway.ingest.log import choose_boat
from gateway.ingest.mapping import Counter, merge_pulses
from gateway.ingest.mavlink.mapping import RULES as MAVLINK
from gateway.live.intake import BoatDecoder
from gateway.samples import Quantity
from tests.gateway.ingest.scripted import Script, attitude, heartbeat, servo, vfr_hud


def facts(message: Any) -> dict[Quantity, tuple[float, ...]]:
    """What one live message says; NaN included."""
    found = {}
    for rule in MAVLINK:
        if rule.message == message.get_type():
            for quantity, values in rule.facts(message):
                found[quantity] = tuple(float(value) for value in values)
    return found


POSITION = {"time_boot_ms": 1, "lat": 634470000, "lon": 104000000, "alt": 0, "relative_alt": 0}
GPS = {"alt": 0, "eph": 1, "epv": 1, "satellites_visible": 9, "time_usec": 10**7}


def position_int(**changed: int) -> Any:
    motion = {"vx": 150, "vy": -50, "vz": 0, "hdg": 9000}
    return dialect.MAVLink_global_position_int_message(**{**POSITION, **motion, **changed})


def gps(**changed: int) -> Any:
    place = {"fix_type": 3, "lat": 634470000, "lon": 104000000, "vel": 200, "cog": 9000}
    return dialect.MAVLink_gps_raw_int_message(**{**GPS, **place, **changed})


def test_simulator_truth_is_never_read() -> None:
    names = {rule.message for rule in (*MAVLINK, *DATAFLASH)}
    assert not [name for name in names if name.startswith("SIM")]


def test_every_rule_names_fields_that_its_message_has() -> None:
    classes = {kind.msgname: kind for kind in dialect.mavlink_map.values()}
    for rule in MAVLINK:
        known = classes[rule.message].fieldnames
        assert not rule.field or rule.field in known
        assert all(name in known for name in rule.instance), rule


def test_sources_are_unique() -> None:
    for table in (MAVLINK, DATAFLASH):
        assert len({rule.source for rule in table}) == len(table)


def test_both_dialects_have_their_own_wind() -> None:
    assert [r.counter for r in MAVLINK if r.message == "WIND"] == [Counter.RECEIPT]
    assert [r.field for r in DATAFLASH if r.message == "WIND"] == ["time_us"]


def test_global_position_in_degrees_metres_and_radians() -> None:
    said = facts(position_int())
    assert said[Quantity.GLOBAL_POSITION] == pytest.approx((63.447, 10.4))
    assert said[Quantity.VELOCITY] == pytest.approx((1.5, -0.5))
    assert said[Quantity.YAW] == pytest.approx((np.pi / 2,))


@pytest.mark.parametrize(
    ("message", "quantity"),
    [
        (position_int(hdg=65535), Quantity.YAW),
        (position_int(lat=0, lon=0), Quantity.GLOBAL_POSITION),
        (gps(vel=65535), Quantity.VELOCITY),
        (gps(cog=65535), Quantity.VELOCITY),
        (gps(fix_type=1), Quantity.GLOBAL_POSITION),
        (gps(fix_type=1), Quantity.VELOCITY),
        (dialect.MAVLink_system_time_message(0, 5), Quantity.UNIX_TIME),
        (heartbeat(autopilot=dialect.MAV_AUTOPILOT_INVALID), Quantity.ARMED),
    ],
)
def test_sentinels_are_not_values(message: Any, quantity: Quantity) -> None:
    assert np.isnan(facts(message)[quantity]).all()


def test_gps_speed_and_course_become_north_and_east() -> None:
    assert facts(gps())[Quantity.VELOCITY] == pytest.approx((0.0, 2.0), abs=1e-12)
    assert facts(gps())[Quantity.FIX] == (3.0,)


def test_a_fix_without_height_is_a_fix_on_the_water() -> None:
    assert facts(gps(fix_type=2)) == {**facts(gps()), Quantity.FIX: (2.0,)}


def quaternion_of(roll: float, pitch: float, yaw: float) -> tuple[float, ...]:
    half = np.array([roll, pitch, yaw]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def test_quaternion_gives_the_same_attitude() -> None:
    roll, pitch, yaw = 0.1, -0.2, 2.5
    q = quaternion_of(roll, pitch, yaw)
    said = facts(dialect.MAVLink_attitude_quaternion_message(1, *q, 0.0, 0.0, 0.0))
    assert said[Quantity.YAW] == pytest.approx((yaw,), abs=1e-6)
    assert said[Quantity.TILT] == pytest.approx((roll, pitch), abs=1e-6)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.35, 0.0), (-0.6, 0.4), (0.1, -0.9)])
def test_a_boat_that_rolls_turns_its_bow_by_pitching(tilt: tuple[float, float]) -> None:
    """Body rates of a heading that turns at 0.3 rad/s while roll and pitch change too."""
    roll, pitch = tilt
    roll_rate, pitch_rate, turn = 0.2, -0.4, 0.3
    p = roll_rate - turn * np.sin(pitch)
    q = pitch_rate * np.cos(roll) + turn * np.sin(roll) * np.cos(pitch)
    r = -pitch_rate * np.sin(roll) + turn * np.cos(roll) * np.cos(pitch)
    still = [0.0] * 21
    for message in (
        dialect.MAVLink_attitude_message(1, roll, pitch, 2.5, p, q, r),
        dialect.MAVLink_attitude_quaternion_message(1, *quaternion_of(roll, pitch, 2.5), p, q, r),
        dialect.MAVLink_odometry_message(
            5, 1, 12, 0.0, 0.0, 0.0, [*quaternion_of(roll, pitch, 2.5)], 0.0, 0.0, 0.0, p, q, r,
            still, still,
        ),
    ):  # fmt: skip
        assert facts(message)[Quantity.YAW_RATE] == pytest.approx((turn,), abs=1e-6)


def test_the_gyro_of_a_level_boat_is_taken_to_the_last_bit() -> None:
    rates = [
        facts(dialect.MAVLink_attitude_message(1, roll, 0.02, 2.5, 0.0, 0.01, 0.3))[
            Quantity.YAW_RATE
        ]
        for roll in (-0.09, 0.0, 0.03)
    ]
    assert rates == [(0.3,)] * 3


def test_a_bow_that_points_straight_up_is_no_division_by_zero() -> None:
    said = facts(dialect.MAVLink_attitude_message(1, 0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.3))
    assert 0.3 < said[Quantity.YAW_RATE][0] < 1.0


def test_servo_pulses_know_both_ports_and_no_pulse() -> None:
    first = facts_of_rule("SERVO_OUTPUT_RAW", servo(1.0, 1500, 0, 65535, 1100))
    assert first[:4] == pytest.approx([1500.0, np.nan, np.nan, 1100.0], nan_ok=True)
    assert np.isnan(first[4:]).all()
    second = facts_of_rule("SERVO_OUTPUT_RAW/1", servo(1.0, 1600, port=1))
    assert second[16] == 1600.0
    assert np.isnan(np.delete(second, 16)).all()


def facts_of_rule(source: str, message: Any) -> Any:
    (rule,) = [rule for rule in MAVLINK if rule.source == source]
    ((_, values),) = rule.facts(message)
    return np.array([float(value) for value in values])


def test_merged_pulses_keep_what_the_source_does_not_speak_of() -> None:
    before = np.full(32, 1400.0)
    values = np.full(32, np.nan)
    values[0] = 1600.0
    now = merge_pulses(before, (1, 16), values)
    assert now[0] == 1600.0
    assert np.isnan(now[1:16]).all()  # no pulse any more
    assert (now[16:] == 1400.0).all()  # not said


def test_voltage_of_cells_and_of_the_whole_battery() -> None:
    battery = dialect.MAVLink_battery_status_message(
        0, 0, 0, 0, [4100, 4000, *[65535] * 8], 0, 0, 0, 0
    )
    assert facts(battery)[Quantity.VOLTAGE] == pytest.approx((8.1,))
    silent = dialect.MAVLink_battery_status_message(0, 0, 0, 0, [65535] * 10, 0, 0, 0, 0)
    assert np.isnan(facts(silent)[Quantity.VOLTAGE]).all()


def test_wind_blows_towards_where_it_does_not_come_from() -> None:
    said = facts(dialect.MAVLink_wind_message(90.0, 5.0, 0.0))
    assert said[Quantity.WIND] == pytest.approx((0.0, -5.0), abs=1e-9)


def test_raw_imu_is_mg_and_mrad() -> None:
    said = facts(dialect.MAVLink_scaled_imu_message(1, 1000, -500, 0, 0, 0, 250, 0, 0, 0))
    assert said[Quantity.ACCELERATION] == pytest.approx((9.80665, -4.903325))
    assert said[Quantity.YAW_RATE] == pytest.approx((0.25,))


def test_highres_imu_gives_only_what_was_updated() -> None:
    zeros = [0.0] * 12
    zeros[0], zeros[5] = 1.0, 0.5
    said = facts(dialect.MAVLink_highres_imu_message(5, *zeros, 0.0, 1 << 5))
    assert said[Quantity.YAW_RATE] == (0.5,)
    assert np.isnan(said[Quantity.ACCELERATION]).all()


def test_odometry_velocity_goes_by_the_frame_that_it_names() -> None:
    def odometry(child: int) -> Any:
        return dialect.MAVLink_odometry_message(
            5, 1, child, 1.0, 2.0, 0.0, [1.0, 0.0, 0.0, 0.0], 3.0, 4.0, 0.0, 0.0, 0.0, 0.1,
            [0.0] * 21, [0.0] * 21,
        )  # fmt: skip

    body, world = facts(odometry(12)), facts(odometry(1))
    assert body[Quantity.BODY_VELOCITY] == (3.0, 4.0)
    assert np.isnan(body[Quantity.VELOCITY]).all()
    assert world[Quantity.VELOCITY] == (3.0, 4.0)
    assert np.isnan(world[Quantity.BODY_VELOCITY]).all()


def test_dataflash_angles_are_degrees() -> None:
    row = SimpleNamespace(PN=1.0, PE=2.0, VN=0.5, VE=-0.5, Yaw=180.0)
    said = dict(dataflash.kalman(row))
    assert said[Quantity.YAW][0] == pytest.approx(np.pi)
    ((_, armed),) = dataflash.event(SimpleNamespace(Id=np.array([10, 11, 15])))
    assert armed[0] == pytest.approx([1.0, 0.0, np.nan], nan_ok=True)


def mixed_voyage() -> Script:
    """Ten seconds of several messages with duplicates, sentinels and a second port."""
    script = Script()
    generator = np.random.default_rng(3)
    for k in range(100):
        boot, receipt = 50.0 + 0.1 * k, 0.1 * k + generator.exponential(0.05)
        script.send(receipt, attitude(boot, yaw=0.01 * k, yaw_rate=0.1))
        script.send(receipt + 1e-3, servo(boot, 1500 + k, 0))
        script.send(receipt + 2e-3, servo(boot, 1000 + k, port=1))
        script.send(receipt + 3e-3, vfr_hud(0.3 * k, heading_deg=3 * k))
        script.send(receipt + 3e-3, position_int(time_boot_ms=round(1000 * boot), vx=-3 * k))
        script.send(receipt + 4e-3, dialect.MAVLink_wind_message(3.3 * k, 2.2, 0.0))
        script.send(receipt + 4e-3, gps(time_usec=round(boot * 1e6) // 500_000 * 500_000))
        if k % 10 == 0:
            script.send(receipt + 5e-3, attitude(boot, yaw=0.01 * k))  # again
            script.send(receipt + 5e-3, heartbeat(armed=k > 50))
    return script


def test_live_messages_and_the_columns_of_a_log_say_the_same() -> None:
    script = mixed_voyage()
    log = script.log()
    boat = choose_boat(log)
    bulk = log.decode(boat)
    decoder = BoatDecoder(boat)
    live = [m for receive, message in script.sent for m in decoder.measurements(message, receive)]
    by_key: dict[tuple[Quantity, str], list[Any]] = {}
    for one in live:
        by_key.setdefault((one.quantity, one.source), []).append(one)
    assert set(by_key) == {(s.quantity, s.source) for s in bulk.samples}
    for samples in bulk.samples:
        ones = by_key[samples.quantity, samples.source]
        assert [m.vehicle_time_ns for m in ones] == samples.vehicle_time_ns.tolist()
        assert [m.receive_time_ns for m in ones] == samples.receive_time_ns.tolist()
        np.testing.assert_array_equal(np.array([m.values for m in ones]), samples.values)
    assert decoder.clock.report() == bulk.clock
    assert bulk.clock.duplicates > 10


def test_a_fix_that_is_lost_is_told_though_its_message_is_stamped_with_the_last_one() -> None:
    """As ArduRover 4.6.3 does: type 1 and the time of the last fix, until there is one again."""
    script = Script()
    script.send(0.0, heartbeat())
    for k in range(20):
        boot = 100.0 + 0.2 * k
        script.send(0.2 * k, attitude(boot, yaw=0.01 * k))
        lost = 5 <= k < 15
        stamp = 100.8 if lost else boot
        script.send(0.2 * k, gps(time_usec=round(stamp * 1e6), fix_type=1 if lost else 3))
    found = script.log().decode(choose_boat(script.log()))
    ((_, fixes),) = [(s.source, s.values[:, 0]) for s in found.of(Quantity.FIX)]
    assert fixes.tolist() == [3.0] * 5 + [1.0] * 10 + [3.0] * 5
    (places,) = [s for s in found.of(Quantity.GLOBAL_POSITION) if s.source == "GPS_RAW_INT"]
    assert len(places) == 10


@pytest.mark.parametrize(("autopilot", "stopped"), [(12, np.nan), (3, 900.0)])
def test_an_output_that_px4_has_stopped_has_no_pulse(autopilot: int, stopped: float) -> None:
    """PX4's simulated outputs as it sent them: astern, then one motor stopped; others never set."""
    script = Script()
    script.send(0.0, heartbeat(autopilot=autopilot))
    for k, (left, right) in enumerate([(1250, 1250), (1250, 900)]):
        script.send(0.2 * k, attitude(100.0 + 0.2 * k))
        script.send(0.2 * k, servo(100.0 + 0.2 * k, left, right, *[900] * 14))
    log = script.log()
    boat = choose_boat(log)
    (bulk,) = log.decode(boat).of(Quantity.ACTUATORS)
    decoder = BoatDecoder(boat)
    told = [one for at, message in script.sent for one in decoder.measurements(message, at)]
    live = [one.values for one in told if one.quantity is Quantity.ACTUATORS]
    np.testing.assert_array_equal(np.array(live), bulk.values)
    np.testing.assert_array_equal(
        bulk.values[:, :3], [[1250.0, 1250.0, stopped], [1250.0, stopped, stopped]]
    )


def test_an_ekf_of_px4_that_rests_has_its_position() -> None:
    """As the firmware said it of a boat that lay disarmed, armed, and before the GPS was used."""
    said = [0b1110111111, 0b1100111111, 0b10100101]
    messages = [dialect.MAVLink_estimator_status_message(1, f, *[0.1] * 8) for f in said]
    assert [facts(m)[Quantity.ESTIMATOR] for m in messages] == [(0.0,), (0.0,), (6.0,)]


def test_rows_of_other_systems_and_components_are_not_mixed_in() -> None:
    script = Script()
    for k in range(20):
        script.send(0.1 * k, heartbeat())
        script.send(0.1 * k, attitude(5.0 + 0.1 * k, yaw=1.0))
        script.send(0.1 * k, attitude(5.05 + 0.1 * k, yaw=2.0), component=191)
        script.send(0.1 * k, attitude(5.02 + 0.1 * k, yaw=3.0), system=2)
    log = script.log()
    decoded = log.decode(choose_boat(log))
    (yaw,) = decoded.of(Quantity.YAW)
    assert np.unique(yaw.values) == pytest.approx([1.0])
    assert decoded.clock.reboots == 0
