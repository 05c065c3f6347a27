"""What `shadow info` shows."""

import json
from pathlib import Path

import numpy as np
import pytest

from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from tests.gateway.ingest.scripted import Script, attitude, heartbeat, local_position, servo


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


def test_survey_is_plain_json() -> None:
    plain = survey(thin_telemetry().log()).to_dict()
    assert json.loads(json.dumps(plain))["boats"][0]["boat"]["system"] == 1
    assert plain["messages"]["SERVO_OUTPUT_RAW"]["count"] == 60
    assert plain["messages"]["SERVO_OUTPUT_RAW"]["rate_hz"] == pytest.approx(2.0)
    assert plain["boats"][0]["sources"]["velocity"]["source"] == "LOCAL_POSITION_NED"
    assert "VFR_HUD" in plain["boats"][0]["sources"]["velocity"]["preference"]


def test_every_odd_log_is_surveyed(shared_data: Path) -> None:
    for path in sorted((shared_data / "odd-logs").glob("*.[tbB]*")):
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
