"""Reading the bytes of a recording, and saying in a few words what bytes look like.

Opens a recording as what its content says it is.
"""

from pathlib import Path

from gateway.errors import BadInput
from gateway.ingest.dataflash.log import DataflashLog
from gateway.ingest.log import Log
from gateway.ingest.mavlink.tlog import TlogFile

MCAP_MAGIC = b"\x89MCAP0\r\n"
DATAFLASH_MAGIC = b"\xa3\x95"
SAMPLE = 4096  # bytes that are looked at
KNOWN = (
    (MCAP_MAGIC, "an MCAP recording"),
    (DATAFLASH_MAGIC, "a DataFlash log (.BIN)"),
    (b"PK\x03\x04", "a zip archive: unpack it first"),
    (b"\x1f\x8b", "a gzip archive: unpack it first"),
    (b"ULog", "a PX4 .ulg log, which is not supported"),
)


def read_bytes(path: str | Path) -> bytes:
    """All bytes of a file that exists, can be read and is not empty."""
    try:
        raw = Path(path).read_bytes()
    except IsADirectoryError:
        raise BadInput(f"{path} is a directory: name a log file inside it") from None
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file") from None
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}") from None
    if not raw:
        raise BadInput(f"{path} is empty: it holds no recording")
    return raw


def is_text(raw: bytes) -> bool:
    """Does it begin like text?"""
    try:
        # a character may be cut where the sample ends
        head = raw[:SAMPLE].decode("utf-8", errors="strict" if len(raw) <= SAMPLE else "ignore")
    except UnicodeDecodeError:
        return False
    return len(head) >= 0.9 * min(len(raw), SAMPLE) and all(
        c.isprintable() or c in "\r\n\t\ufeff" for c in head
    )


def looks_like(raw: bytes) -> str:
    """What the bytes seem to be, in a few words."""
    for magic, what in KNOWN:
        if raw.startswith(magic):
            return what
    if is_text(raw):
        return "a text file"
    if not raw.strip(b"\0"):
        return "nothing but zeros"
    return "unknown binary data"


KINDS = "a .tlog, a DataFlash .BIN, an MCAP recording or a .csv table"
FMT_RECORD = DATAFLASH_MAGIC + b"\x80"  # behind junk, this is how a DataFlash log begins


def open_log(path: str | Path, mapping: str | Path | None = None) -> Log:
    """Any recording that can be read; `mapping` says what the columns of a .csv mean."""
    raw = read_bytes(path)
    if raw.startswith(MCAP_MAGIC):
        # only where one is opened: the other kinds need not load the mcap library
        from gateway.ingest.mavlink.mcap import McapLog

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
