"""What the gateway writes it can read: recordings of logs without frames, and of simulations."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.mcap.log import enclosure
from gateway.ingest.open import open_log
from gateway.offline.replay import replay
from gateway.offline.simulate import simulate
from gateway.offline.trials import load_trials
from gateway.recording.recorder import Attachment, Recorder
from tests.gateway.offline.test_replay import TABLE_COLUMNS, dataflash, options
from tests.gateway.offline.test_simulate import table
from tests.sim.vessels import WAMV

TIMES = [10.0 + 0.1 * k for k in range(300)]


def logged(folder: Path, suffix: str) -> Path:
    """A log of thirty seconds."""
    path = folder / f"straight{suffix}"
    if suffix == ".csv":
        path.write_text("t,yaw,u,v\n" + "".join(f"{t},0,1,0\n" for t in TIMES))
        (folder / "mapping.toml").write_text(TABLE_COLUMNS)
    else:
        path.write_bytes(dataflash(TIMES))
    return path


@pytest.mark.parametrize("suffix", [".BIN", ".csv"])
def test_a_recording_of_a_replay_reads_as_its_log(tmp_path: Path, suffix: str) -> None:
    path = logged(tmp_path, suffix)
    log = open_log(path)
    (file,) = replay(path, WAMV, None, options(tmp_path / "out")).recordings
    (tmp_path / "mapping.toml").unlink(missing_ok=True)
    path.unlink()
    again = open_log(file)
    assert again.counts() == log.counts()
    before, after = (one.decode(one.boats()[0]).samples for one in (log, again))
    assert [s.source for s in after] == [s.source for s in before]
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        np.testing.assert_array_equal(a.vehicle_time_ns, b.vehicle_time_ns)
    (second,) = replay(file, WAMV, None, options(tmp_path / "again")).recordings
    assert open_log(second).counts() == log.counts()  # and so does a recording of the recording


def test_a_simulation_reads_as_a_log_that_its_vessel_explains(tmp_path: Path) -> None:
    result = simulate(table(tmp_path), WAMV, None, tmp_path / "out")
    (trial,) = load_trials(result.recording)
    assert trial.channels == WAMV.pulses(result.commands)[0]
    moved = np.interp(trial.time, result.time, result.motion[:, 3])
    assert trial.nu[:, 0] == pytest.approx(moved, abs=0.05)


@pytest.mark.parametrize(
    "packed", [b"", b"no zstandard", enclosure(b"x" * 300, "a.csv")[0].data[:-4]]
)
def test_a_damaged_enclosure_is_one_line(tmp_path: Path, packed: bytes) -> None:
    path = tmp_path / "damaged.mcap"
    with Recorder(path, attachments=[Attachment("log/a.csv.zst", "", packed)]):
        pass
    with pytest.raises(BadInput, match="the enclosed log is damaged"):
        open_log(path)


def test_an_enclosed_log_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mcap"
    with Recorder(path, attachments=enclosure(bytes(300_000_000), "a.BIN")):
        pass
    assert path.stat().st_size < 100_000
    with pytest.raises(BadInput, match="unpacks to more than a log has"):
        open_log(path)


def test_an_enclosed_file_of_no_known_format_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "text.mcap"
    with Recorder(path, attachments=enclosure(b"dear diary\n" * 99, "diary.txt")):
        pass
    with pytest.raises(BadInput, match=r"encloses diary\.txt, which is no log"):
        open_log(path)
