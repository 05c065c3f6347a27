"""Records in a row -> one contiguous array per field.

Text fields of a log: bytes or str, with what stands behind a NUL.

What every kind of recording is turned into: columns by message, and counts of what was odd.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = TypeVar("Array", bound=NDArray[np.generic])


def columns(records: NDArray[np.void], fields: Iterable[str]) -> dict[str, NDArray[np.generic]]:
    """Records (K,) -> field -> (K,) or (K, n), aligned, read-only; text ends at its first NUL."""
    return {name: frozen(column(records[name])) for name in fields}


def column(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """One field of packed records -> the same values side by side."""
    aligned = np.ascontiguousarray(values)
    return until_nul(aligned) if aligned.dtype.kind == "S" else aligned


def until_nul(raw: NDArray[np.bytes_]) -> NDArray[np.bytes_]:
    """Text (K,) without what stands behind a NUL."""
    characters = raw.view(np.uint8).reshape(-1, raw.dtype.itemsize)
    inside = np.logical_and.accumulate(characters != 0, axis=1)
    return np.where(inside, characters, 0).astype(np.uint8).view(raw.dtype).reshape(-1)


def frozen(array: Array) -> Array:
    """The same array, read-only."""
    array.setflags(write=False)
    return array


def text(value: Any) -> str:
    """One field -> str without what stands behind a NUL; bytes that are no UTF-8 become marks."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return str(value).split("\0", 1)[0].strip()


def texts(column: Iterable[Any]) -> list[str]:
    """A column of fields -> list of str."""
    return [text(value) for value in column]


@dataclass(frozen=True)
class Table:
    """All messages of one name, as columns.

    order            (K,)  position of each message among all accepted ones of the log
    receive_time_ns  (K,)  int64 Unix ns of receipt (a DataFlash log has no receiver: boat time)
    system           (K,)  MAVLink system id (0 in DataFlash)
    component        (K,)  MAVLink component id (0 in DataFlash)
    columns          name -> (K,) or (K, n): fields under the names and in the units of the
                     definition (pymavlink's), not scaled; text fields are arrays of bytes or str
    """

    name: str
    order: NDArray[np.int64]
    receive_time_ns: NDArray[np.int64]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    columns: Mapping[str, NDArray[np.generic]]

    def __len__(self) -> int:
        return len(self.order)


@dataclass(frozen=True)
class Statistics:
    """What was found while reading: shown by `shadow info`, never hidden."""

    size_bytes: int = 0
    accepted: int = 0
    bad_checksum: int = 0
    junk_bytes: int = 0
    unknown_messages: int = 0
    signed: int = 0
    mavlink1: int = 0
    mavlink2: int = 0
    truncated_tail: bool = False
    lost: int = 0  # gaps in the sequence numbers, per system and component, summed
    duplicates: int = 0
    time_backwards: int = 0  # receive clock stepped back
    notes: tuple[str, ...] = field(default=())


class Log(Protocol):
    """A recording opened for reading."""

    @property
    def path(self) -> str:
        """Where it was opened."""
        ...

    @property
    def kind(self) -> str:
        """One of "tlog", "dataflash", "mcap", "csv"."""
        ...

    @property
    def statistics(self) -> Statistics:
        """What was found while reading."""
        ...

    def counts(self) -> Mapping[str, int]:
        """Message name -> number of accepted messages."""
        ...

    def table(self, name: str) -> Table:
        """All messages of that name (an empty table where there is none)."""
        ...
