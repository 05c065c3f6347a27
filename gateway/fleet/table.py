"""The table of a fleet: two Parquet files, one row a recording and one a number with its interval.

`RECORDINGS` and `ESTIMATES` are the schema, which docs/fleet.md lists; the metadata of both files
holds `shadow.fleet.schema`, which rises whenever a column changes its meaning or goes.
"""

import io
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from gateway.errors import BadInput
from gateway.files import write_whole

SCHEMA_VERSION = 2
VERSION_KEY = b"shadow.fleet.schema"
RECORDINGS_FILE, ESTIMATES_FILE = "recordings.parquet", "estimates.parquet"

TEXT, NUMBER, COUNT = pa.string(), pa.float64(), pa.int64()
TEXTS, TIME, TRUTH = pa.list_(pa.string()), pa.timestamp("us", "UTC"), pa.bool_()


class Column(NamedTuple):
    """One column: type and meaning; a column without a value in a row is null there."""

    type: Any
    meaning: str


RECORDINGS: Mapping[str, Column] = {
    "recording": Column(TEXT, "path or URL"),
    "sha256": Column(TEXT, "of its content; empty where it could not be read"),
    "boat": Column(TEXT, "name in the fleet file; null where no entry names the recording"),
    "vessel_file": Column(TEXT, "what it was held against"),
    "state": Column(TEXT, "done, partly, failed, fault (tried again on the next run), duplicate"),
    "why": Column(TEXT, "why it is not done, one sentence"),
    "format": Column(TEXT, "kind of recording"),
    "started": Column(
        TIME,
        "first sample, by the boat's clock where the recording's is days off; none without a date",
    ),
    "seconds": Column(NUMBER, "length of its stretches"),
    "usable_s": Column(NUMBER, "of these armed, under way, with motion and commands"),
    "stretches": Column(COUNT, "pieces between boots and long silences"),
    "excluded": Column(TEXT, "what excluded how much"),
    "latitude_deg": Column(NUMBER, "of the origin of its first stretch"),
    "longitude_deg": Column(NUMBER, "of the same"),
    "distance_m": Column(NUMBER, "over ground, in usable time"),
    "top_speed_mps": Column(NUMBER, "over ground, in usable time"),
    "good_for": Column(TEXTS, "what it can and cannot tell, as in `shadow info`"),
    "notices": Column(TEXTS, "what was wrong with it and was repaired"),
    "nrmse": Column(NUMBER, "error of free predictions, as in `shadow compare`"),
    "noise_floor_nrmse": Column(NUMBER, "what noise alone would leave of it"),
    "rmse_surge_mps": Column(NUMBER, "of the same predictions"),
    "rmse_sway_mps": Column(NUMBER, "of the same"),
    "rmse_yaw_rate_radps": Column(NUMBER, "of the same"),
    "not_identifiable": Column(TEXTS, "channels whose numbers hold nowhere else"),
    "verdict": Column(TEXT, "of the diagnosis"),
    "effects": Column(TEXTS, "that it found missing"),
    "diagnosis": Column(TEXT, "its sentence"),
    "heldout_nrmse_before": Column(NUMBER, "error on time that no fit has seen, vessel as given"),
    "heldout_nrmse_after": Column(NUMBER, "the same of the vessel that the diagnosis made"),
    "seconds_of_work": Column(NUMBER, "that the worker took"),
    "peak_memory_mb": Column(NUMBER, "the most that the worker had held until then"),
    "analysed": Column(TIME, "when the work ended"),
    "version": Column(TEXT, "of the program"),
}
ESTIMATES: Mapping[str, Column] = {
    "recording": Column(TEXT, "as in the other file"),
    "sha256": Column(TEXT, "as in the other file"),
    "boat": Column(TEXT, "as in the other file"),
    "started": Column(TIME, "as in the other file"),
    "kind": Column(TEXT, "parameter of the vessel, or effect: a number of an effect found missing"),
    "origin": Column(TEXT, "identify or diagnose"),
    "effect": Column(TEXT, "name of the effect; null for parameters"),
    "name": Column(TEXT, "name of the number, as in the vessel file (left.ahead)"),
    "value": Column(NUMBER, "the estimate"),
    "low": Column(NUMBER, "lower end of its 95 % interval"),
    "high": Column(NUMBER, "upper end"),
    "unit": Column(TEXT, "of the three"),
    "before": Column(NUMBER, "what the vessel file has"),
    "identifiable": Column(TRUTH, "whether the recording tells it"),
    "stretch": Column(TEXT, "where it belongs to one stretch of the recording"),
    "doubt": Column(TEXT, "why not to trust it; empty where there is no reason"),
}
FILES = {RECORDINGS_FILE: RECORDINGS, ESTIMATES_FILE: ESTIMATES}


def write_table(
    folder: Path, recordings: Iterable[Mapping[str, Any]], estimates: Iterable[Mapping[str, Any]]
) -> None:
    """Write both files, each whole or not at all."""
    for (name, columns), rows in zip(FILES.items(), (recordings, estimates), strict=True):
        write_whole(folder / name, _parquet(columns, rows), "the fleet's table")


def _parquet(columns: Mapping[str, Column], rows: Iterable[Mapping[str, Any]]) -> bytes:
    """Rows as a Parquet file; times are ISO texts in them."""
    schema = pa.schema(
        [(name, column.type) for name, column in columns.items()],
        metadata={VERSION_KEY: str(SCHEMA_VERSION)},
    )
    times = {name for name, column in columns.items() if column.type == TIME}
    made = [
        {
            name: datetime.fromisoformat(row[name]) if name in times and row.get(name) else
            row.get(name)
            for name in columns
        }
        for row in rows
    ]  # fmt: skip
    out = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(made, schema), out, compression="zstd")
    return out.getvalue()


def read_estimates(folder: str | Path) -> list[dict[str, Any]]:
    """Rows of estimates.parquet; BadInput where there is none, or of another version."""
    return _read(Path(folder) / ESTIMATES_FILE)


def read_recordings(folder: str | Path) -> list[dict[str, Any]]:
    """Rows of recordings.parquet; BadInput where there is none, or of another version."""
    return _read(Path(folder) / RECORDINGS_FILE)


def recordings_of_table(folder: Path) -> set[str]:
    """Names of the recordings in a table of any version; none where there is no table."""
    try:
        column = pq.read_table(folder / RECORDINGS_FILE, columns=["recording"])["recording"]
    except (OSError, KeyError, pa.ArrowInvalid):
        return set()
    return set(column.to_pylist())


def _read(file: Path) -> list[dict[str, Any]]:
    if not file.is_file():
        raise BadInput(f"{file}: there is no such table: shadow fleet writes it")
    try:
        table = pq.read_table(file)
    except (pa.ArrowException, OSError) as error:
        raise BadInput(f"{file}: not a table of shadow fleet: {error}") from None
    version = (table.schema.metadata or {}).get(VERSION_KEY, b"none").decode()
    if version != str(SCHEMA_VERSION):
        raise BadInput(
            f"{file}: has schema version {version}, this program reads {SCHEMA_VERSION}: run "
            "shadow fleet again"
        )
    rows: list[dict[str, Any]] = table.to_pylist()
    return rows
