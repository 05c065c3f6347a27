"""Name, layout and checksum seed of each MAVLink message, by pymavlink's own definitions.

Nothing here is kept by hand: a newer pymavlink brings newer messages.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega

# The dialect itself, not `mavutil`: that one reads and sets environment variables when imported.

UNKNOWN = -1
ITEM = re.compile(r"(\d*)([a-zA-Z])")  # one field of a struct format: how many, of what


class Layout(NamedTuple):
    """How the payload of one message lies in memory, little-endian and packed."""

    name: str
    dtype: np.dtype[np.void]
    fields: tuple[str, ...]  # in the order of the definition, not of the wire


@cache
def definitions() -> Mapping[int, Any]:
    """Message id -> pymavlink's class of the message: msgname, crc_extra, fieldnames, …"""
    found: Mapping[int, Any] = ardupilotmega.mavlink_map
    return found


@cache
def ids_by_name() -> Mapping[str, int]:
    """Message name -> message id."""
    return {definition.msgname: number for number, definition in definitions().items()}


@cache
def checksum_seeds() -> NDArray[np.int16]:
    """Byte that closes the checksum of each message id, `UNKNOWN` where no message has that id."""
    seeds = np.full(max(definitions()) + 1, UNKNOWN, np.int16)
    for number, definition in definitions().items():
        seeds[number] = definition.crc_extra
    seeds.setflags(write=False)
    return seeds


@cache
def layout(number: int) -> Layout:
    """The layout of a known message id."""
    definition = definitions()[number]
    # `native_format` leaves out the lengths of arrays; the unpacker has them
    packed = definition.unpacker.format
    kinds = [_item(count, code) for count, code in ITEM.findall(packed)]
    dtype = np.dtype(list(zip(definition.ordered_fieldnames, kinds, strict=True)))
    return Layout(definition.msgname, dtype, tuple(definition.fieldnames))


def _item(count: str, code: str) -> np.dtype[np.generic]:
    """numpy type of one field: `4` and `f` -> four floats, `16` and `s` -> text of 16 bytes."""
    if code == "s":
        return np.dtype(f"S{count or 1}")
    one = np.dtype(f"<{code}")
    return np.dtype((one, (int(count),))) if count else one
