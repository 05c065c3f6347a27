"""Text fields of a log: bytes or str, with what stands behind a NUL."""

from collections.abc import Iterable
from typing import Any


def text(value: Any) -> str:
    """One field -> str without what stands behind a NUL; bytes that are no UTF-8 become marks."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return str(value).split("\0", 1)[0].strip()


def texts(column: Iterable[Any]) -> list[str]:
    """A column of fields -> list of str."""
    return [text(value) for value in column]
