"""The feed knows at each moment what had been received by then, and nothing of what came later."""

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.ingest.log import Boat
from gateway.ingest.open import open_log
from gateway.live.intake import MessageIntake
from gateway.offline.replay import replay_input_of
from gateway.shadow import BLIND_S, SILENCE_S, TICK_S, FilterInputs
from tests.gateway.ingest.scripted import Script, attitude, heartbeat, local_position, servo
from tests.gateway.pipelines.sailing import Said, tlog, voyage


def filter_inputs_of(script: Script, folder: Path) -> FilterInputs:
    path = folder / "scripted.tlog"
    path.write_bytes(bytes(script.raw))
    return replay_input_of(open_log(path)).feed


def moving(script: Script, start: float, end: float) -> None:
    """Motion told at 10 Hz."""
    for t in np.arange(start, end - 1e-9, 0.1):
        script.send(t, attitude(100.0 + t))
        script.send(t, local_position(100.0 + t))


def test_a_fact_knows_the_latest_command_received_before_it(tmp_path: Path) -> None:
    script = Script()
    script.send(0.0, heartbeat())
    moving(script, 0.0, 1.0)
    script.send(1.0, servo(101.0, 1700))
    moving(script, 1.0, 2.0)
    script.send(2.0, servo(102.0, 1300))
    moving(script, 2.0, 3.0)
    feed = filter_inputs_of(script, tmp_path)
    first = feed.pulses[:, 0]
    assert np.isnan(first[feed.events.time_s < 0.99]).all()
    assert (first[(feed.events.time_s > 0.99) & (feed.events.time_s < 1.99)] == 1700.0).all()
    assert (first[feed.events.time_s > 1.99] == 1300.0).all()


def test_wild_values_of_a_log_are_passed_over_as_those_of_a_live_link_are(tmp_path: Path) -> None:
    script = Script()
    script.send(0.0, heartbeat())
    script.send(0.0, dialect.MAVLink_gps_global_origin_message(634470000, 104000000, 0))
    for t, wind_mps, cell_mv in ((0.0, 5.0, 12600), (1.0, 1e30, 0), (2.0, 150.0, 65535)):
        script.send(t, dialect.MAVLink_wind_message(180.0, wind_mps, 0.0))
        cells = [cell_mv, *[65535] * 9]
        script.send(t, dialect.MAVLink_battery_status_message(0, 0, 0, 0, cells, 0, 0, 0, 0))
        moving(script, t, t + 1.0)
    script.send(2.9, dialect.MAVLink_gps_global_origin_message(2**31 - 1, 0, 0))
    feed = filter_inputs_of(script, tmp_path)
    intake = MessageIntake(Boat(1, 1), FilterSettings())
    parts = [intake.take(message, at) for at, message in script.sent]
    live = FilterInputs.joined([part for part in parts if part is not None])
    assert len(live) == len(feed) > 100
    assert feed.wind[:, 0] == pytest.approx(5.0)
    assert np.array_equal(feed.wind, live.wind)
    assert np.array_equal(feed.voltage, live.voltage)
    given = replay_input_of(open_log(tmp_path / "scripted.tlog"))
    assert given.origin == intake.origin == pytest.approx((63.447, 10.4))


def test_a_place_that_is_none_on_earth_is_no_origin_of_a_log(tmp_path: Path) -> None:
    script = Script()
    script.send(0.0, heartbeat())
    for k in range(50):
        t, lat, lon = 0.1 * k, *((2**31 - 1, 0) if k % 20 == 0 else (634470000 + k, 104000000))
        script.send(t, attitude(100.0 + t))
        place = dialect.MAVLink_global_position_int_message
        script.send(t, place(round(1e3 * (100.0 + t)), lat, lon, 0, 0, 100, 0, 0, 0))
    feed = filter_inputs_of(script, tmp_path)
    z = feed.events.z[feed.events.kind == MeasurementKind.POSITION]
    assert len(z) == 47
    assert np.abs(z).max() < 1.0


def test_no_pulses_while_disarmed(tmp_path: Path) -> None:
    script = Script()
    for start, armed in ((0.0, False), (2.0, True), (4.0, False)):
        script.send(start, heartbeat(armed))
        script.send(start, servo(100.0 + start, 1700))
        moving(script, start, start + 2.0)
    feed = filter_inputs_of(script, tmp_path)
    armed = (feed.events.time_s > 1.99) & (feed.events.time_s < 3.99)
    assert (feed.pulses[armed, 0] == 1700.0).all()
    assert np.isnan(feed.pulses[~armed, 0]).all()


def test_what_comes_later_changes_nothing_before(tmp_path: Path) -> None:
    said = voyage(8.0)
    whole = replay_input_of(open_log(tlog(tmp_path / "whole.tlog", said))).feed
    cut = replay_input_of(open_log(tlog(tmp_path / "cut.tlog", said[: len(said) // 2]))).feed
    same = slice(0, len(cut))
    assert 100 < len(cut) < len(whole)
    assert whole.events.z[same] == pytest.approx(cut.events.z, abs=0.0)
    assert np.array_equal(whole.pulses[same], cut.pulses, equal_nan=True)
    assert np.array_equal(whole.order[same], cut.order)


def silence(script: Script, seconds: float) -> None:
    """Motion, then none while the commands go on, then motion again."""
    script.send(0.0, heartbeat())
    moving(script, 0.0, 1.0)
    for t in np.arange(1.0, 1.0 + seconds, 0.2):
        script.send(t, servo(100.0 + t, 1500 + round(100 * t)))
    moving(script, 1.0 + seconds, 2.0 + seconds)


def test_ticks_bridge_a_silence_and_know_the_commands_that_came_meanwhile(tmp_path: Path) -> None:
    script = Script()
    silence(script, 3.0)
    feed = filter_inputs_of(script, tmp_path)
    ticks = feed.events.kind == MeasurementKind.TICK
    times, pulses = feed.events.time_s[ticks], feed.pulses[ticks, 0]
    assert times[0] == pytest.approx(0.9 + SILENCE_S)
    assert np.diff(times) == pytest.approx(TICK_S)
    assert times[-1] == pytest.approx(3.9, abs=TICK_S)
    latest = 1500.0 + 100.0 * (1.0 + 0.2 * np.floor((times - 1.0 + 1e-6) / 0.2))
    assert pulses == pytest.approx(latest)
    assert (np.diff(feed.order) >= 0).all()
    assert feed.complete[ticks].all()


def test_ticks_end_where_it_makes_no_sense_to_run_on(tmp_path: Path) -> None:
    script = Script()
    silence(script, 100.0)
    times = (feed := filter_inputs_of(script, tmp_path)).events.time_s[
        feed.events.kind == MeasurementKind.TICK
    ]
    assert times[-1] == pytest.approx(0.9 + BLIND_S, abs=2.0 * TICK_S)


def test_the_last_fact_of_each_message_completes_it(tmp_path: Path) -> None:
    script = Script()
    moving(script, 0.0, 1.0)
    feed = filter_inputs_of(script, tmp_path)
    assert feed.complete.sum() == 20
    assert (
        feed.events.kind[feed.complete].tolist()
        == [MeasurementKind.YAW_RATE, MeasurementKind.POSITION] * 10
    )


def test_the_order_is_the_place_of_the_frame_in_the_log(tmp_path: Path) -> None:
    said: list[Said] = voyage(3.0)
    feed = replay_input_of(open_log(tlog(tmp_path / "a.tlog", said))).feed
    motion = ("ATTITUDE", "LOCAL_POSITION_NED")
    places = [k for k, (_, message) in enumerate(said) if message.get_type() in motion]
    assert np.unique(feed.order).tolist() == places
    assert (np.diff(feed.receive_time_ns) >= 0).all()
