"""Reading the bytes of a recording, and saying in a few words what bytes look like."""

from pathlib import Path

from gateway.errors import BadInput

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
