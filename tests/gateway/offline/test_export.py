"""`shadow export`: frames byte for byte, the aligned trial as a table, and both read back."""

import csv
import io
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.ingest.open import open_log
from gateway.offline import export as exporting
from gateway.offline.export import Exported, ExportFormat, ExportOptions, export_files
from gateway.offline.export_messages import thinned
from gateway.offline.trials import load_trials
from gateway.recording.reader import Recording
from gateway.vessel_file import dump_vessel
from tests.gateway.command_line import Run, one_line, strictly
from tests.gateway.pipelines.sailing import frames, parameters, tlog, voyage
from tests.sim.vessels import WAMV

HERE = Path(__file__).resolve().parents[3] / "recordings" / "voyage_1.tlog"
TABLES = (ExportFormat.CSV, ExportFormat.PARQUET)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sailed") / "voyage.tlog"
    return tlog(path, [*parameters(), *voyage(40.0)])


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    path = tmp_path / "boat.toml"
    path.write_text(dump_vessel(WAMV), encoding="utf-8")
    return path


def export(log: Path, to: str, out: Path, **chosen: object) -> Exported:
    options = ExportOptions(ExportFormat(to), **chosen)  # type: ignore[arg-type]
    return exporting.export(log, export_files(log, out, options), options)


def test_a_log_through_a_recording_comes_out_byte_for_byte(log: Path, tmp_path: Path) -> None:
    recorded, again = tmp_path / "a.mcap", tmp_path / "a.tlog"
    export(log, "mcap", recorded)
    export(recorded, "tlog", again)
    assert again.read_bytes() == log.read_bytes()
    export(recorded, "mcap", tmp_path / "b.mcap")
    export(tmp_path / "b.mcap", "tlog", tmp_path / "b.tlog")
    assert (tmp_path / "b.tlog").read_bytes() == log.read_bytes()


def test_chosen_messages_at_a_rate_are_frames_of_the_log(log: Path, tmp_path: Path) -> None:
    done = export(log, "tlog", tmp_path / "a.tlog", topics=("ATTITUDE",), rate_hz=2.0)
    found, whole = open_log(tmp_path / "a.tlog"), open_log(log)
    assert dict(found.counts()) == {"ATTITUDE": done.count}
    times = found.table("ATTITUDE").receive_time_ns
    assert np.all(np.diff(times // 500_000_000) >= 1)
    assert set(times) <= set(whole.table("ATTITUDE").receive_time_ns)
    seconds = (times[-1] - times[0]) * 1e-9
    assert len(times) == pytest.approx(2.0 * seconds, abs=2)


def test_thinning_counts_each_key_by_itself() -> None:
    keys = np.array([[1], [2], [1], [2], [1]])
    time = np.array([0, 1, 2, 1_000_000_000, 3])
    assert thinned(keys, time, 1.0).tolist() == [0, 1, 3]


@pytest.mark.parametrize("to", TABLES)
def test_the_aligned_trial_is_the_trial_and_reads_back_as_one(
    log: Path, tmp_path: Path, to: ExportFormat
) -> None:
    export(log, to, tmp_path / f"a.{to}")
    trial, back = load_trials(log)[0], load_trials(tmp_path / f"a.{to}")[0]
    read = pandas.read_csv if to is ExportFormat.CSV else pandas.read_parquet
    table = read(tmp_path / f"a.{to}")
    assert len(table) == len(trial)
    for k, name in enumerate(("u", "v", "r")):
        assert np.allclose(table[name], trial.nu[:, k], atol=1e-8)
        assert float(np.sqrt(np.mean((back.nu[5:-5, k] - trial.nu[5:-5, k]) ** 2))) < 0.02
    assert back.channels == trial.channels
    both = np.isfinite(back.pwm) & np.isfinite(trial.pwm)
    assert both.mean() > 0.9 * np.isfinite(trial.pwm).mean()
    assert np.max(np.abs(back.pwm - trial.pwm)[both]) < 1.0
    assert table["time"][0] == pytest.approx(trial.start_time_ns * 1e-9, abs=1e-5)


def test_nothing_is_written_where_nothing_was_measured(log: Path, tmp_path: Path) -> None:
    export(log, "csv", tmp_path / "a.csv")
    export(log, "parquet", tmp_path / "a.parquet")
    row = next(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    table = pyarrow.parquet.read_table(tmp_path / "a.parquet")
    wind = load_trials(log)[0].wind[:, 0]
    assert np.isnan(wind[0])
    assert row["wind_north"] == "NaN"
    assert table["wind_north"].null_count == np.isnan(wind).sum()


def test_columns_of_numbers_look_like_numbers_from_their_first_row(
    log: Path, tmp_path: Path
) -> None:
    """Polars takes the type of a column from its first rows: no integers, no empty cells."""
    export(log, "csv", tmp_path / "a.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "a.csv").read_text())))
    cells = [cell for row in rows for name, cell in row.items()
             if name not in ("trial", "armed", "usable")]  # fmt: skip
    assert all("." in cell or "e" in cell or cell == "NaN" for cell in cells)
    assert "NaN" in cells


def test_rate_and_channels_are_those_asked_for(log: Path, tmp_path: Path) -> None:
    channel = load_trials(log)[0].channels[-1]
    export(log, "csv", tmp_path / "a.csv", rate_hz=5.0, channels=(channel,))
    table = pandas.read_csv(tmp_path / "a.csv")
    assert np.allclose(np.diff(table["time"]), 0.2, atol=1e-5)
    assert [name for name in table if name.startswith("pwm_")] == [f"pwm_{channel}"]
    with pytest.raises(BadInput, match="no pulses on channel 31; channels with some: "):
        export(log, "csv", tmp_path / "b.csv", channels=(31,))


def test_one_message_comes_as_it_came_and_several_on_one_grid(log: Path, tmp_path: Path) -> None:
    export(log, "csv", tmp_path / "a.csv", topics=("ATTITUDE",))
    table, held = pandas.read_csv(tmp_path / "a.csv"), open_log(log).table("ATTITUDE")
    assert len(table) == len(held)
    assert np.allclose(table["yaw"], held.columns["yaw"], atol=1e-6)
    export(log, "csv", tmp_path / "b.csv", topics=("ATTITUDE", "HEARTBEAT"), rate_hz=4.0)
    grid = pandas.read_csv(tmp_path / "b.csv")
    assert np.allclose(np.diff(grid["time"]), 0.25, atol=1e-5)
    assert {"ATTITUDE.yaw", "HEARTBEAT.type"} <= set(grid)
    place = np.searchsorted(held.receive_time_ns * 1e-9, grid["time"][20] + 1e-5, side="right") - 1
    assert grid["ATTITUDE.yaw"][20] == pytest.approx(held.columns["yaw"][place], abs=1e-6)


def test_of_one_boat_the_radios_reports_are_read_too_but_none_of_another_boat(
    tmp_path: Path,
) -> None:
    """A radio has an id of its own: 51."""
    said = [(t, dialect.MAVLink_radio_status_message(*[9] * 7)) for t in np.arange(0.0, 9.0, 0.5)]
    wind = [(t, dialect.MAVLink_wind_message(90.0, 3.0, 0.0)) for t in np.arange(0.0, 9.0, 0.5)]
    both = [*frames(voyage(9.0)), *frames([*voyage(9.0), *wind], 2), *frames(said, 51)]
    log = tmp_path / "two.tlog"
    log.write_bytes(b"".join(sorted(both, key=lambda frame: frame[:8])))
    export(log, "csv", tmp_path / "a.csv", topics=("RADIO_STATUS",), system=1)
    assert len(pandas.read_csv(tmp_path / "a.csv")) == len(said)
    with pytest.raises(BadInput, match="no WIND of system 1 in it"):
        export(log, "csv", tmp_path / "b.csv", topics=("WIND",), system=1)


def test_a_message_that_fell_silent_is_not_held_on(log: Path, tmp_path: Path) -> None:
    export(log, "tlog", tmp_path / "part.tlog", topics=("ATTITUDE", "HEARTBEAT"))
    raw, frames = (tmp_path / "part.tlog").read_bytes(), open_log(tmp_path / "part.tlog")
    last = frames.table("ATTITUDE").receive_time_ns[-1]
    silent = last - 10_000_000_000
    kept = b"".join(
        raw[start - 8 : start + length]
        for start, length, time, number in zip(
            frames.frames.headers.offset, frames.frames.headers.length,  # type: ignore[attr-defined]
            frames.frames.receive_time_ns, frames.frames.headers.message_id,  # type: ignore[attr-defined]
            strict=True,
        )
        if number == 0 or time < silent
    )  # fmt: skip
    (tmp_path / "gap.tlog").write_bytes(kept)
    export(tmp_path / "gap.tlog", "csv", tmp_path / "a.csv", topics=("ATTITUDE", "HEARTBEAT"))
    grid = pandas.read_csv(tmp_path / "a.csv")
    assert grid["ATTITUDE.yaw"].isna().to_numpy()[-30:].all()
    assert grid["ATTITUDE.yaw"].notna().to_numpy()[:-120].all()


def test_topics_of_a_recording_are_copied_and_thinned(
    run: Run, log: Path, boat: Path, tmp_path: Path
) -> None:
    assert (
        run("replay", log, "-v", boat, "--no-publish", "--out", tmp_path, "--topics", "all").status
        == 0
    )
    recorded = tmp_path / "voyage-shadow.mcap"
    export(recorded, "mcap", tmp_path / "a.mcap", topics=("residual", "HEARTBEAT"), rate_hz=1.0)
    found, whole = Recording.open(tmp_path / "a.mcap"), Recording.open(recorded)
    counts = found.counts()
    assert set(counts) == {"residual", "mavlink/raw"}
    assert 28 <= counts["residual"] <= 42
    assert whole.counts()["residual"] > 400
    assert found.attachments["vessel.toml"] == whole.attachments["vessel.toml"]
    assert set(open_log(tmp_path / "a.mcap").counts()) == {"HEARTBEAT"}
    export(recorded, "parquet", tmp_path / "shadow.parquet", topics=("shadow",))
    table = pandas.read_parquet(tmp_path / "shadow.parquet")
    assert np.array_equal(table["surge_mps"], whole.columns("shadow")["surge_mps"])


def test_a_table_packed_for_players_reads_back(log: Path, tmp_path: Path) -> None:
    export(log, "csv", tmp_path / "a.csv")
    export(tmp_path / "a.csv", "mcap", tmp_path / "a.mcap")
    recording = Recording.open(tmp_path / "a.mcap")
    trial, back = load_trials(tmp_path / "a.csv")[0], load_trials(tmp_path / "a.mcap")[0]
    assert np.array_equal(trial.nu, back.nu)
    assert np.allclose(recording.columns("measured")["surge_mps"], trial.nu[:, 0])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--to", "xlsx"], "--to xlsx: expected csv, parquet, tlog, mcap"),
        (["--to", "csv", "--rate", "0"], "--rate 0: expected 0.001 to 1000 (Hz)"),
        (["--to", "csv", "--rate", "500"], "rate 500.0 Hz: expected 0.5 to 200"),
        (["--to", "csv", "--channel", "33"], "--channel 33: expected 1 to 32"),
        (["--to", "tlog", "--channel", "1"], "--channel chooses servo outputs"),
        (["--to", "csv", "--topic", "ATTITUD"], "ATTITUD in it: did you mean ATTITUDE?"),
        (["--to", "tlog", "--topic", "ATTITUD"], "ATTITUD in it: did you mean ATTITUDE?"),
        (["--to", "mcap", "--topic", "ATTITUD"], "no MAVLink message: did you mean ATTITUDE?"),
        (["--to", "tlog", "--system", "9"], "no frame of system 9"),
    ],
)
def test_what_cannot_be_exported_is_one_line(
    run: Run, log: Path, tmp_path: Path, words: list[str], says: str
) -> None:
    one_line(run("export", log, *words, "--out", tmp_path / "x"), 2, says)
    assert not (tmp_path / "x").exists()


def test_messages_leave_no_mapping_of_the_table_that_was_there(
    run: Run, log: Path, tmp_path: Path
) -> None:
    table, mapping = tmp_path / "t.csv", tmp_path / "t.toml"
    assert run("export", log, "--to", "csv", "--out", table).status == 0
    words = ["export", log, "--to", "csv", "--topic", "ATTITUDE", "--out", table]
    told = " ".join(run(*words).out.split())
    assert f"note: {mapping} is removed: it was another table's mapping" in told.replace("- ", "-")
    assert not mapping.exists()
    assert "is removed" not in run(*words).out
    mine = '[time]\ncolumn = "t"\nunit = "s"\n[columns]\nyaw = { column = "psi", unit = "rad" }\n'
    mapping.write_text(mine)
    before = table.read_bytes()
    one_line(run(*words), 2, f"{mapping}: is there already", "--force")
    assert (mapping.read_text(), table.read_bytes()) == (mine, before)


def test_a_vessel_file_beside_a_table_is_no_mapping_and_stays(
    run: Run, log: Path, tmp_path: Path, boat: Path
) -> None:
    vessel = tmp_path / "boat.toml"
    text = boat.read_text()
    vessel.write_text(text)
    words = ["--to", "csv", "--topic", "ATTITUDE", "--out", tmp_path / "boat.csv", "--force"]
    done = run("export", log, *words)
    assert done.status == 0
    assert "removed" not in done.out
    assert vessel.read_text() == text


def test_a_table_has_no_frames(run: Run, log: Path, tmp_path: Path) -> None:
    export(log, "csv", tmp_path / "a.csv")
    done = run("export", tmp_path / "a.csv", "--to", "tlog", "--out", tmp_path / "x")
    one_line(done, 2, "a csv log holds no MAVLink frames: export it with --to csv")
    done = run("export", tmp_path / "a.csv", "--to", "mcap", "--rate", "1")
    one_line(done, 2, "a csv log goes whole into an MCAP")


def test_without_pyarrow_it_is_said(
    run: Run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = run("export", log, "--to", "parquet", "--out", tmp_path / "x")
    one_line(done, 2, "pip install 'shadow-gateway[tables]', or use --to csv")


def test_json_names_what_was_written(run: Run, log: Path, tmp_path: Path) -> None:
    done = run("export", log, "--to", "csv", "--out", tmp_path / "a.csv", "--json")
    told = strictly(done.out)
    assert told["files"] == [str(tmp_path / "a.csv"), str(tmp_path / "a.toml")]
    assert told["rows"] == len(pandas.read_csv(tmp_path / "a.csv"))
    assert told["columns"] == list(pandas.read_csv(tmp_path / "a.csv"))


def test_a_parquet_table_that_holds_no_numbers_or_is_damaged_is_one_line(
    run: Run, log: Path, tmp_path: Path
) -> None:
    export(log, "parquet", tmp_path / "a.parquet")
    raw = (tmp_path / "a.parquet").read_bytes()
    (tmp_path / "cut.parquet").write_bytes(raw[: len(raw) // 2])
    one_line(run("info", tmp_path / "cut.parquet"), 2, "not a Parquet table that can be read")
    table = pyarrow.parquet.read_table(tmp_path / "a.parquet")
    words = table.set_column(
        table.schema.get_field_index("u"), "u", pyarrow.array(["fast"] * len(table))
    )
    pyarrow.parquet.write_table(words, tmp_path / "w.parquet")
    one_line(run("info", tmp_path / "w.parquet"), 2, "column 'u' holds string, no numbers")
    less = table.drop_columns(["r"])
    pyarrow.parquet.write_table(less, tmp_path / "l.parquet")
    one_line(run("info", tmp_path / "l.parquet"), 2, "no column 'r', which")
    pyarrow.parquet.write_table(table.append_column("r", table["r"]), tmp_path / "t.parquet")
    one_line(run("info", tmp_path / "t.parquet"), 2, "2 columns are called 'r', which")


def test_a_parquet_bomb_is_refused(run: Run, log: Path, tmp_path: Path) -> None:
    export(log, "parquet", tmp_path / "a.parquet")
    inside = pyarrow.parquet.read_schema(tmp_path / "a.parquet").metadata
    names = pyarrow.parquet.read_schema(tmp_path / "a.parquet").names
    zeros = pyarrow.nulls(1_000_000, pyarrow.float64())
    bomb = pyarrow.table(dict.fromkeys(names, zeros)).replace_schema_metadata(inside)
    pyarrow.parquet.write_table(bomb, tmp_path / "bomb.parquet", compression="zstd")
    one_line(run("info", tmp_path / "bomb.parquet"), 2, "(MAX_EXPANSION)")
