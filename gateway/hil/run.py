"""`shadow hil`: boats in the loop, each on an endpoint of its own, until Ctrl-C.

An endpoint is `PROTOCOL:ADDRESS`; the protocols are one table. Each boat has a thread that waits
for its autopilot, steps, and answers; nothing is sent to anybody else.
"""

import errno
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import numpy as np

from gateway.errors import NUMERICAL_ERRORS, BadInput, ShadowError
from gateway.files import check_name, named_vessel
from gateway.hil import Checkpoint, Notices, Played, Session
from gateway.hil.ahrs import WARNING, AhrsSession, ServoOutputs, check_link
from gateway.hil.ardupilot_json import JsonSession
from gateway.hil.day_file import wind_told
from gateway.hil.hearing import Hearing
from gateway.hil.px4 import Px4Session
from gateway.hil.recording import TruthOnBus, TruthRecording, loop_recorder
from gateway.links import Closing, Endpoint, LinkEventKind, Transport, Waker
from gateway.links.transports import SerialTransport, TcpServerTransport, UdpTransport
from gateway.long_running import stop_on_signals
from gateway.recording.thread import RecordingThread
from gateway.vessel_file import dump_vessel, zenoh_key
from sim.hil.boat import Boat
from sim.hil.day import Day
from sim.plants import OWN_VESSEL, PlantChoice
from sim.state import Progress
from sim.vessel import Vessel

DEFAULT_ENDPOINT = "json:127.0.0.1:9002"
PX4_BAUD = 921600  # of a board in HITL mode
AHRS_BAUD = 230400  # of an external AHRS: three packets at 100, 50 and 5 Hz take 14 kB/s
LOOK_S = 0.1  # so often it looks whether it is to stop, and publishes the truth


class LoopProtocol(NamedTuple):
    """A protocol in which an autopilot asks for sensors."""

    name: str
    form: str
    description: str
    transport: Callable[[str], Transport]  # of the address; ValueError where it is none
    session: Callable[[Played, "LoopOptions", ExitStack], Session]
    warning: str = ""  # said before anything is sent


def _datagrams(address: str) -> Transport:
    return UdpTransport(Endpoint(f"udpin:{address}", "udpin", address))


def _stream(address: str) -> Transport:
    if address.startswith("/"):
        device, colon, baud = address.partition(":")
        text = f"{device}:{baud}" if colon else f"{device}:{PX4_BAUD}"
        return SerialTransport(Endpoint(f"serial:{text}", "serial", text))
    return TcpServerTransport(Endpoint(f"tcpin:{address}", "tcpin", address))


def _device(address: str) -> Transport:
    """A serial port; HOST:PORT is one of firmware that runs as a program."""
    if address.startswith("/"):
        device, colon, baud = address.partition(":")
        text = f"{device}:{baud if colon else AHRS_BAUD}"
        return SerialTransport(Endpoint(f"serial:{text}", "serial", text))
    return TcpServerTransport(Endpoint(f"tcpin:{address}", "tcpin", address))


def _ahrs_session(played: Played, options: "LoopOptions", scope: ExitStack) -> Session:
    outputs = scope.enter_context(ServoOutputs(check_link(options.outputs)))
    return AhrsSession(played, outputs)


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        LoopProtocol(
            "json",
            "json:HOST:PORT",
            "ArduPilot's JSON interface",
            _datagrams,
            lambda played, options, scope: JsonSession(played),
        ),
        LoopProtocol(
            "px4",
            "px4:HOST:PORT or px4:/dev/NAME[:BAUD]",
            "PX4's simulator protocol",
            _stream,
            lambda played, options, scope: Px4Session(played, options.speed),
        ),
        LoopProtocol(
            "ahrs",
            "ahrs:/dev/NAME[:BAUD]",
            "the external AHRS of an ArduPilot board",
            _device,
            _ahrs_session,
            WARNING,
        ),
    )
}


@dataclass(frozen=True)
class LoopPlan:
    """A boat and the endpoint that its autopilot calls."""

    endpoint: str
    name: str
    vessel: Vessel


@dataclass(frozen=True)
class LoopOptions:
    """Day, its text for the recording, seed, folder of the recordings (None: none), how long.

    `seconds` is of the clock on the wall. `speed`: times real time, for PX4 in lock-step.
    `outputs`: the link on which the servo outputs of a board come back. `plant`: what moves under
    the vessels' actuators. `bus`: where zenoh may be joined to publish the truth; None: nowhere.
    """

    day: Day = field(default_factory=Day)
    day_text: str | None = None
    seed: int = 0
    out: Path | None = None
    seconds: float = float("inf")
    speed: float = 1.0
    outputs: str | None = None
    bus: str | None = None
    plant: PlantChoice = OWN_VESSEL


def protocol_of(endpoint: str) -> tuple[LoopProtocol, Transport]:
    """An endpoint -> its protocol and transport, still closed; BadInput lists the forms."""
    kind, _, address = endpoint.partition(":")
    try:
        if kind not in PROTOCOLS:
            raise ValueError("not an endpoint of an autopilot")
        return PROTOCOLS[kind], PROTOCOLS[kind].transport(address)
    except ValueError as error:
        forms = ", ".join(protocol.form for protocol in PROTOCOLS.values())
        raise BadInput(f'endpoint "{endpoint}": {error}; expected {forms}') from None


def plans_of(
    endpoints: Sequence[str], vessels: Sequence[str], load: Callable[[str], Vessel]
) -> list[LoopPlan]:
    """Endpoints and `[NAME=]FILE` in the same order -> plans; names are those of the vessels."""
    if len(endpoints) != len(vessels):
        raise BadInput(
            f"{len(endpoints)} endpoints and {len(vessels)} vessels: give a --vessel for each "
            "endpoint, in the same order"
        )
    if len(set(endpoints)) < len(endpoints):
        raise BadInput("an endpoint is given twice: each boat needs a port of its own")
    plans = []
    for endpoint, given in zip(endpoints, vessels, strict=True):
        protocol_of(endpoint)
        name, file = named_vessel(given)
        if name is not None:
            check_name(name, f"--vessel {given}: the name")
        vessel = load(file)
        key = zenoh_key(vessel) if name is None else name
        check_name(key, f"{file}: give --vessel NAME=FILE, since its name makes the key")
        plans.append(LoopPlan(endpoint, key, vessel))
    names = [plan.name for plan in plans]
    if len(set(names)) < len(names):
        raise BadInput(f"two boats of one name ({', '.join(names)}): give --vessel NAME=FILE")
    return plans


class BoatLoop:
    """One boat on one endpoint; `run` returns when the waker is woken or it has failed.

    `open`, `claim` and `record` come first, in this order and each of all boats before the next:
    what cannot begin leaves no file behind.
    """

    def __init__(
        self, plan: LoopPlan, options: LoopOptions, progress: Progress, scope: ExitStack
    ) -> None:
        self.plan, self._options = plan, options
        try:
            boat = Boat.of(plan.vessel, options.day, options.seed, options.plant)
        except ValueError as error:
            raise BadInput(f"{plan.name}: {error}") from None
        self.recording: RecordingThread | None = None
        self._truth: TruthRecording | None = None
        self.notices = Notices(plan.name, progress)
        self.played = Played(plan.name, boat, self.notices)
        protocol, self._transport = protocol_of(plan.endpoint)
        self._session = protocol.session(self.played, options, scope)
        self._warning = protocol.warning
        self.failure: Exception | None = None
        self.wall_s = 0.0  # from the first frame to the last
        self.latencies: list[float] = []  # s from a packet to its answer

    def open(self, waker: Waker) -> None:
        """Bind the port; ShadowError where it is taken."""
        if self._warning:
            self.notices.say("warning", self._warning)
        try:
            self._transport.open(waker, self._link_event)
        except OSError as error:
            text = f"{self.plan.endpoint}: cannot listen there: {error.strerror or error}"
            if error.errno == errno.EADDRINUSE:
                text += "; another program has the port: end that one, or give another endpoint"
            raise ShadowError(text) from None

    def claim(self, scope: ExitStack) -> None:
        """Open the file that keeps where the boat is; BadInput where it is another program's."""
        options, vessel = self._options, self.played.boat.vessel
        if options.out is None or options.plant != OWN_VESSEL:
            return  # the state of any other plant may be of any kind
        identity = f"{dump_vessel(vessel)}{options.day_text}{options.seed}"
        file = options.out / f"{self.plan.name}-hil.state"
        self.played.checkpoint = scope.enter_context(Checkpoint(file, identity))

    def record(self, scope: ExitStack) -> None:
        """Begin the recording, if there is to be one; from here on it waits for its autopilot."""
        options, name = self._options, self.plan.name
        if options.out is not None:
            vessel = self.played.boat.vessel
            recorder = loop_recorder(
                options.out, name, vessel, options.day_text, options.seed, options.plant
            )
            self.recording = scope.enter_context(RecordingThread(recorder))
            self.played.sink = self._truth = TruthRecording(name, self.recording, time.time_ns())
        if wind := wind_told(options.day, self.played.boat.vessel, options.plant):
            self.notices.say("wind", wind)
        self.notices.say("listening", f"waiting for an autopilot on {self.plan.endpoint}")

    def close(self) -> None:
        """Close the port; allowed in any state."""
        self._transport.close()

    @property
    def failures(self) -> list[Exception | str]:
        """What ended it, and what kept its recording from being finished."""
        of_recording = None if self.recording is None else self.recording.failure
        return [why for why in (self.failure, of_recording) if why is not None]

    def run(self) -> None:
        """Answer until woken."""
        try:
            self._serve()
        except Closing:
            pass
        except (ShadowError, OSError, *NUMERICAL_ERRORS) as error:
            self.failure = error
        finally:
            self.close()
            if self._truth is not None:
                self._truth.flush()

    def _serve(self) -> None:
        hearing = Hearing(self._session, self.notices, time.monotonic())
        while True:
            wait_s = self._session.wait_s(time.monotonic())
            arrivals = self._transport.receive(wait_s)
            now = time.monotonic()
            hearing.waited(wait_s, now)
            for arrival in arrivals:
                hearing.heard(now)
                for answer in self._session.received(arrival.data, arrival.peer, now):
                    self._transport.send(answer, arrival.peer)
                self._note_latency(time.monotonic() - now)
                self.wall_s = now - (hearing.begun or now)
            peers = self._transport.connected() or ()
            for raw in self._session.due(time.monotonic(), peers):
                self._transport.send(raw, peers[0])
                self.wall_s = now - (hearing.begun or now)
            if hearing.look(now, bool(peers)) and self._truth is not None:
                self._truth.flush()

    def _note_latency(self, seconds: float) -> None:
        if len(self.latencies) < MAX_LATENCIES:
            self.latencies.append(seconds)
        else:
            self.latencies[self.played.frames % MAX_LATENCIES] = seconds

    def _link_event(self, kind: LinkEventKind, text: str) -> None:
        if kind is not LinkEventKind.LISTENING:
            self.notices.say(f"link {kind}", text)

    @property
    def pace(self) -> float:
        """Times real time."""
        return self.played.seconds / self.wall_s if self.wall_s > 0.0 else 0.0

    @property
    def latency_us(self) -> tuple[float, float] | None:
        """Median and 99 % of the answers' delays; None where none was given."""
        if not self.latencies:
            return None
        p50, p99 = (1e6 * np.percentile(self.latencies, (50, 99))).tolist()
        return p50, p99

    def to_dict(self) -> dict[str, Any]:
        """What was played: one of `boats` in `shadow hil --json`."""
        played, latency = self.played, self.latency_us
        paths = [] if self.recording is None else self.recording.paths
        return {
            "name": self.plan.name,
            "endpoint": self.plan.endpoint,
            "seconds": played.seconds,
            "frames": played.frames,
            "pace": self.pace,
            "restarts": played.restarts,
            "latency_us": None if latency is None else {"p50": latency[0], "p99": latency[1]},
            "counts": dict(played.counts),
            "recordings": [str(path) for path in paths],
        }

    def summary(self) -> str:
        """What was played, in one line."""
        played = self.played
        if not played.frames:
            return "no autopilot came"
        text = f"{played.seconds:.0f} s in {played.frames} frames, {self.pace:.1f} × real time"
        text += f", {played.restarts} restarts" if played.restarts else ""
        if self.latency_us is not None:
            p50, p99 = self.latency_us
            text += f", answers after {p50:.0f} µs (p99 {p99:.0f})"
        odd = ", ".join(f"{count} {kind}" for kind, count in sorted(played.counts.items()))
        return text + (f"; {odd}" if odd else "")


MAX_LATENCIES = 100_000  # the last of them are kept


def run_loops(
    plans: Sequence[LoopPlan],
    options: LoopOptions,
    progress: Progress,
    stop: Callable[[], bool],
    ready: Callable[[], None] = lambda: None,
) -> list[BoatLoop]:
    """Play until `stop` says so, the time is over, or every boat has failed."""
    with ExitStack() as scope:
        on_bus = None if options.bus is None else TruthOnBus(options.bus, scope)
        loops = [BoatLoop(plan, options, progress, scope) for plan in plans]
        waker = scope.enter_context(Waker())
        for loop in loops:
            scope.callback(loop.close)
            loop.open(waker)
        for loop in loops:
            loop.claim(scope)
        for loop in loops:
            loop.record(scope)
        ready()
        threads = [Thread(target=loop.run, name=loop.plan.name, daemon=True) for loop in loops]
        for thread in threads:
            thread.start()
        end = time.monotonic() + options.seconds
        while not stop() and time.monotonic() < end:
            for loop in loops:
                if loop.failure is not None and len(loops) > 1:
                    loop.notices.once("failed", f"it has ended: {loop.failure}")
            if not any(thread.is_alive() for thread in threads):
                break
            if on_bus is not None:
                for loop in loops:
                    on_bus.publish(loop.plan.name, loop.played.truth)
            time.sleep(min(LOOK_S, max(end - time.monotonic(), 0.0)))
        waker.wake()
        for thread in threads:
            thread.join()
    for loop in loops:
        _report(loop, progress)
    failures = [f"{loop.plan.name}: {why}" for loop in loops for why in loop.failures]
    if failures:
        cause = next((loop.failure for loop in loops if loop.failure is not None), None)
        raise ShadowError("; ".join(failures)) from cause
    return loops


def _report(loop: BoatLoop, progress: Progress) -> None:
    progress(f"{loop.plan.name}: {loop.summary()}")
    if loop.recording is not None:
        for path in loop.recording.paths:
            progress(f"{loop.plan.name}: recorded to {path}")


def run_until_stopped(
    plans: Sequence[LoopPlan], options: LoopOptions, progress: Progress
) -> list[BoatLoop]:
    """Play until SIGINT, SIGTERM or SIGHUP."""
    return run_loops(plans, options, progress, stop_on_signals().is_set)
