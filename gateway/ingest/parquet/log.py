"""Tables as Parquet, as `shadow export --to parquet` writes them.

A mapping names the columns, the same as that of a .csv: the one given, the one inside the file, or
the one beside it.
"""

import io
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.csv.log import CsvLog, CsvMapping, beside, check_names, read_mapping
from gateway.ingest.log import Log
from gateway.recording.blocks import ALWAYS_UNPACKED, MAX_EXPANSION
from sim.state import Floats

MAPPING_KEY = b"shadow.mapping"


def pyarrow() -> tuple[Any, Any]:
    """The modules pyarrow and pyarrow.parquet; BadInput where they are not installed."""
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise BadInput(
            "Parquet needs pyarrow, which is not installed: pip install 'shadow-gateway[tables]', "
            "or use --to csv"
        ) from None
    return arrow, parquet


def parquet_log(path: str, raw: bytes, mapping: str | Path | None) -> Log:
    """The columns that the mapping names; BadInput where one is missing or holds no numbers."""
    arrow, parquet = pyarrow()
    file = Path(path)
    try:
        opened = parquet.ParquetFile(io.BytesIO(raw))
        plan = _plan(file, opened.schema_arrow.metadata or {}, mapping)
        wanted = list(plan.names())
        check_names(file, plan, opened.schema_arrow.names)
        _check_size(file, opened, len(wanted), len(raw))
        table = opened.read(columns=wanted)
        values = {name: _numbers(file, name, table.column(name), arrow) for name in wanted}
    except (arrow.ArrowException, OSError) as error:
        reason = " ".join(str(error).split())[:100]
        raise BadInput(f"{path}: not a Parquet table that can be read: {reason}") from None
    return replace(CsvLog.from_columns(file, plan, values, len(raw)), kind="parquet")


def _plan(file: Path, inside: Any, mapping: str | Path | None) -> CsvMapping:
    if mapping is not None:
        return read_mapping(Path(mapping))
    if MAPPING_KEY not in inside:
        return read_mapping(beside(file))
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "mapping.toml"
        own.write_bytes(inside[MAPPING_KEY])
        return replace(read_mapping(own), path=str(file))


def _check_size(file: Path, opened: Any, columns: int, size: int) -> None:
    """BadInput where the columns unpack to more than a log has."""
    if opened.metadata.num_rows * 8 * columns > ALWAYS_UNPACKED + MAX_EXPANSION * size:
        raise BadInput(
            f"{file}: it unpacks to more than {MAX_EXPANSION} times its size (MAX_EXPANSION): "
            "no recording does"
        )


def _numbers(file: Path, name: str, column: Any, arrow: Any) -> Floats:
    """One column as numbers; NaN where it is empty."""
    kind = column.type
    if not (arrow.types.is_floating(kind) or arrow.types.is_integer(kind)
            or arrow.types.is_boolean(kind)):  # fmt: skip
        raise BadInput(f"{file}: column {name!r} holds {kind}, no numbers")
    if arrow.types.is_boolean(kind):
        column = column.cast(arrow.int8())
    return np.asarray(column.cast(arrow.float64(), safe=False).to_numpy(), np.float64)
