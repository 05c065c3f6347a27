"""DataFlash messages as the log's own FMT records define them.

FMT: type (1 byte), length of the whole message (1), name (4), one format character per column
(16), column names separated by commas (64). Characters as ArduPilot's LogStructure.h lists them;
a test compares them with pymavlink's.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.columns import column, frozen
from gateway.ingest.dataflash_walk import FMT_TYPE, HEADER

FMT_RECORD = np.dtype([("f0", "u1"), ("f1", "u1"), ("f2", "S4"), ("f3", "S16"), ("f4", "S64")])
KINDS = {
    "a": np.dtype(("<i2", (32,))),
    "b": np.dtype("i1"),
    "B": np.dtype("u1"),
    "h": np.dtype("<i2"),
    "H": np.dtype("<u2"),
    "i": np.dtype("<i4"),
    "I": np.dtype("<u4"),
    "q": np.dtype("<i8"),
    "Q": np.dtype("<u8"),
    "g": np.dtype("<f2"),
    "f": np.dtype("<f4"),
    "d": np.dtype("<f8"),
    "n": np.dtype("S4"),
    "N": np.dtype("S16"),
    "Z": np.dtype("S64"),
    "c": np.dtype("<i2"),
    "C": np.dtype("<u2"),
    "e": np.dtype("<i4"),
    "E": np.dtype("<u4"),
    "L": np.dtype("<i4"),
    "M": np.dtype("i1"),
}
# a division by these is exact where a product with 0.01 or 1e-7 is not
DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


class Format(NamedTuple):
    """One message of the log: fields of `dtype` are numbered, `names` tells what they are."""

    type: int
    name: str
    characters: str
    names: tuple[str, ...]
    dtype: np.dtype[np.void]

    @property
    def clock(self) -> str:
        """The first column where it is the autopilot's clock, else nothing."""
        first = self.names[0] if self.names else ""
        whole = self.characters[:1] in ("Q", "I")
        # the TimeMS of ACC and GYR is that of the sensor
        own = first == "TimeUS" or (first == "TimeMS" and self.name[:3] not in ("ACC", "GYR"))
        return first if own and whole else ""


def sizes() -> NDArray[np.int64]:
    """Size of each format character by its code, 0 for what is none: (256,) [bytes]."""
    table = np.zeros(256, np.int64)
    for character, kind in KINDS.items():
        table[ord(character)] = kind.itemsize
    return table


def fmt_itself() -> Format:
    """The format of FMT records, which need not be in the log."""
    names = ("Type", "Length", "Name", "Format", "Columns")
    return Format(FMT_TYPE, "FMT", "BBnNZ", names, FMT_RECORD)


def formats(records: NDArray[np.void]) -> dict[int, Format]:
    """FMT records (K,) -> type -> format; where a type comes twice, the first.

    A second type of the same name is told apart by its number: `NAME#17`.
    """
    found, names = {FMT_TYPE: fmt_itself()}, {"FMT"}
    for record in records:
        number, length, name, characters, columns = record.item()
        made = _format(number, name, characters, columns)
        if made and number not in found and made.dtype.itemsize + HEADER == length:
            found[number] = made
            if made.name in names:
                found[number] = made._replace(name=f"{made.name}#{number}")
            names.add(made.name)
    return found


def decoded(records: NDArray[np.void], layout: Format) -> dict[str, NDArray[np.generic]]:
    """Messages (K,) of one format -> column name -> values in the unit that the log gives them."""
    return {
        name: frozen(_values(records[f"f{k}"], layout, k)) for k, name in enumerate(layout.names)
    }


def _values(raw: NDArray[Any], layout: Format, k: int) -> NDArray[np.generic]:
    character = layout.characters[k]
    if character in DIVISORS:
        return np.asarray(raw / DIVISORS[character])
    if layout.name == "FILE" and character == "Z":
        return np.ascontiguousarray(raw)  # contents of a file: bytes, not text
    return column(raw)


def _format(number: int, name: bytes, characters: bytes, columns: bytes) -> Format | None:
    codes = _word(characters)
    if not codes or not set(codes) <= set(KINDS):
        return None
    dtype = np.dtype([(f"f{k}", KINDS[code]) for k, code in enumerate(codes)])
    names = tuple(_word(columns).split(",")) if _word(columns) else ()
    return Format(number, _word(name), codes, names[: len(codes)], dtype)


def _word(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("ascii", errors="backslashreplace")
