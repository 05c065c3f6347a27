"""What `shadow info` shows."""

import json
from pathlib import Path

import numpy as np
import pytest

from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from tests.conftest import ROOT
from tests.gateway.ingest.scripted import Script, attitude, heartbeat, local_position, servo
from tests.gateway.pipelines.sailing import frames, voyage


def thin_telemetry() -> Script:
    script = Script()
    for t in np.arange(0.0, 30.0, 0.5):
        script.send(t, attitude(100.0 + t))
        script.send(t, local_position(100.0 + t))
        script.send(t, servo(100.0 + t, 1500, 1500))
        if t % 1.0 == 0.0:
            script.send(t, heartbeat())
    return script


def test_thin_commands_are_told_with_what_cannot_be_learnt() -> None:
    (boat,) = survey(thin_telemetry().log()).boats
    assert any("commands at 2.0 Hz: thruster lag" in line for line in boat.good_for)
    assert any("velocity at 2.0 Hz" in line for line in boat.good_for)


def test_commands_that_a_diagnosis_takes_for_five_a_second_are_fast_enough() -> None:
    """Each a little late: 4.9 Hz were "at 4.9 Hz: … cannot be told (5 Hz needed)"."""
    script = Script()
    for t in np.arange(0.0, 60.0, 1.0 / 4.9):
        script.send(t, attitude(100.0 + t))
        script.send(t, local_position(100.0 + t))
        script.send(t, servo(100.0 + t, 1500, 1500))
        script.send(t, heartbeat())
    (boat,) = survey(script.log()).boats
    assert not any(" Hz: " in line for line in boat.good_for)


def test_survey_is_plain_json() -> None:
    plain = survey(thin_telemetry().log()).to_dict()
    assert json.loads(json.dumps(plain))["boats"][0]["boat"]["system"] == 1
    assert plain["messages"]["SERVO_OUTPUT_RAW"]["count"] == 60
    assert plain["messages"]["SERVO_OUTPUT_RAW"]["rate_hz"] == pytest.approx(2.0)
    assert plain["boats"][0]["sources"]["velocity"]["source"] == "LOCAL_POSITION_NED"
    assert "VFR_HUD" in plain["boats"][0]["sources"]["velocity"]["preference"]


def test_a_leap_of_the_receivers_clock_is_no_gap_of_a_message() -> None:
    script = thin_telemetry()
    for t in np.arange(30.0, 60.0, 0.5):
        script.send(t + 40 * 86_400.0, servo(100.0 + t, 1500, 1500))
    found = survey(script.log()).messages["SERVO_OUTPUT_RAW"]
    assert found.count == 120
    assert found.rate_hz == pytest.approx(2.0)
    assert found.longest_gap_s == pytest.approx(0.5)


def test_every_odd_log_is_surveyed(shared_data: Path) -> None:
    paths = sorted((shared_data / "odd-logs").glob("*.[tbB]*"))
    assert paths
    for path in paths:
        found = survey(open_log(path))
        assert found.boats, path
        assert json.dumps(found.to_dict()), path


def test_three_sessions_are_three_boots(shared_data: Path) -> None:
    log = open_log(shared_data / "odd-logs" / "three-sessions-zero-holes-clock-back.tlog")
    (boat,) = survey(log).boats
    assert boat.clock.reboots == 2
    assert [round(seconds) for seconds in boat.sessions_s] == [524, 488, 138]
    assert boat.sources["velocity"].source == "GLOBAL_POSITION_INT"
    assert "LOCAL_POSITION_NED covers" in boat.sources["velocity"].why


@pytest.mark.parametrize("first", ["otter_piece", "voyage_1"])
def test_the_time_of_two_voyages_in_one_file_is_the_sum_of_both(tmp_path: Path, first) -> None:
    """They lie 512 days apart, and which is the later one is nothing to the sum."""
    logs = [ROOT / "recordings" / f"{name}.tlog" for name in ("otter_piece", "voyage_1")]
    logs.sort(key=lambda log: log.stem != first)
    both = tmp_path / "both.tlog"
    both.write_bytes(b"".join(log.read_bytes() for log in logs))
    found, alone = survey(open_log(both)), [survey(open_log(log)) for log in logs]
    (boat,) = found.boats
    assert boat.seconds == pytest.approx(sum(one.boats[0].seconds for one in alone), abs=2.0)
    assert sum(boat.sessions_s) == boat.seconds
    assert found.seconds <= sum(one.seconds for one in alone)


def test_otter_is_told_as_it_is(shared_data: Path) -> None:
    for name, firmware in (
        ("otter_calm.tlog", "ArduRover V4.6.3"),
        ("otter_calm.BIN", "ArduRover"),
    ):
        (boat,) = survey(open_log(shared_data / "sitl" / name)).boats
        assert boat.firmware.startswith(firmware)
        assert [(a.channel, a.kind.value) for a in boat.actuators] == [
            (1, "throttle left"),
            (3, "throttle right"),
        ]
        assert all(source.source[:3] != "SIM" for source in boat.sources.values())


def table(folder: Path, rows: list[str]) -> Path:
    """A table of heading, speed, acceleration and two throttles, in seconds."""
    path = folder / "run.csv"
    path.write_text("t,yaw,r,u,v,a,lat,lon,left,right\n" + "\n".join(rows) + "\n")
    columns = {
        "yaw": ("yaw", "deg"), "yaw_rate": ("r", "rad/s"), "surge": ("u", "m/s"),
        "sway": ("v", "m/s"), "surge_acceleration": ("a", "m/s2"),
        "sway_acceleration": ("a", "m/s2"), "latitude": ("lat", "deg"),
        "longitude": ("lon", "deg"), "channel_1": ("left", "us"), "channel_3": ("right", "us"),
    }  # fmt: skip
    lines = [f'{name} = {{ column = "{c}", unit = "{u}" }}' for name, (c, u) in columns.items()]
    time = 'time = { column = "t", unit = "s" }'
    path.with_suffix(".toml").write_text("\n".join([time, "[columns]", *lines]) + "\n")
    return path


CONSTANT = [f"{0.1 * k:.1f},90,0,1,0,0,63.4,10.3,1600,1600" for k in range(300)]
BACKWARDS = [*CONSTANT[:150], *CONSTANT[:150]]
NOISE = np.random.default_rng(1).normal(0.0, 1e3, (300, 9))
NOISE[:, 5:7] *= 0.03  # places that there are: others are refused


@pytest.mark.parametrize(
    "rows",
    [
        CONSTANT,
        CONSTANT[:2],
        BACKWARDS,
        [f"{0.1 * k:.1f},,,,,,,,," for k in range(50)],
        [f"{0.1 * k:.1f},nan,inf,nan,-inf,nan,nan,nan,nan,inf" for k in range(50)],
        [f"{0.1 * k:.1f}," + ",".join(f"{x:.3f}" for x in row) for k, row in enumerate(NOISE)],
        ["1e300,90,0,1,0,0,63.4,10.3,1600,1600", *CONSTANT],
        [f"0.{k % 2},90,0,1,0,0,63.4,10.3,1600,1600" for k in range(100)],
        [*CONSTANT, "8.9e9,90,0,1,0,0,63.4,10.3,1600,1600"],
    ],
    ids=["constant", "two", "backwards", "empty", "nan", "noise", "1e300", "twice", "years"],
)
def test_tables_of_any_values_end_in_an_answer(tmp_path: Path, rows: list[str]) -> None:
    found = survey(open_log(table(tmp_path, rows)))
    assert json.dumps(found.to_dict())


def test_halves_in_the_wrong_order_are_no_longer_than_the_whole(tmp_path: Path) -> None:
    """Until the clock is sure of the new boot, a heartbeat lies at the receiver's own time."""
    sent = frames(voyage(120.0))
    files = tmp_path / "right.tlog", tmp_path / "swapped.tlog"
    half = len(sent) // 2
    for file, parts in zip(files, (sent, sent[half:] + sent[:half]), strict=True):
        file.write_bytes(b"".join(parts))
    right, swapped = (survey(open_log(file)).boats[0] for file in files)
    assert len(swapped.sessions_s) == 2
    assert swapped.seconds == pytest.approx(right.seconds, abs=3.0)
