"""What happened in a log: arming, modes, texts, events of the shadow, in order of time."""

import json
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.log import Log, boats_of
from gateway.ingest.log_events import LogEvent, happenings, log_events
from gateway.ingest.mcap.log import enclosure_of_file
from gateway.ingest.open import open_log
from gateway.ingest.parameter_changes import outputs_notice
from gateway.json_rows import TopicRows, encode
from gateway.recording.recorder import Recorder
from tests.conftest import ROOT
from tests.gateway.command_line import Run
from tests.gateway.ingest import made_table
from tests.gateway.ingest.dataflash_writer import voyage_log
from tests.gateway.ingest.scripted import Script
from tests.gateway.ingest.ulog_writer import TOPICS, UlogWriter, as_ulog
from tests.gateway.offline.test_replay import TABLE_COLUMNS

START_NS = 1_700_000_000_000_000_000
PIECE = ROOT / "recordings" / "otter_piece.tlog"


def beat(armed: bool, mode: int = 0) -> dialect.MAVLink_message:
    return dialect.MAVLink_heartbeat_message(11, 3, 1 + 128 * armed, mode, 4, 3)


GROUND = dialect.MAVLink_heartbeat_message(6, 8, 0, 4, 4, 3)


def said(text: str, severity: int = 6, number: int = 0, piece: int = 0) -> dialect.MAVLink_message:
    return dialect.MAVLink_statustext_message(severity, text.encode(), number, piece)


def recording(path: Path) -> Path:
    """A boat that is armed, changes its mode, says a long thing; a station talks."""
    boat, station = (dialect.MAVLink(None, srcSystem=s, srcComponent=1) for s in (1, 255))
    script = [
        (0.0, boat, beat(False)), (1.0, boat, beat(True)), (2.0, boat, beat(True)),
        (3.0, boat, beat(True, 10)), (3.5, station, GROUND),
        (4.0, boat, said("x" * 50, 3, 7, 0)), (4.1, boat, said("and more", 3, 7, 1)),
        (4.2, station, said("not the boat's")), (5.0, boat, beat(False, 10)),
    ]  # fmt: skip
    times = [START_NS + round(at * 1e9) for at, _, _ in script]
    with Recorder(path, free=lambda _: 10**12) as recorder:
        recorder.write_raw([message.pack(mav) for _, mav, message in script], times)
        recorder.write_rows(gone(START_NS + 2_500_000_000))
    return path


def gone(time_ns: int) -> TopicRows:
    """An event of the shadow."""
    at = np.array([time_ns])
    event = {"kind": "test", "severity": "warning", "says": "gone", "vehicle_time_ns": time_ns}
    payload = encode("event", event | {"receive_time_ns": time_ns})
    return TopicRows("event", at, at, [payload or b""])


def test_all_that_happened_is_told_once_and_in_order(tmp_path: Path) -> None:
    log = open_log(recording(tmp_path / "a.mcap"))
    (boat,) = boats_of(log)
    assert log_events(log, boat) == [
        LogEvent(0.0, "autopilot", "info", "disarmed"),
        LogEvent(0.0, "autopilot", "info", "mode manual"),
        LogEvent(1.0, "autopilot", "info", "armed"),
        LogEvent(2.5, "shadow", "warning", "gone"),
        LogEvent(3.0, "autopilot", "info", "mode auto"),
        LogEvent(4.0, "autopilot", "error", "x" * 50 + "and more"),
        LogEvent(5.0, "autopilot", "info", "disarmed"),
    ]


def written_log(kind: str, folder: Path) -> Path:
    """A log of a format that a recording encloses, not one of frames."""
    if kind == ".csv":
        return made_table.written(folder, made_table.Traps(), 20.0)[0]
    content = voyage_log(2025, 20.0) if kind == ".BIN" else as_ulog(PIECE).bytes()
    log = folder / f"voyage{kind}"
    log.write_bytes(content)
    return log


@pytest.mark.parametrize("kind", [".csv", ".BIN", ".ulg"])
def test_what_the_shadow_said_of_an_enclosed_log_is_told_too(tmp_path: Path, kind: str) -> None:
    plain = written_log(kind, tmp_path)
    mapping = plain.with_suffix(".toml") if kind == ".csv" else None
    log = open_log(plain)
    (boat,) = boats_of(log)
    first = min(int(log.table(name).receive_time_ns.min()) for name in log.counts())
    attachments = enclosure_of_file(plain, mapping)
    held = tmp_path / "held.mcap"
    with Recorder(held, attachments=attachments, free=lambda _: 10**12) as recorder:
        recorder.write_rows(gone(first + 2_500_000_000))
    told = log_events(open_log(held), boat)
    assert LogEvent(2.5, "shadow", "warning", "gone") in told
    assert [one for one in told if one.by != "shadow"] == log_events(log, boat)


def test_a_table_tells_when_the_boat_was_armed(tmp_path: Path) -> None:
    table, mapping = tmp_path / "a.csv", tmp_path / "a.toml"
    rows = [f"{0.1 * k:.1f},0,1,0,{int(10 <= k < 20)}" for k in range(30)]
    table.write_text("\n".join(["t,yaw,u,v,on", *rows]))
    mapping.write_text(TABLE_COLUMNS + 'armed = { column = "on", unit = "1" }\n')
    log = open_log(table)
    (boat,) = boats_of(log)
    assert [(one.time_s, one.text) for one in log_events(log, boat)] == [
        (0.0, "disarmed"), (1.0, "armed"), (2.0, "disarmed"),
    ]  # fmt: skip


def test_a_ulog_tells_arming_and_modes_those_without_a_name_by_number(tmp_path: Path) -> None:
    written, path = as_ulog(PIECE), tmp_path / "a.ulg"
    written.add("vehicle_status", max(t for t, _ in written.rows) + 1, 1, 11, 99)
    path.write_bytes(written.bytes())
    log = open_log(path)
    (boat,) = boats_of(log)
    texts = [one.text for one in log_events(log, boat)]
    assert texts == ["armed", "mode mission", "disarmed", "mode 99"]


def test_the_modes_of_px4_have_their_names_in_mavlink_too() -> None:
    """The numbers that its firmware sent in position, mission, hold, return and manual mode."""
    script = Script()
    for k, mode in enumerate((0x30000, 0x4040000, 0x3040000, 0x5040000, 0x10000, 0x630000)):
        script.send(float(k), dialect.MAVLink_heartbeat_message(11, 12, 1, mode, 4, 3))
    log = script.log()
    (boat,) = boats_of(log)
    texts = [one.text for one in log_events(log, boat)]
    named = ["position", "mission", "hold", "return", "manual", "99"]
    assert texts == ["disarmed", *(f"mode {name}" for name in named)]


def test_the_modes_of_ardupilot_have_their_names_and_one_without_its_number() -> None:
    script = Script()
    for k, mode in enumerate((0, 4, 4, 15, 99)):
        script.send(float(k), beat(False, mode))
    log = script.log()
    (boat,) = boats_of(log)
    texts = [one.text for one in log_events(log, boat)]
    assert texts == ["disarmed", "mode manual", "mode hold", "mode guided", "mode 99"]


def px4_log(writer: UlogWriter, folder: Path) -> Log:
    """With a row at each end, so that seconds count from the first second of its clock."""
    writer.add("battery_status", 1_000_000, 12.0)
    writer.add("battery_status", 100_000_000, 12.0)
    path = folder / "a.ulg"
    path.write_bytes(writer.bytes())
    return open_log(path)


def test_a_ulog_tells_what_the_autopilot_said(tmp_path: Path) -> None:
    writer = UlogWriter(topics={**TOPICS, "event": "uint32_t id;uint8_t log_levels"})
    writer.said(31_000_000, 4, "Failsafe activated")
    writer.said(41_000_000, 6, "Waypoint 3 reached", tag=7)
    writer.add("event", 51_000_000, 1234, 0x63)
    writer.add("event", 52_000_000, 1235, 0x68)  # for protocols alone
    log = px4_log(writer, tmp_path)
    (boat,) = boats_of(log)
    told = [(round(one.time_s, 6), one.severity, one.text) for one in log_events(log, boat)]
    assert told == [
        (30.0, "warning", "Failsafe activated"),
        (40.0, "info", "Waypoint 3 reached"),
        (50.0, "error", "event 1234 of PX4 (its text is in the firmware's metadata)"),
    ]
    assert [(one.text, one.bad) for one in happenings(log, boat).events] == [
        ("Failsafe activated", True), ("Waypoint 3 reached", False),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "before", "after", "told"),
    [
        ("PWM_MAIN_REV", 0, 1, "PWM_MAIN_REV changes from 0 to 1"),
        ("PWM_MAIN_REV", None, 1, "PWM_MAIN_REV becomes 1"),
        ("PWM_AUX_FUNC2", 101, 102, "PWM_AUX_FUNC2 changes from 101 to 102"),
        ("UAVCAN_EC_MAX1", 8191, 4000, "UAVCAN_EC_MAX1 changes from 8191 to 4000"),
        ("PWM_MAIN_MIN1", 1000, 1010, "PWM_MAIN_MIN1 changes from 1000 to 1010"),
        ("CA_R_REV", 0, 3, "CA_R_REV changes from 0 to 3"),
        ("MAV_SYS_ID", 1, 2, None),
        ("PWM_MAIN_REV", 1, 1, None),
    ],
)
def test_a_ulog_tells_which_outputs_are_set_otherwise(
    tmp_path: Path, name: str, before: int | None, after: int, told: str | None
) -> None:
    writer = UlogWriter()
    if before is not None:
        writer.parameter(name, before)
    writer.changed_parameter(61_000_000, name, after)
    for k in range(2, 99):
        writer.add("battery_status", 1_000_000 * k - 1, 12.0)
    log = px4_log(writer, tmp_path)
    (boat,) = boats_of(log)
    texts = [(round(one.time_s), one.text) for one in log_events(log, boat)]
    assert texts == ([(60, told)] if told else [])
    matters = told is not None and name != "PWM_MAIN_MIN1"  # by ten microseconds
    assert [text.startswith(f"{told} at 60 s") for text in outputs_notice(log, boat)] == (
        [True] if matters else []
    )
    assert log.parameters(boat)[name] == after


def test_the_command_prints_them_and_json_holds_them(run: Run) -> None:
    done = run("info", PIECE, "--events")
    assert "Barometer 1 calibration complete" in done.out
    assert "armed" in done.out
    found = json.loads(run("info", PIECE, "--events", "--json").out)
    ((boat, events),) = found["events"].items()
    assert boat.startswith("system 1")
    assert "Barometer 1 calibration complete" in [event["text"] for event in events]
    assert "events" not in json.loads(run("info", PIECE, "--json").out)
