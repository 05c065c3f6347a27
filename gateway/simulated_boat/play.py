"""Play boats in real time on a port: frames go out when they are due, requests are answered.

The only place of this package with a clock. Pace is kept against the start, so it does not drift;
what a stalled machine could not send in time is lost, as on a real link. After a long sleep of
the machine the boats go on from where they were.
"""

import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import ShadowError
from gateway.simulated_boat.boat import BoatState, PlayedBoat
from gateway.simulated_boat.port import Heard, Port, open_port
from gateway.simulated_boat.telemetry import Message

STALE_S = 0.5  # frames older than this are not sent any more
ASLEEP_S = 10.0  # behind by more: time stood still
WARM_UP_S = 0.1  # of play, before the clock starts: everything compiled is loaded

Clock = Callable[[], float]


@dataclass
class Played:
    """What has been played so far; told to whoever wants to show it."""

    seconds: float = 0.0
    frames: int = 0
    stale: int = 0  # frames that came too late to be sent
    heard: int = 0  # messages from the other side
    lateness_s: float = 0.0  # the worst
    alone: str | None = None  # why nobody hears it


def play(
    boats: Sequence[PlayedBoat],
    endpoint: str,
    stop: Event,
    *,
    seconds: float = float("inf"),
    clock: Clock = time.monotonic,
    tell: Callable[[Played], None] = lambda played: None,
) -> Played:
    """Play until `stop` is set or that long has passed; `tell` is called each turn."""
    for boat in boats:
        boat.advance(boat.start(), WARM_UP_S)
    with open_port(endpoint) as port:
        stage = Stage(boats, port)
        begun = clock()
        while not stop.is_set() and clock() - begun < seconds:
            behind = clock() - begun - stage.next_s()
            begun += behind if behind > ASLEEP_S else 0.0
            stage.turn(clock() - begun)
            tell(stage.played)
            stop.wait(max(0.0, stage.next_s() - (clock() - begun)))
        return stage.played


@contextmanager
def playing(boats: Sequence[PlayedBoat], endpoint: str) -> Iterator[Played]:
    """Boats that play in a thread of their own while inside."""
    stop, shared, failed = Event(), Played(), []

    def work() -> None:
        try:
            play(boats, endpoint, stop, tell=lambda played: vars(shared).update(vars(played)))
        except ShadowError as error:
            failed.append(error)

    thread = Thread(target=work, name="played boats", daemon=True)
    thread.start()
    try:
        yield shared
    finally:
        stop.set()
        thread.join()
        if failed:
            raise failed[0]


class Stage:
    """Boats on one port. They share it, and each has its own moment within a tick."""

    def __init__(self, boats: Sequence[PlayedBoat], port: Port) -> None:
        self._boats, self._port, self._ears = boats, port, Ears()
        self._states = [boat.start() for boat in boats]
        self._shifts = [i / len(boats) * boat.dt for i, boat in enumerate(boats)]
        self.played = Played()

    def turn(self, now: float) -> None:
        """Hear, move on, speak."""
        self.played.seconds = now
        self.played.lateness_s = max(self.played.lateness_s, now - self.next_s())
        for message in self._ears.messages(self._port.heard()):
            self.played.heard += 1
            for i, boat in enumerate(self._boats):
                self._states[i] = boat.hear(self._states[i], message)
        self.played.alone = self._port.alone
        for i, boat in enumerate(self._boats):
            self._states[i] = self._spoken(boat, self._states[i], now - self._shifts[i])

    def next_s(self) -> float:
        """When the next turn is due [s since play began]."""
        return min(
            boat.next_s(state) + shift
            for boat, state, shift in zip(self._boats, self._states, self._shifts, strict=True)
        )

    def _spoken(self, boat: PlayedBoat, state: BoatState, now: float) -> BoatState:
        state, frames = boat.advance(state, now)
        for frame in frames:
            if now - frame.time_s > STALE_S:
                self.played.stale += 1
                continue
            self._port.send(frame.data)
            self.played.frames += 1
        return state


class Ears:
    """Bytes of several speakers -> messages."""

    def __init__(self) -> None:
        self._parsers: dict[Hashable, Any] = {}

    def messages(self, heard: Sequence[Heard]) -> list[Message]:
        """Everything understood; what is no MAVLink is passed over."""
        return [
            message
            for speaker, data in heard
            for message in self._parser(speaker).parse_buffer(data) or ()
            if message.get_type() != "BAD_DATA"
        ]

    def _parser(self, speaker: Hashable) -> Any:
        if speaker not in self._parsers:
            parser = mavlink.MAVLink(None)
            parser.robust_parsing = True
            self._parsers[speaker] = parser
        return self._parsers[speaker]
