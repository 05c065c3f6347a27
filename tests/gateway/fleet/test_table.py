"""The table: its schema is documented and versioned, and other programs open it."""

import re
from datetime import UTC, datetime
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gateway.errors import BadInput
from gateway.fleet.table import (
    ESTIMATES_FILE,
    FILES,
    RECORDINGS_FILE,
    VERSION_KEY,
    read_recordings,
    write_table,
)
from tests.conftest import ROOT

WHEN = "2026-05-12T08:00:00+00:00"
ROW = {"recording": "a.tlog", "boat": "heron", "state": "done", "started": WHEN,
       "usable_s": 600.0, "good_for": ["all"], "nrmse": 0.2}  # fmt: skip
NUMBER = {"recording": "a.tlog", "boat": "heron", "name": "left.ahead", "value": 90.0,
          "low": 88.0, "high": 92.0, "started": WHEN, "identifiable": True}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_table(tmp_path, [ROW, {"recording": "b.tlog", "state": "failed"}], [NUMBER])
    return tmp_path


def test_both_files_hold_every_column_and_the_version(folder):
    for name, columns in FILES.items():
        schema = pq.read_schema(folder / name)
        assert schema.names == list(columns)
        assert schema.metadata[VERSION_KEY] == b"2"


def test_every_column_is_documented_with_its_meaning():
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    for columns in FILES.values():
        for name, column in columns.items():
            assert f"| `{name}` | {column.type} | {column.meaning} |" in page


def test_pandas_polars_and_duckdb_open_it(folder):
    numbers = pd.read_parquet(folder / ESTIMATES_FILE)
    assert numbers.loc[numbers.name == "left.ahead", "value"].tolist() == [90.0]
    assert numbers.started[0] == datetime(2026, 5, 12, 8, tzinfo=UTC)
    good = pl.read_parquet(folder / RECORDINGS_FILE).filter(pl.col("state") == "done")
    assert good["good_for"].to_list() == [["all"]]
    query = f"SELECT r.nrmse, e.value FROM '{folder / RECORDINGS_FILE}' r JOIN "
    query += f"'{folder / ESTIMATES_FILE}' e USING (recording) WHERE r.state = 'done'"
    assert duckdb.sql(query).fetchall() == [(0.2, 90.0)]


@pytest.mark.parametrize("library", ["pandas", "polars", "duckdb"])
def test_what_the_page_shows_runs_as_it_stands(folder, library, monkeypatch, capsys):
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    (code,) = (c for c in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if library in c)
    (folder / "shadow-out").mkdir()
    (folder / "shadow-out" / "fleet").symlink_to(folder, target_is_directory=True)
    monkeypatch.chdir(folder)
    exec(compile(code, "docs/fleet.md", "exec"), {})
    assert "heron" in capsys.readouterr().out


def test_a_table_of_another_version_or_none_is_refused(folder, tmp_path):
    with pytest.raises(BadInput, match="there is no such table"):
        read_recordings(tmp_path / "nowhere")
    table = pq.read_table(folder / RECORDINGS_FILE)
    pq.write_table(table.replace_schema_metadata({VERSION_KEY: b"7"}), folder / RECORDINGS_FILE)
    with pytest.raises(BadInput, match="schema version 7"):
        read_recordings(folder)
    (folder / RECORDINGS_FILE).write_bytes(b"no table")
    with pytest.raises(BadInput, match="not a table"):
        read_recordings(folder)
    assert pa.__version__
