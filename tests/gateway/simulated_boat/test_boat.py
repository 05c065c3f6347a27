"""What a simulated boat sends, when, and that it is a pure function of its seed."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.simulated_boat import FAST, THIN, Faults, Reboot, SimulatedBoatSettings
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.user_effects import load_effects
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import named
from sim.vessel import AddedEffect
from tests.conftest import ROOT
from tests.gateway.simulated_boat.frames import (
    decoded,
    frames_of,
    log_of,
    messages_named,
    simulated_boat,
)
from tests.sim.vessels import WAMV

SECONDS = 20.0
REBOOTING = Faults(reboots=(Reboot(at_s=10.0, down_s=2.0),))


@pytest.mark.parametrize("rates", [THIN, FAST], ids=["thin", "fast"])
def test_every_message_comes_at_its_rate(rates):
    counts = Counter(m.get_type() for m in decoded(frames_of(simulated_boat(rates=rates), SECONDS)))
    for name, rate in rates.items():
        assert abs(counts[name] - rate * SECONDS) <= 1, name


def test_a_stream_is_even():
    messages = messages_named(frames_of(simulated_boat(rates=FAST), SECONDS), "ATTITUDE")
    assert set(np.diff([m.time_boot_ms for m in messages])) == {20}


def test_a_loop_too_slow_for_its_rates_sends_one_message_a_turn():
    frames = frames_of(simulated_boat(rates={"HEARTBEAT": 1.0, "ATTITUDE": 400.0}), 4.0)
    assert abs(len(messages_named(frames, "ATTITUDE")) - 200) <= 1


def test_the_same_seed_gives_the_same_bytes_however_time_is_cut():
    whole = frames_of(simulated_boat(seed=3, rates=FAST), 4.0)
    boat = simulated_boat(seed=3, rates=FAST)
    state, parts = boat.start(), []
    for until in (0.0, 0.013, 0.9, 0.9, 2.345, 3.0, 4.0):
        state, frames = boat.advance(state, until)
        parts += frames
    assert parts == whole
    assert frames_of(simulated_boat(seed=4, rates=FAST), 4.0) != whole


def test_a_state_can_be_advanced_twice():
    boat = simulated_boat()
    state, _ = boat.advance(boat.start(), 2.0)
    assert boat.advance(state, 4.0)[1] == boat.advance(state, 4.0)[1]


def test_its_heartbeat_is_that_of_an_armed_surface_boat():
    beat = messages_named(frames_of(simulated_boat(), 2.0), "HEARTBEAT")[0]
    assert beat.type == mavlink.MAV_TYPE_SURFACE_BOAT
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_disarmed_means_no_thrust():
    frames = frames_of(simulated_boat(armed=(2.0, 9.0), noise=0.0, rates=FAST), 12.0)
    armed = [bool(m.base_mode & 128) for m in messages_named(frames, "HEARTBEAT")]
    assert armed == [k in range(2, 9) for k in range(13)]
    servo = messages_named(frames, "SERVO_OUTPUT_RAW")
    before = [m for m in servo if m.time_usec < 32e6]
    after = [m for m in servo if 32.1e6 < m.time_usec < 38.9e6]
    assert {m.servo1_raw for m in before} == {1500}
    assert {m.servo1_raw for m in after} != {1500}
    rest = [m for m in messages_named(frames, "LOCAL_POSITION_NED") if m.time_boot_ms < 32000]
    assert all(m.vx == 0.0 and m.x == 0.0 for m in rest)


def test_messages_agree_with_each_other():
    """One boat in many units: local, global, heading, speed."""
    frames = frames_of(simulated_boat(rates=dict.fromkeys(FAST, 10.0), noise=0.0), SECONDS)
    local, position = (
        messages_named(frames, "LOCAL_POSITION_NED")[-1],
        messages_named(frames, "GLOBAL_POSITION_INT"),
    )
    near = min(position, key=lambda m: abs(m.time_boot_ms - local.time_boot_ms))
    assert abs(near.time_boot_ms - local.time_boot_ms) < 100
    lat0, lon0 = SimulatedBoatSettings().origin_deg
    assert (near.lat * 1e-7 - lat0) * 111_400.0 == pytest.approx(local.x, rel=0.01, abs=0.2)
    along = np.cos(np.radians(lat0)) * 111_400.0
    assert (near.lon * 1e-7 - lon0) * along == pytest.approx(local.y, rel=0.01, abs=0.2)
    attitude, hud = messages_named(frames, "ATTITUDE")[-1], messages_named(frames, "VFR_HUD")[-1]
    assert np.cos(attitude.yaw - np.radians(hud.heading)) > 0.999
    assert hud.groundspeed == pytest.approx(np.hypot(local.vx, local.vy), abs=0.1)
    assert hud.groundspeed > 0.3


@pytest.mark.slow
def test_the_gyro_is_delayed_by_the_autopilots_filter():
    """Yaw rate as reported lags the derivative of yaw by that of a 4 Hz low-pass: 56 ms."""
    frames = frames_of(simulated_boat(rates=FAST, noise=0.0), 100.0)
    attitude = messages_named(frames, "ATTITUDE")[4000:]
    yaw, rate = np.unwrap([m.yaw for m in attitude]), np.array([m.yawspeed for m in attitude])
    true = np.gradient(yaw, 0.02)
    off = [np.std(rate[8:] - true[8 - lag : len(true) - lag]) for lag in range(8)]
    assert int(np.argmin(off)) == 3  # ticks of 20 ms


def test_noise_is_noise():
    quiet, loud = (
        np.array(
            [
                m.yawspeed
                for m in messages_named(
                    frames_of(simulated_boat(noise=n, rates=FAST), 4.0), "ATTITUDE"
                )
            ]
        )
        for n in (0.0, 1.0)
    )
    assert 0.001 < np.std(loud - quiet) < 0.01


def test_the_narrow_clock_wraps():
    frames = frames_of(simulated_boat(boot_s=2.0**32 * 1e-6 - 5.0, rates=FAST), 10.0)
    clock = np.array([m.time_usec for m in messages_named(frames, "SERVO_OUTPUT_RAW")])
    assert (np.diff(clock) < 0).sum() == 1
    assert clock.max() < 2**32
    assert log_of(frames).statistics.bad_checksum == 0


def test_a_reboot_sets_clock_and_numbers_to_zero_and_keeps_parameters():
    boat = simulated_boat(faults=REBOOTING, rates=FAST)
    frames = frames_of(boat, 20.0)
    down = [f for f in frames if 10.0 <= f.time_s < 12.0]
    assert not down
    clock = [m.time_boot_ms for m in messages_named(frames, "ATTITUDE")]
    assert clock[0] == 30000 + clock[0] % 1000
    assert 2000 <= min(clock) < 2100
    assert frames[-1].boot_s == pytest.approx(10.0)
    after = [f for f in frames if f.time_s >= 12.0]
    assert after[0].data[4] == 0  # sequence number
    values = [
        {m.param_id: m.param_value for m in messages_named(part, "PARAM_VALUE")}
        for part in ([f for f in frames if f.time_s < 10.0], after)
    ]
    assert values[0] == values[1] != {}


def test_a_reboot_moves_the_local_origin_to_where_the_boat_is():
    frames = frames_of(simulated_boat(faults=REBOOTING, rates=FAST, noise=0.0), 20.0)
    position = messages_named(frames, "LOCAL_POSITION_NED")
    first = next(m for m in position if m.time_boot_ms < 30000)
    assert np.hypot(first.x, first.y) < 3.0 < np.hypot(position[240].x, position[240].y)
    origins = {(m.latitude, m.longitude) for m in messages_named(frames, "GPS_GLOBAL_ORIGIN")}
    assert len(origins) == 2


LATE = """
from typing import NamedTuple
from sim.effects.effect import Effect, Parameter, Scope

class Parameters(NamedTuple):
    seconds: float

def delay(p: Parameters) -> float:
    return p.seconds

EFFECT = Effect(name="late", scope=Scope.BOAT, delay=delay, looks_like="late",
    parameters=(Parameter("seconds", unit="s", lower=0.0, upper=5.0, start=0.5),))
"""


@pytest.mark.slow
@pytest.mark.usefixtures("plain_laws")
def test_commands_that_act_late_are_remembered(tmp_path):
    """The pulses are sent at once, the boat moves when the delay is over."""
    (tmp_path / "late.py").write_text(LATE)
    (effect,) = load_effects(tmp_path / "late.py")
    vessel = replace(WAMV, effects=(AddedEffect(effect, {"seconds": 0.6}),))
    settings = SimulatedBoatSettings(rates=FAST, noise=0.0, armed=(2.0, 99.0))
    frames = frames_of(SimulatedBoat(vessel, settings), 6.0)
    pushed = [
        m.time_usec * 1e-6
        for m in messages_named(frames, "SERVO_OUTPUT_RAW")
        if m.servo1_raw > 1500
    ]
    moving = [
        m.time_boot_ms * 1e-3
        for m in messages_named(frames, "LOCAL_POSITION_NED")
        if np.hypot(m.vx, m.vy)
    ]
    assert pushed[0] == pytest.approx(32.0, abs=0.1)
    assert moving[0] == pytest.approx(32.6, abs=0.1)


def test_a_ground_station_beside_is_no_boat():
    frames = frames_of(simulated_boat(station=True), 10.0)
    beats = [m for m in messages_named(frames, "HEARTBEAT") if m.get_srcSystem() == 255]
    assert len(beats) == 11
    assert [found.system for found in log_of(frames).boats()] == [1]


def test_signed_frames_verify_and_only_with_the_key():
    frames = frames_of(simulated_boat(signing_key=bytes(range(32))), 2.0)
    for key, good in ((bytes(range(32)), True), (bytes(32), False)):
        parser = mavlink.MAVLink(None)
        parser.signing.secret_key, parser.robust_parsing = key, True
        kinds = {parser.parse_buffer(f.data)[0].get_type() for f in frames}
        assert ("HEARTBEAT" in kinds) == good
        assert ("BAD_DATA" in kinds) != good


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"system_id": 0}, "system id"),
        ({"rates": {"ATITUDE": 4.0}}, "ATITUDE"),
        ({"rates": {"ATTITUDE": 0.0}}, "positive"),
        ({"loop_hz": 0.0}, "loop_hz"),
        ({"signing_key": b"short"}, "32 bytes"),
    ],
)
def test_wrong_settings_are_one_line(settings, text):
    with pytest.raises(BadInput, match=text):
        SimulatedBoatSettings(**settings)


def test_a_late_receiver_says_what_was_half_a_second_ago_also_in_a_hard_turn():
    """Heading and turn rate are in time; before its first words the boat lay where it began."""
    boat = load_vessel(ROOT / "configs" / "vessels" / "blueboat.toml")
    late = boat.with_effects(AddedEffect(named("velocity_latency"), {"delay": 0.5}))
    said = []
    for vessel in (boat, late):
        frames = frames_of(SimulatedBoat(vessel, SimulatedBoatSettings(rates=FAST), 3), 90.0)
        motion = messages_named(frames, "LOCAL_POSITION_NED")
        time = np.array([m.time_boot_ms for m in motion]) * 1e-3
        rows = np.array([(m.x, m.y, m.vx, m.vy) for m in motion])
        turns = [(m.yaw, m.yawspeed) for m in messages_named(frames, "ATTITUDE")]
        said.append((time, rows, np.array(turns)))
    (time, now, turns), (_, then, same) = said
    np.testing.assert_array_equal(turns, same)
    assert np.abs(turns[:, 1]).max() > 1.5
    inside = time > time[0] + 1.0
    shifted = np.stack([np.interp(time - 0.5, time, column) for column in now.T], axis=1)
    off = (then - shifted)[inside]
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 0.1
    assert np.sqrt(np.mean(off[:, 2:] ** 2)) < 0.05
    assert np.sqrt(np.mean((then - now)[inside][:, 2:] ** 2)) > 0.3
