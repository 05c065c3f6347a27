"""`shadow export`: a log in a form that other programs open, and that every command reads back.

tlog     the frames of the log, byte for byte
mcap     the frames and topics of a recording; of any other log the frames, or the log itself
         enclosed, and its smoothed motion as the topic `measured`, which players show
csv      the aligned trial, with the mapping file that reads it back; or chosen messages
parquet  the same, its mapping inside
"""

import io
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.ingest import read_bytes
from gateway.ingest.csv.log import read_mapping
from gateway.ingest.log import Log
from gateway.ingest.mavlink.frames import ids_by_name
from gateway.ingest.mcap import MAGIC
from gateway.ingest.open import open_log
from gateway.offline.export_messages import (
    chosen_frames,
    copied_recording,
    frames_of,
    names_in,
    packed_log,
    tlog_bytes,
)
from gateway.offline.export_table import (
    Columns,
    aligned_trials,
    check_channels,
    csv_bytes,
    mapping_text,
    message_table,
    not_in,
    parquet_bytes,
)
from gateway.offline.trials import TrialOptions
from gateway.recording.reader import Recording
from sim.near_names import did_you_mean


class ExportFormat(StrEnum):
    """What a log can become."""

    CSV = "csv"
    PARQUET = "parquet"
    TLOG = "tlog"
    MCAP = "mcap"


TABLES = (ExportFormat.CSV, ExportFormat.PARQUET)


@dataclass(frozen=True)
class ExportOptions:
    """What is chosen of a log.

    topics    names of messages or of topics of a recording; none: all, or the aligned trial
    channels  servo outputs of the aligned trial, from 1; none: all that have pulses
    rate_hz   rows a second of a table; of frames and topics, the most of each kind a second
    """

    format: ExportFormat
    topics: tuple[str, ...] = ()
    channels: tuple[int, ...] = ()
    rate_hz: float | None = None
    system: int | None = None
    mapping: Path | None = None
    anyway: bool = False

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not 0.001 <= self.rate_hz <= 1000.0:
            raise BadInput(f"--rate {self.rate_hz:g}: expected 0.001 to 1000 (Hz)")
        check_channels(self.channels)
        if self.channels and (self.format not in TABLES or self.topics):
            raise BadInput(
                "--channel chooses servo outputs of the aligned trial: with --to csv or parquet, "
                "without --topic"
            )

    @property
    def aligned(self) -> bool:
        """Is it the aligned trial that is wanted?"""
        return self.format in TABLES and not self.topics


@dataclass(frozen=True)
class Exported:
    """What was written: rows of a table, frames, or messages of a recording."""

    log: str
    files: tuple[Path, ...]
    count: int
    unit: str
    columns: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "log": self.log,
            "files": [str(file) for file in self.files],
            self.unit: self.count,
            "columns": list(self.columns),
            "notes": list(self.notes),
        }


def export_files(log: Path, out: Path | None, options: ExportOptions) -> tuple[Path, ...]:
    """The files that an export writes: the table or log first, then its mapping."""
    file = out or Path("shadow-out") / f"{log.stem}-export.{options.format}"
    if options.aligned and options.format is ExportFormat.CSV:
        return file, file.with_suffix(".toml")
    return (file,)


def stale_mapping(files: Sequence[Path], options: ExportOptions) -> tuple[Path, ...]:
    """The mapping beside a .csv that will hold another table: it would be read by it. What is no
    mapping, a vessel file say, stays.
    """
    beside = files[0].with_suffix(".toml")
    is_other = options.format is ExportFormat.CSV and not options.aligned
    return (beside,) if is_other and beside.exists() and _is_mapping(beside) else ()


def _is_mapping(file: Path) -> bool:
    with suppress(BadInput):
        read_mapping(file)
        return True
    return False


def without(stale: Sequence[Path], done: Exported) -> Exported:
    """What was written, after mappings of what was there before are removed."""
    for file in stale:
        file.unlink(missing_ok=True)
    removed = tuple(f"{file} is removed: it was another table's mapping" for file in stale)
    return replace(done, notes=(*done.notes, *removed))


def export(path: Path, files: Sequence[Path], options: ExportOptions) -> Exported:
    """Write a log in another form; BadInput where it does not hold what is asked for."""
    content, exported = _WRITERS[options.format](path, options)
    for file, one in zip(files, content, strict=True):
        write_whole(file, one, "the export")
    count, unit, columns, notes = exported
    return Exported(str(path), tuple(files), count, unit, columns, notes)


_Made = tuple[list[bytes], tuple[int, str, tuple[str, ...], tuple[str, ...]]]


def _tlog(path: Path, options: ExportOptions) -> _Made:
    frames = frames_of(open_log(path, options.mapping))
    present = names_in(frames)
    for name in options.topics:
        if name not in present:
            raise not_in(path, name, present)
    chosen = chosen_frames(frames, options.topics, options.rate_hz, options.system)
    if not len(chosen):
        raise BadInput(f"{path}: no frame of system {options.system} in it")
    return [tlog_bytes(chosen)], (len(chosen), "frames", (), ())


def _mcap(path: Path, options: ExportOptions) -> _Made:
    sink = io.BytesIO()
    if recording := _recording(path):
        count = copied_recording(recording, sink, options.topics, options.rate_hz, options.system)
        return [sink.getvalue()], (count, "messages", (), ())
    log = open_log(path, options.mapping)
    unknown = [name for name in options.topics if name not in ids_by_name()]
    if unknown:
        known = [*log.counts(), *ids_by_name()]  # those in the log first: they are meant
        meant = did_you_mean(unknown[0], known).rstrip()
        text = f"{path}: {unknown[0]} is no MAVLink message"
        raise BadInput(f"{text}: {meant}" if meant else text)
    count, notes = packed_log(
        log, sink, options.topics, options.rate_hz, options.system, options.mapping, options.anyway
    )
    return [sink.getvalue()], (count, "messages", (), notes)


def _table(path: Path, options: ExportOptions) -> tuple[Columns, str | None]:
    """The table, and the mapping that reads it back where it is the aligned trial."""
    if options.aligned:
        trials = TrialOptions(
            rate_hz=options.rate_hz or TrialOptions().rate_hz,
            system=options.system,
            anyway=options.anyway,
        )
        table = aligned_trials(open_log(path, options.mapping), trials, options.channels)
        return table, mapping_text(table)
    recording = _recording(path)
    log: Log | None = None
    try:
        log = open_log(path, options.mapping)
    except BadInput:
        if recording is None:
            raise  # a recording may hold topics alone
    args = options.topics, options.rate_hz, options.system
    return message_table(log, recording, str(path), *args), None


def _csv(path: Path, options: ExportOptions) -> _Made:
    table, mapping = _table(path, options)
    content = [csv_bytes(table)] + ([] if mapping is None else [mapping.encode()])
    return content, _told(table)


def _parquet(path: Path, options: ExportOptions) -> _Made:
    table, mapping = _table(path, options)
    return [parquet_bytes(table, mapping)], _told(table)


def _told(table: Columns) -> tuple[int, str, tuple[str, ...], tuple[str, ...]]:
    return len(np.atleast_1d(table["time"])), "rows", tuple(table), ()


def _recording(path: Path) -> Recording | None:
    """The gateway's recording, where the file is an MCAP."""
    return Recording.open(path) if read_bytes(path).startswith(MAGIC) else None


_WRITERS: dict[ExportFormat, Callable[[Path, ExportOptions], _Made]] = {
    ExportFormat.CSV: _csv,
    ExportFormat.PARQUET: _parquet,
    ExportFormat.TLOG: _tlog,
    ExportFormat.MCAP: _mcap,
}
