"""Opens a recording as what its content says it is."""

from pathlib import Path

from gateway.errors import BadInput
from gateway.ingest.dataflash.log import DataflashLog
from gateway.ingest.files import DATAFLASH_MAGIC, MCAP_MAGIC, SAMPLE, is_text, read_bytes
from gateway.ingest.log import Log
from gateway.ingest.mavlink.tlog import TlogFile

KINDS = "a .tlog, a DataFlash .BIN, an MCAP recording or a .csv table"
FMT_RECORD = DATAFLASH_MAGIC + b"\x80"  # behind junk, this is how a DataFlash log begins


def open_log(path: str | Path, mapping: str | Path | None = None) -> Log:
    """Any recording that can be read; `mapping` says what the columns of a .csv mean."""
    raw = read_bytes(path)
    if raw.startswith(MCAP_MAGIC):
        # only where one is opened: the other kinds need not load the mcap library
        from gateway.ingest.mcap.log import McapLog

        return McapLog.open(path)
    if raw.startswith(DATAFLASH_MAGIC) or FMT_RECORD in raw[:SAMPLE]:
        return DataflashLog.from_bytes(raw, str(path))
    if is_text(raw):
        return _open_text(path, mapping)
    return TlogFile.from_bytes(raw, str(path))


def _open_text(path: str | Path, mapping: str | Path | None) -> Log:
    if Path(path).suffix.lower() == ".csv":
        from gateway.ingest.csv.log import CsvLog

        return CsvLog.open(path, mapping)
    raise BadInput(f"{path} is a text file: a recording is {KINDS}")
