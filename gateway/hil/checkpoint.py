"""Where a boat in the loop was when its program ended, kill -9 included: there it goes on.

Running firmware waits when `shadow hil` is gone, and its filter does not forgive a boat that then
lies elsewhere on another heading. So each frame leaves the state in a small mapped file, written in
two places in turn: one of them is always whole. A boat goes on only for the very frame that the
firmware is waiting with, with the same vessel, day and seed.
"""

import mmap
from math import nan
from pathlib import Path
from struct import Struct
from types import TracebackType
from typing import Any, Self
from zlib import crc32

import numpy as np
import orjson

from gateway.errors import ShadowError
from sim.hil.boat import BoatState

SLOT_BYTES = 4096  # a state takes some hundred
HEAD = Struct("<IIQ")  # checksum and length of the text, number of the writing
NEXT_FRAMES = (0, 1)  # after the last one that was kept: the firmware asks for that, or again


class Checkpoint:
    """The file of one boat; `identity` is what it must have in common with who reads it."""

    def __init__(self, path: Path, identity: str) -> None:
        self._path, self._identity = path, f"{crc32(identity.encode()):08x}"
        self._map: mmap.mmap | None = None
        self._writings = 0
        self._found: dict[str, Any] | None = None

    def __enter__(self) -> Self:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a+b") as file:
                file.truncate(2 * SLOT_BYTES)
                self._map = mmap.mmap(file.fileno(), 2 * SLOT_BYTES)
        except (OSError, ValueError) as error:
            raise ShadowError(f"{self._path}: cannot keep the state there: {error}") from None
        self._found = self._newest()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._map is not None:
            self._map.close()
            self._map = None

    def keep(self, frame: int, state: BoatState) -> None:
        """The state after a frame. Commands that act late are forgotten but for the last."""
        assert self._map is not None
        text = orjson.dumps(
            {**state._asdict(), "past": state.past[-1:], "frame": frame, "of": self._identity},
            option=orjson.OPT_SERIALIZE_NUMPY,
        )
        self._writings += 1
        at = SLOT_BYTES * (self._writings % 2)
        head = HEAD.pack(crc32(text), len(text), self._writings)
        if len(head) + len(text) <= SLOT_BYTES:
            self._map[at : at + len(head) + len(text)] = head + text

    def state_before(self, frame: int) -> BoatState | None:
        """Where the boat was when the firmware asked for that frame; None where that is unknown."""
        found = self._found
        if found is None or found["of"] != self._identity:
            return None
        if frame - found["frame"] not in NEXT_FRAMES:
            return None
        row = np.array([nan if x is None else x for x in found["row"]])
        past = tuple((time, tuple(commands)) for time, commands in found["past"])
        rest = {name: found[name] for name in ("time", "number", "used_as", "voltage")}
        return BoatState(row=row, past=past, **rest)

    def _newest(self) -> dict[str, Any] | None:
        assert self._map is not None
        best: tuple[int, dict[str, Any] | None] = (0, None)
        for at in (0, SLOT_BYTES):
            checksum, length, number = HEAD.unpack_from(self._map, at)
            text = self._map[at + HEAD.size : at + HEAD.size + min(length, SLOT_BYTES)]
            if length and crc32(text) == checksum and number > best[0]:
                best = (number, orjson.loads(text))
        self._writings = best[0]
        return best[1]
