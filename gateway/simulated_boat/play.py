"""A simulated boat on a link (`shadow simulate --live`), or in a file (`shadow simulate --log`).

    udpout:HOST:PORT   sends there (the gateway listens: udpin)
    udpin:HOST:PORT    waits for a first datagram (from the gateway: udpout)
    tcpin:HOST:PORT    is the server (the gateway: tcp)
    tcp:HOST:PORT      connects, again and again until a server is there (the gateway: tcpin)

The link is polled, and waits for nothing but a connection, a moment. Vessels are MAVLink boats on a
port, in real time: frames go out when they are due, requests are answered. Only this file has a
clock. Pace is kept against the start, so it does not drift; what a stalled machine could not send
in time is lost, as on a real link. After a long sleep of the machine the boats go on from where
they were.

The file, a .tlog, is what a radio would have received. No clock and no link: the whole voyage is
computed as fast as it can be. The same vessel, program and seed give the same bytes. The boat moves
by the model of the vessel itself, so such a log tests what can be found in a recording, never
whether a model is right.
"""

import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput, ShadowError
from gateway.files import write_whole
from gateway.links import Arrival, Peer, Transport, Waker
from gateway.links.link import transport_of
from gateway.long_running import Stop, stop_on_signals
from gateway.simulated_boat import FAST, THIN, SimulatedBoatSettings, TimedFrame
from gateway.simulated_boat.boat import BoatState, SimulatedBoat
from gateway.simulated_boat.hull import program_of
from gateway.simulated_boat.telemetry import Message
from sim.state import Progress
from sim.vessel import Vessel

KINDS = {  # and what to report while nothing that is sent can be received
    "udpout": "",
    "udpin": "nobody has spoken yet; waiting",
    "tcpin": "nobody has called; waiting",
    "tcp": "",
}
MAX_PEERS = 16  # that are sent to because a datagram came from them
CONNECT_TIMEOUT_S, RETRY_S = 0.25, 1.0


class BoatPort:
    """One end of a link, open while inside."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint, self._transport = endpoint, boat_transport(endpoint)
        self._waiting = KINDS[endpoint.partition(":")[0]]
        self._waker = Waker()
        self._failure: str | None = "no answer"  # why it is not open; None: it is
        self._retry_s = float("-inf")
        self._senders: dict[Peer, None] = {}

    def __enter__(self) -> Self:
        try:
            self._open()
        except OSError as error:
            self._close(error)
            if self._transport.listens:
                self._waker.__exit__()
                raise ShadowError(f"{self._endpoint}: cannot open it: {self._failure}") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        self._waker.__exit__()

    @property
    def no_listener(self) -> str | None:
        """Why nothing that is sent can be received; None where it may be."""
        if self._failure is not None:
            return f"{self._failure}; calling again every second"
        return None if self._peers() else self._waiting

    def send(self, data: bytes) -> None:
        """One frame to everybody who listens; lost where nobody does."""
        if self._failure is None:
            for peer in self._peers():
                self._transport.send(data, peer)

    def receive(self) -> list[Arrival]:
        """What has arrived since; connects where there is no connection."""
        arrivals: list[Arrival] = []
        try:
            if self._failure is not None:
                if time.monotonic() < self._retry_s:
                    return []
                self._open()
            while new := self._transport.receive(0.0):
                arrivals += new
        except OSError as error:
            self._close(error)
        for arrival in arrivals:
            if len(self._senders) < MAX_PEERS:
                self._senders[arrival.peer] = None
        return arrivals

    def _peers(self) -> tuple[Peer, ...]:
        connected = self._transport.connected()
        return tuple(self._senders) if connected is None else connected

    def _open(self) -> None:
        self._retry_s = time.monotonic() + RETRY_S
        self._transport.open(self._waker, lambda kind, text: None, CONNECT_TIMEOUT_S)
        self._failure = None

    def _close(self, error: OSError) -> None:
        self._transport.close()
        self._failure = error.strerror or str(error)


def boat_transport(endpoint: str) -> Transport:
    """The transport that an endpoint names, still closed; BadInput where it names none."""
    if endpoint.partition(":")[0] in KINDS:
        with suppress(BadInput):
            return transport_of(endpoint)
    raise BadInput(
        f"{endpoint}: expected {', '.join(KINDS)} with host and port, as in udpout:127.0.0.1:14550"
    )


MAX_AGE_S = 0.5  # older frames are not sent any more
ASLEEP_S = 10.0  # behind by more: the machine was asleep
WARM_UP_S = 0.1  # simulated before the clock starts: everything compiled is loaded
NOTICE_S = 2.0  # without a listener for so long, the user is told
ABREAST_M = 30.0  # between boats that start together

Clock = Callable[[], float]


@dataclass
class PlayStatus:
    """What has been played so far."""

    seconds: float = 0.0
    frames: int = 0  # sent
    stale: int = 0  # frames that came too late to be sent
    received: int = 0  # messages from the other side
    lateness_s: float = 0.0  # the worst
    no_listener: str | None = None  # why nothing that is sent can be received


class PlayLoop:
    """Boats on one port. They share it, and each has its own moment within a tick."""

    def __init__(self, boats: Sequence[SimulatedBoat], port: BoatPort) -> None:
        self._boats, self._port = boats, port
        self._parsers: dict[Peer, Any] = {}
        self._states = [boat.start() for boat in boats]
        self._shifts = [i / len(boats) * boat.dt for i, boat in enumerate(boats)]
        self.status = PlayStatus()

    def turn(self, now: float) -> None:
        """Receive, move on, send."""
        self.status.seconds = now
        self.status.lateness_s = max(self.status.lateness_s, now - self.next_s())
        for message in self._messages(self._port.receive()):
            self.status.received += 1
            for i, boat in enumerate(self._boats):
                self._states[i] = boat.receive(self._states[i], message)
        self.status.no_listener = self._port.no_listener
        for i, boat in enumerate(self._boats):
            self._states[i] = self._advance(boat, self._states[i], now - self._shifts[i])

    def next_s(self) -> float:
        """When the next turn is due [s since the start]."""
        return min(
            boat.next_s(state) + shift
            for boat, state, shift in zip(self._boats, self._states, self._shifts, strict=True)
        )

    def _advance(self, boat: SimulatedBoat, state: BoatState, now: float) -> BoatState:
        state, frames = boat.advance(state, now)
        for frame in frames:
            if now - frame.time_s > MAX_AGE_S:
                self.status.stale += 1
                continue
            self._port.send(frame.data)
            self.status.frames += 1
        return state

    def _messages(self, arrivals: Sequence[Arrival]) -> list[Message]:
        """The messages in what several peers sent; anything else is passed over."""
        return [
            message
            for arrival in arrivals
            for message in self._parser(arrival.peer).parse_buffer(arrival.data) or ()
            if message.get_type() != "BAD_DATA"
        ]

    def _parser(self, peer: Peer) -> Any:
        if peer not in self._parsers:
            self._parsers[peer] = mavlink.MAVLink(None)
            self._parsers[peer].robust_parsing = True
        return self._parsers[peer]


def play(
    boats: Sequence[SimulatedBoat],
    endpoint: str,
    stop: Stop | Event,
    *,
    seconds: float = float("inf"),
    clock: Clock = time.monotonic,
    each_turn: Callable[[PlayStatus], None] = lambda status: None,
) -> PlayStatus:
    """Play until `stop` is set or that long has passed."""
    for boat in boats:
        boat.advance(boat.start(), WARM_UP_S)
    with BoatPort(endpoint) as port:
        loop = PlayLoop(boats, port)
        begun = clock()
        while not stop.is_set() and clock() - begun < seconds:
            behind = clock() - begun - loop.next_s()
            begun += behind if behind > ASLEEP_S else 0.0
            loop.turn(clock() - begun)
            each_turn(loop.status)
            stop.wait(max(0.0, loop.next_s() - (clock() - begun)))
        return loop.status


@contextmanager
def playing(boats: Sequence[SimulatedBoat], endpoint: str) -> Iterator[PlayStatus]:
    """Boats that play in a thread of their own while inside."""
    stop, shared, errors = Event(), PlayStatus(), list[ShadowError]()

    def work() -> None:
        try:
            play(boats, endpoint, stop, each_turn=lambda now: vars(shared).update(vars(now)))
        except ShadowError as error:
            errors.append(error)

    thread = Thread(target=work, name="simulated boats", daemon=True)
    thread.start()
    try:
        yield shared
    finally:
        stop.set()
        thread.join()
        if errors:
            raise errors[0]


class ListenerNotice:
    """Reports that it plays, when nobody listens for a while, and when somebody does; once each."""

    def __init__(self, endpoint: str, progress: Progress, begun: str = "") -> None:
        self._endpoint, self._progress, self._begun = endpoint, progress, begun
        self._since_s = 0.0
        self._reported = False

    def note(self, status: PlayStatus) -> None:
        """Report what has changed; called each turn."""
        if self._begun:
            self._progress(self._begun)
            self._begun = ""
        if status.no_listener is None:
            if self._reported:
                self._progress(f"{self._endpoint}: connected")
            self._since_s, self._reported = status.seconds, False
        elif not self._reported and status.seconds - self._since_s >= NOTICE_S:
            self._progress(f"{self._endpoint}: {status.no_listener}")
            self._reported = True


def simulate_live(
    vessels: Sequence[Vessel],
    endpoint: str,
    stop: Stop | Event,
    *,
    system: int = 1,
    program: str | Path = "mixed",
    fast: bool = False,
    noise: float = 1.0,
    station: bool = False,
    seed: int = 0,
    seconds: float = float("inf"),
    each_turn: Callable[[PlayStatus], None] = lambda status: None,
) -> PlayStatus:
    """Play vessels side by side, with ids from `system` on, until `stop` is set.

    `program` is one of `gateway.simulated_boat.hull.PROGRAMS` or a CSV of commands; `fast`
    starts with high rates instead of a telemetry radio's.
    """
    if not vessels:
        raise BadInput("no vessel to play: give one or more with --vessel")
    boat_transport(endpoint)  # before anything is compiled
    now = time.time()
    boats = [
        SimulatedBoat(
            vessel,
            SimulatedBoatSettings(
                system_id=system + i,
                rates=FAST if fast else THIN,
                noise=noise,
                unix_s=now,
                start=(0.0, ABREAST_M * i, 0.0),
                station=station and i == 0,
            ),
            seed + i,
            program_of(vessel, program, seed + i),
        )
        for i, vessel in enumerate(vessels)
    ]
    return play(boats, endpoint, stop, seconds=seconds, each_turn=each_turn)


def play_until_stopped(
    vessel: Vessel,
    endpoint: str,
    progress: Progress,
    *,
    program: str,
    system: int,
    fast: bool,
    seed: int,
    seconds: float,
) -> None:
    """Play a program over and over until SIGINT, SIGTERM, SIGHUP, or that long has passed."""
    stop = stop_on_signals()
    boat_transport(endpoint)  # what names no place to play to is told first
    progress(f"making {vessel.name} ready (the first time its model is compiled)")
    notice = ListenerNotice(endpoint, progress, f"playing {vessel.name} as system {system} on "
                            f"{endpoint}; Ctrl-C ends")  # fmt: skip
    status = simulate_live(
        [vessel], endpoint, stop, system=system, program=program, fast=fast, seed=seed,
        seconds=seconds, each_turn=notice.note,
    )  # fmt: skip
    progress(
        f"played {status.seconds:.0f} s, {status.frames} frames, heard {status.received} messages"
    )


LONGEST_S = DAY_S = 86_400.0
MOST_DAYS = 3000  # that seeds are spread over: what comes later is no date of a log


def write_log(
    vessel: Vessel,
    file: Path,
    *,
    program: str = "mixed",
    system: int = 1,
    fast: bool = False,
    seed: int = 0,
    seconds: float = float("inf"),
) -> float:
    """Play a program, once where no duration [s] is given, into a .tlog -> the duration [s]."""
    if file.suffix.lower() != ".tlog":
        raise BadInput(f"{file}: a telemetry log is called NAME.tlog")
    commands = program_of(vessel, program, seed)
    duration = commands.period if seconds == float("inf") else seconds
    if not 0.0 < duration <= LONGEST_S:
        raise BadInput(f"{duration:g} s: a voyage lasts more than 0 s and at most a day")
    settings = SimulatedBoatSettings(system_id=system, rates=FAST if fast else THIN)
    # of another seed on another day: a boat cannot have been on two voyages at once
    settings = replace(settings, unix_s=settings.unix_s + DAY_S * (seed % MOST_DAYS))
    boat = SimulatedBoat(vessel, settings, seed, commands)
    _, frames = boat.advance(boat.start(), duration)
    write_whole(file, tlog_bytes(frames, settings.unix_s), "the telemetry log")
    return duration


def tlog_bytes(frames: Iterable[TimedFrame], unix_s: float) -> bytes:
    """Frames -> a .tlog: before each the Unix time of its arrival [µs], 8 bytes big-endian."""
    return b"".join(
        struct.pack(">Q", round((unix_s + frame.time_s) * 1e6)) + frame.data for frame in frames
    )
