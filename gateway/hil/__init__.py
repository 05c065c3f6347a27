"""A vessel under a real autopilot: protocols in which firmware asks for sensors, one file each.

Here: one boat in the loop, its state, what is said about it, and what its protocol has in common
with others; and where it was when its program ended, kill -9 included: there it goes on.

Running firmware waits when `shadow hil` is gone, and its filter does not forgive a boat that then
lies elsewhere on another heading. So each frame leaves the state in a small mapped file, written in
two places in turn: one of them is always whole. A boat goes on only for the very frame that the
firmware is waiting with, with the same vessel, day and seed. The file is locked while its program
runs: two boats of one name in one folder would each go on where the other was.
"""

import mmap
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from math import nan
from pathlib import Path
from struct import Struct
from types import TracebackType
from typing import IO, Any, Protocol, Self
from zlib import crc32

import numpy as np
import orjson

from gateway.errors import BadInput, ShadowError
from gateway.hil.outputs import OutputCheck
from gateway.links import Peer
from sim.hil import Readings
from sim.hil.boat import Boat, BoatState, Truth
from sim.state import Progress

SLOT_BYTES = 4096  # a state takes some hundred
HEAD = Struct("<IIQ")  # checksum and length of the text, number of the writing
NEXT_FRAMES = (0, 1)  # after the last one that was kept: the firmware asks for that, or again
RELEASE_S, RETRY_S = 2.0, 0.1  # a program that was just ended still finishes its recording; chosen


class Checkpoint:
    """The file of one boat; `identity` is what it must have in common with who reads it."""

    def __init__(self, path: Path, identity: str) -> None:
        self._path, self._identity = path, f"{crc32(identity.encode()):08x}"
        self._map: mmap.mmap | None = None
        self._file: IO[bytes] | None = None  # open, and so locked, as long as the map
        self._writings = 0
        self._found: dict[str, Any] | None = None

    def __enter__(self) -> Self:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("a+b")
            if not _locked(self._file):
                self._file.close()
                raise BadInput(
                    f"{self._path}: another `shadow hil` keeps its boat there: give this one "
                    "another name (--vessel NAME=FILE) or another folder (--out DIR)"
                )
            self._file.truncate(2 * SLOT_BYTES)
            self._map = mmap.mmap(self._file.fileno(), 2 * SLOT_BYTES)
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
        if self._file is not None:
            self._file.close()

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
        if found is None or self.misfit(frame):
            return None
        row = np.array([nan if x is None else x for x in found["row"]])
        past = tuple((time, tuple(commands)) for time, commands in found["past"])
        rest = {name: found[name] for name in ("time", "number", "used_as", "voltage")}
        return BoatState(row=row, past=past, **rest)

    def misfit(self, frame: int) -> str:
        """Why no boat can go on with that frame; empty where one can."""
        found = self._found
        if found is None:
            return f"{self._path} holds no earlier boat"
        if found["of"] != self._identity:
            return f"{self._path} is of another vessel, day or seed"
        if frame - found["frame"] not in NEXT_FRAMES:
            return f"{self._path} ends at frame {found['frame']}"
        return ""

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


def _locked(file: IO[bytes]) -> bool:
    """Whether the file is this program's alone; so it is where a system knows no locks."""
    if sys.platform == "win32":
        return True
    import fcntl

    for _ in range(round(RELEASE_S / RETRY_S) + 1):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            time.sleep(RETRY_S)
        except OSError:
            return True
    return False


QUIET_S = 10.0  # between two lines about the same thing


class TruthSink(Protocol):
    """Takes what was true after each step, with the pulses that led there."""

    def put(self, truth: Truth, pulses: Mapping[int, float]) -> None:
        """After one step."""
        ...

    def start(self, time_s: float = 0.0) -> None:
        """The boat starts anew: its time is 0 again; or it goes on from a moment."""
        ...


class Notices:
    """Lines about one boat; of what repeats, one each ten seconds."""

    def __init__(
        self, name: str, progress: Progress, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._name, self._progress, self._clock = name, progress, clock
        self._last: dict[str, float] = {}
        self._held: dict[str, int] = {}

    def say(self, kind: str, text: str) -> None:
        """A line, unless one of its kind was said just now."""
        now = self._clock()
        if now - self._last.get(kind, float("-inf")) < QUIET_S:
            self._held[kind] = self._held.get(kind, 0) + 1
            return
        more = self._held.pop(kind, 0)
        self._last[kind] = now
        self._progress(f"{self._name}: {text}" + (f" ({more} more of this kind)" if more else ""))

    def once(self, kind: str, text: str) -> None:
        """A line that is said once."""
        if kind not in self._last:
            self._last[kind] = float("inf")
            self._progress(f"{self._name}: {text}")


class Played:
    """A boat that moves when its protocol says so."""

    def __init__(self, name: str, boat: Boat, notices: Notices) -> None:
        self.sink: TruthSink | None = None
        self.checkpoint: Checkpoint | None = None
        self.name, self.boat, self._notices = name, boat, notices
        self._state = boat.start()
        self.truth: Truth | None = None  # after the last step; other threads may look
        self._outputs = OutputCheck(boat.vessel.actuators, notices.once)
        self.frames = self.restarts = 0
        self.seconds = 0.0  # of the boat's time, over all starts
        self.counts: dict[str, int] = {}

    def start(self, kind: str, text: str, under_way: bool = False) -> None:
        """The boat at rest where the day begins; `under_way`: the firmware began earlier."""
        self._notices.say(kind, text)
        self._outputs.begin(under_way)
        if self.frames:
            self.restarts += 1
            self._state = self.boat.start()
            if self.sink is not None:
                self.sink.start()

    def resume(self, frame: int) -> bool:
        """Go on where an earlier program left it when firmware waited with that frame."""
        state = None if self.checkpoint is None else self.checkpoint.state_before(frame)
        if state is None:
            return False
        self._state = state
        if self.sink is not None:
            self.sink.start(state.time)
        return True

    def misfit(self, frame: int) -> str:
        """Why it cannot go on with that frame."""
        if self.checkpoint is None:
            return "where it was is not kept with --no-record or --plant"
        return self.checkpoint.misfit(frame)

    def keep(self, frame: int) -> None:
        """Note where the boat is after a frame."""
        if self.checkpoint is not None:
            self.checkpoint.keep(frame, self._state)

    def step(self, pulses: Mapping[int, float], dt: float) -> Readings:
        """Go on by dt [s] under pulses [µs] by channel -> what the sensors read then."""
        self._state, readings, truth = self.boat.step(self._state, pulses, dt)
        self.truth = truth
        self._outputs.look(pulses, truth.time)
        if self.sink is not None:
            self.sink.put(truth, pulses)
        self.frames += 1
        self.seconds += dt
        return readings

    def notice(self, kind: str, text: str) -> None:
        """A line about what happened, and its count."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        self._notices.say(kind, text)

    count = notice

    def tell_once(self, kind: str, text: str) -> None:
        """A line that is said once, and counts for nothing."""
        self._notices.once(kind, text)


class Session(ABC):
    """What one protocol does with one boat. Bytes in, bytes out; no sockets."""

    talks = True  # an autopilot that is there says something all the time
    absent = ""  # what may be wrong where none has connected for a while

    def __init__(self, played: Played) -> None:
        self.played = played

    @abstractmethod
    def received(self, data: bytes, peer: Peer, now: float) -> list[bytes]:
        """Bytes of a peer at a moment [s, monotonic] -> what to send back."""

    @abstractmethod
    def wait_s(self, now: float) -> float:
        """How long nothing will be due [s]."""

    @abstractmethod
    def due(self, now: float, peers: tuple[Peer, ...]) -> list[bytes]:
        """What is to be sent now to the first of those that are connected."""
