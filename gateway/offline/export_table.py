"""A log as one table: the aligned trials, or messages as they came or held on one grid.

    trial      one row per moment of the grid: smoothed motion, its errors, pulses, voltage, wind
    messages   the fields of one message, a row each; of several, or at a rate, on one grid

Times are Unix time [s], or seconds since the boot of a boat that does not know the day.
"""

import csv
import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.log import Log, boats_of, choose_boat, text
from gateway.ingest.parquet.log import MAPPING_KEY, pyarrow
from gateway.ingest.sources import GAP_S
from gateway.offline.trials import TrialOptions, trials_of
from gateway.recording.reader import Integers, Recording
from sim.near_names import did_you_mean
from sim.trial import MOTION_NAMES, Trial

Columns = dict[str, NDArray[Any]]  # name -> (K,)
MOST_ROWS = 20_000_000  # of a table of messages: a grid over a damaged time would never end
MOST_NAMED = 40  # messages of a log, where one that was asked for is not among them

# column of the table -> quantity of a mapping file (docs/csv.md), unit
READ_BACK = {
    "north": ("north", "m"), "east": ("east", "m"), "yaw": ("yaw", "rad"),
    "u": ("surge", "m/s"), "v": ("sway", "m/s"), "r": ("yaw_rate", "rad/s"),
    "voltage": ("voltage", "V"), "wind_north": ("wind_north", "m/s"),
    "wind_east": ("wind_east", "m/s"), "armed": ("armed", "1"),
}  # fmt: skip


def aligned_trials(log: Log, options: TrialOptions, channels: Sequence[int]) -> Columns:
    """All trials of a log, one below the other; BadInput where a channel has no pulses."""
    trials = trials_of(log, replace(options, motion_only=True))
    present = sorted({channel for trial in trials for channel in trial.channels})
    absent = [channel for channel in channels if channel not in present]
    if absent:
        have = ", ".join(map(str, present)) or "none"
        raise BadInput(f"{log.path}: no pulses on channel {absent[0]}; channels with some: {have}")
    wanted = tuple(channels) or tuple(present)
    return stacked([_trial_columns(trial, wanted) for trial in trials])


def _trial_columns(trial: Trial, channels: Sequence[int]) -> Columns:
    held = trial.columns()
    nothing = np.full(len(trial), np.nan)
    pulses = {f"pwm_{n}": held.pop(f"pwm_{n}", nothing) for n in channels}
    held = {name: column for name, column in held.items() if not name.startswith("pwm_")}
    seconds = held.pop("time")
    motion = {name: held.pop(name) for name in MOTION_NAMES}
    armed = np.isfinite(trial.pwm).any(axis=1)
    armed |= np.full(len(trial), not trial.channels)  # without commands nobody knows
    return {
        "time": trial.start_time_ns * 1e-9 + seconds,
        "trial": np.full(len(trial), trial.name),
        "elapsed": seconds,
        **motion,
        **pulses,
        "armed": armed,
        **held,
    }


def stacked(tables: Sequence[Columns]) -> Columns:
    """Tables of the same columns, one below the other."""
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def mapping_text(table: Columns) -> str:
    """The mapping file that reads an aligned trial back as a log."""
    columns = {name: entry for name, entry in READ_BACK.items() if name in table}
    columns |= {
        name: (f"channel_{name.removeprefix('pwm_')}", "us")
        for name in table
        if name.startswith("pwm_")
    }
    content = {
        "time": {"column": "time", "unit": "s"},
        "columns": {
            quantity: {"column": name, "unit": unit} for name, (quantity, unit) in columns.items()
        },
    }
    return tomli_w.dumps(content)


def message_table(
    log: Log | None,
    recording: Recording | None,
    path: str,
    names: Sequence[str],
    rate_hz: float | None,
    system: int | None,
) -> Columns:
    """Chosen messages: as they came where it is one and no rate is given, else held on a grid."""
    found: dict[str, tuple[Integers, Columns]] = {}
    for name in names:
        table = None if recording is None else topic_columns(recording, name)
        if table is None and log is not None:
            table = _messages(log, name, system)
        if table is None:
            raise not_in(path, name, _present(log, recording))
        found[name] = table
    if len(found) == 1 and rate_hz is None:
        time, columns = next(iter(found.values()))
        return {"time": time * 1e-9, **columns}
    return _on_grid(path, found, rate_hz or TrialOptions().rate_hz)


def topic_columns(recording: Recording, topic: str) -> tuple[Integers, Columns] | None:
    """Receipt [ns] and fields of a topic of a recording; None where it holds no rows of it."""
    times = (
        [rows.receive_time_ns for rows in recording.rows(topic)] if topic != "mavlink/raw" else []
    )
    if not times:
        return None
    columns = {
        name: values
        for name, values in recording.columns(topic).items()
        if values.dtype.kind in "bifuU"
    }
    return np.concatenate(times), {name: np.atleast_1d(v) for name, v in columns.items()}


def _messages(log: Log, name: str, system: int | None) -> tuple[Integers, Columns] | None:
    """Receipt [ns] and fields of the messages of one boat; if it sent none, of senders that are no
    boat: a radio or a ground station. None where the log has no such message at all.
    """
    table = log.table(name)
    if not len(table):
        return None
    rows, systems = np.ones(len(table), np.bool_), {boat.system for boat in boats_of(log)}
    if system is not None or len(systems) > 1:
        chosen = choose_boat(log, system).system
        rows = table.system == chosen
        if not rows.any():
            rows = ~np.isin(table.system, list(systems))
        if not rows.any():
            raise BadInput(f"{log.path}: no {name} of system {chosen} in it")
    columns: Columns = {}
    for field, values in table.columns.items():
        kept = values[rows]
        if kept.ndim == 1:
            columns[field] = _plain(kept)
        else:
            columns |= {f"{field}_{k}": _plain(kept[:, k]) for k in range(kept.shape[1])}
    return table.receive_time_ns[rows], columns


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    """Numbers as they are, text as str."""
    if values.dtype.kind in "bifu":
        return values
    return np.array([text(value) for value in values.tolist()], np.str_)


def _present(log: Log | None, recording: Recording | None) -> list[str]:
    topics = [] if recording is None else list(recording.counts())
    messages = [] if log is None else list(log.counts())
    return [*sorted(topics), *messages]


def not_in(path: str | Path, name: str, present: Sequence[str]) -> BadInput:
    """What is said of a message or topic that is not in a log, and of those that are."""
    there = ", ".join(present[:MOST_NAMED]) or "nothing"
    return BadInput(f"{path}: no {name} in it: {did_you_mean(name, present)}there are: {there}")


def _on_grid(path: str, tables: Mapping[str, tuple[Integers, Columns]], rate_hz: float) -> Columns:
    """Each message held until the next, on a common grid; nothing where it has fallen silent."""
    start = min(int(time.min()) for time, _ in tables.values())
    end = max(int(time.max()) for time, _ in tables.values())
    step = round(1e9 / rate_hz)
    if (end - start) // step > MOST_ROWS:
        raise BadInput(
            f"{path}: {(end - start) * 1e-9:.3g} s at {rate_hz:g} Hz are more than {MOST_ROWS:,} "
            "rows (MOST_ROWS): give a lower --rate"
        )
    grid = np.arange(start, end + 1, step, dtype=np.int64)
    out: Columns = {"time": grid * 1e-9}
    for name, (time, columns) in tables.items():
        order = np.argsort(time, kind="stable")
        sorted_time = time[order]
        place = np.searchsorted(sorted_time, grid, side="right") - 1
        usual = float(np.median(np.diff(sorted_time))) if len(time) > 1 else 0.0
        fresh = place >= 0
        fresh &= grid - sorted_time[np.maximum(place, 0)] <= max(GAP_S * 1e9, 3.0 * usual)
        rows = order[np.maximum(place, 0)]
        for field, values in columns.items():
            out[f"{name}.{field}"] = _where_fresh(values[rows], fresh)
    return out


def _where_fresh(values: NDArray[Any], fresh: NDArray[np.bool_]) -> NDArray[Any]:
    if values.dtype.kind == "U":
        return np.where(fresh, values, "")
    return np.where(fresh, values.astype(np.float64), np.nan)


def csv_bytes(table: Columns) -> bytes:
    """A table as CSV: one line of names; what is not known is NaN.

    Numbers keep a decimal point, and no cell is empty: readers that guess the type of a column from
    its first hundred rows (Polars) would take whole numbers for integers, empty cells for text.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(_cells(name, column) for name, column in table.items()), strict=True))
    return out.getvalue().encode()


def _cells(name: str, column: NDArray[Any]) -> list[str]:
    if column.dtype.kind == "b":
        return ["1" if value else "0" for value in column.tolist()]
    if column.dtype.kind == "f":
        return [_number(value, name == "time") for value in column.tolist()]
    return [str(value) for value in column.tolist()]


def _number(value: float, is_time: bool) -> str:
    """A number as text: times to the microsecond, the rest to nine digits."""
    if not np.isfinite(value):
        return "NaN"
    short = f"{value:.6f}" if is_time else f"{value:.9g}"
    return short if "." in short or "e" in short else short + ".0"


def parquet_bytes(table: Columns, mapping: str | None) -> bytes:
    """A table as Parquet; the mapping that reads it back travels in its metadata."""
    arrow, parquet = pyarrow()
    arrays = {
        name: arrow.array(column, from_pandas=column.dtype.kind == "f")
        for name, column in table.items()
    }
    made = arrow.table(arrays)
    if mapping is not None:
        made = made.replace_schema_metadata({MAPPING_KEY: mapping})
    sink = io.BytesIO()
    parquet.write_table(made, sink, compression="zstd")
    return sink.getvalue()


def check_channels(channels: Collection[int]) -> None:
    """BadInput where a channel cannot be one."""
    for channel in channels:
        if not 1 <= channel <= 32:
            raise BadInput(f"--channel {channel}: expected 1 to 32")
