"""Recordings of the BlueOS recorder, as its public source writes them, are logs."""

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from gateway.errors import BadInput
from gateway.ingest.log import choose_boat
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.mcap.log import _flags, _frame
from gateway.ingest.open import open_log
from gateway.offline.trials import load_trials
from gateway.vessel_file import dump_vessel
from tests.gateway.command_line import Run, one_line
from tests.gateway.ingest.blueos_writer import write_blueos
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV


@pytest.fixture(scope="module")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> MavlinkLog:
    path = tmp_path_factory.mktemp("blueos") / "voyage.tlog"
    log = open_log(tlog(path, [*voyage(30.0), *parameters()]))
    assert isinstance(log, MavlinkLog)
    return log


@pytest.mark.parametrize("flags", ["names", "bits"])
def test_every_field_of_every_message_comes_back(
    sailed: MavlinkLog, tmp_path: Path, flags: str
) -> None:
    found = open_log(write_blueos(tmp_path / "recorder.mcap", sailed, flags))
    assert isinstance(found, MavlinkLog)
    assert found.kind == "mcap of BlueOS"
    for name in found.counts():
        mine, theirs = found.table(name), sailed.table(name)
        assert len(theirs) - len(mine) in (0, 1)  # what came before the boat was seen armed
        recorded = slice(len(theirs) - len(mine), None)
        assert np.array_equal(mine.receive_time_ns, theirs.receive_time_ns[recorded])
        for field, values in mine.columns.items():
            np.testing.assert_array_equal(values, theirs.columns[field][recorded])
    assert set(found.counts()) >= {"HEARTBEAT", "ATTITUDE", "SERVO_OUTPUT_RAW", "PARAM_VALUE"}
    boat = choose_boat(found)
    assert boat.type == choose_boat(sailed).type
    assert found.parameters(boat) == sailed.parameters(boat)


def test_the_commands_take_it(run: Run, sailed: MavlinkLog, tmp_path: Path) -> None:
    path, boat = write_blueos(tmp_path / "recorder.mcap", sailed), tmp_path / "boat.toml"
    boat.write_text(dump_vessel(WAMV), encoding="utf-8")
    done = run("info", path)
    assert done.status == 0
    assert "recorded as JSON (BlueOS)" in done.out
    assert "cannot be read" not in done.out
    mine, theirs = load_trials(path)[0], load_trials(sailed.path)[0]
    assert mine.channels == theirs.channels
    assert len(mine) == pytest.approx(len(theirs), abs=12)
    assert run("compare", path, "-v", boat).status == 0
    assert run("replay", path, "-v", boat, "--no-publish", "--out", tmp_path / "o").status == 0
    assert run("export", path, "--to", "tlog", "--out", tmp_path / "a.tlog").status == 0
    assert open_log(tmp_path / "a.tlog").counts() == open_log(path).counts()


def test_a_recording_that_was_cut_off_is_read_to_its_end(
    sailed: MavlinkLog, tmp_path: Path
) -> None:
    found = open_log(write_blueos(tmp_path / "recorder.mcap", sailed, cut=True))
    assert (
        "the recording was not finished: `shadow repair` makes it whole" in found.statistics.notes
    )
    assert found.counts()["ATTITUDE"] > 500


def test_what_cannot_be_read_is_counted(run: Run, sailed: MavlinkLog, tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    good = b'{"header":{"sequence":1},"message":{"type":"ATTITUDE","time_boot_ms":5,"yaw":NaN}}'
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("mavlink/1/1/ATTITUDE", "json", 0)
        for k, data in enumerate([good, b"[]", b"{", b'{"header":{}}', b"\xff" * 9, b"[" * 9000]):
            writer.add_message(channel, k, data, k)
        writer.finish()
    found = open_log(path)
    assert found.counts() == {"ATTITUDE": 1}
    assert np.isnan(found.table("ATTITUDE").columns["yaw"][0])
    assert "5 message(s) cannot be read: they are left out" in found.statistics.notes


def test_a_recording_without_one_readable_message_is_one_line(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_message(writer.register_channel("mavlink/1/1/ATTITUDE", "json", 0), 1, b"{}", 1)
        writer.finish()
    one_line(run("info", path), 2, "none of its MAVLink messages can be read")
    with pytest.raises(BadInput):
        open_log(path)


def test_flags_are_names_or_numbers() -> None:
    text = "MAV_MODE_FLAG_SAFETY_ARMED | MAV_MODE_FLAG_CUSTOM_MODE_ENABLED"
    assert _flags(text, "MAV_MODE_FLAG") == 129
    assert _flags("MAV_MODE_FLAG_SAFETY_ARMED | 0x4", "MAV_MODE_FLAG") == 132
    assert _flags("", "MAV_MODE_FLAG") == 0
    with pytest.raises(KeyError):
        _flags("NOBODY_KNOWS", "MAV_MODE_FLAG")


def test_a_number_that_the_field_cannot_hold_is_refused() -> None:
    payload = b'{"header":{},"message":{"type":"ATTITUDE","time_boot_ms":-1}}'
    with pytest.raises(Exception, match=r"format|range"):
        _frame("ATTITUDE", 1, 1, payload)
