"""Recordings and messages in, samples out: here, what a log format declares of itself.

Also the bytes of a file before its format is known. `open` has the table of formats.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.errors import BadInput

if TYPE_CHECKING:
    from gateway.ingest.log import Log


SAMPLE = 4096  # bytes that are looked at
HEAD = SAMPLE + 4  # bytes that a format is shown: a character may be cut where the sample ends


@dataclass(frozen=True)
class LogFormat:
    """One kind of recording that can be opened.

    name        for people, with its article: "a DataFlash .BIN"
    suffixes    that its files usually have; the content decides
    recognises  first `HEAD` bytes, path -> is it such a file?
    open        path, all bytes, mapping file of a table or None -> the opened log; BadInput with
                one line where that is not possible. Imports what is heavy when called
    mapped      whether it may hold a table, for which a mapping file is of use
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes, Path], bool]
    open: Callable[[str, bytes, str | Path | None], "Log"]
    mapped: bool = True


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
        head = raw[:SAMPLE].decode("utf-8", errors="strict" if len(raw) <= SAMPLE else "ignore")
    except UnicodeDecodeError:
        return False
    return len(head) >= 0.9 * min(len(raw), SAMPLE) and all(
        c.isprintable() or c in "\r\n\t\ufeff" for c in head
    )


def is_utf16(raw: bytes) -> bool:
    """Does it begin with the mark of UTF-16 text, which some spreadsheets write?"""
    return raw.startswith((b"\xff\xfe", b"\xfe\xff"))


def looks_like(raw: bytes) -> str:
    """What the bytes of no known format seem to be, in a few words."""
    if raw.startswith(b"PK\x03\x04"):
        return "a zip archive: unpack it first"
    if raw.startswith(b"\x1f\x8b"):
        return "a gzip archive: unpack it first"
    if is_text(raw):
        return "a text file"
    if is_utf16(raw):
        return "UTF-16 text: a table is UTF-8, and its name ends in .csv"
    return "unknown binary data" if raw.strip(b"\0") else "nothing but zeros"
