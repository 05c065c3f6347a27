"""All that leaves a live gateway: outputs of its boats, metrics, and requests to the boats.

**Outputs** of one boat: zenoh, its recording, players; each may be absent.

**Metrics** for Prometheus: what the health topic says, and the links' counts.

    shadow_health_<field>{vessel}     every number of the newest health message
    shadow_health_age_seconds{vessel} how old that message is
    shadow_unfit{vessel}              1 where the boat's data cannot judge its model
    shadow_link_<count>_total{link}   datagrams, bytes, frames, … of a link since the start
    shadow_faults_total               defects of the gateway

The loop only hands over the newest payload; the HTTP server of prometheus_client runs on threads of
its own and decodes when it is asked.

**Requests** for rates and parameters on all links: nothing else is ever sent to a boat. Only boats
that are shadowed are asked. Times are those of a clock that never steps.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread
from typing import Any, Self

import orjson

from gateway.bus import Bus
from gateway.config import Settings, as_tables
from gateway.errors import BadInput, ShadowError
from gateway.json_rows import TopicRows
from gateway.links import Datagram, Frame
from gateway.links.link import Link
from gateway.links.rate_requests import Address, LinkRequests, RequestOutcome
from gateway.links.transmitter import Identity
from gateway.live.boats import BoatPlan, LiveBoat
from gateway.recording.foxglove_server import BoatView, on_this_machine, parse_address
from gateway.recording.recorder import TICK_LINK, Recorder
from gateway.recording.thread import RecordingThread
from gateway.shadow.health import SECOND
from gateway.shadow.topic_rows import attachments_of, metadata_of
from gateway.topics import TIMES, TOPICS, FieldType

MAX_WAITING, MAX_WAITING_BYTES = 60_000, 64_000_000  # datagrams that no recording takes yet


STUCK_S = 3.0  # without a write, though the thread writes four times a second
FIRST_RETRY_S, LAST_RETRY_S = 2.0, 120.0  # from a failed recording to the next
PROOF_S = 1.5  # that the next one must last to be told
LASTED_S = 60.0  # after which a failure is another matter


class WaitingDatagrams:
    """Datagrams from before any boat was known, or before its recording could begin: kept for that,
    within bounds.
    """

    def __init__(self) -> None:
        self._datagrams: deque[Datagram] = deque()
        self._bytes = 0

    def add(self, datagram: Datagram) -> None:
        """Keep one; the oldest go where there is no room."""
        self._datagrams.append(datagram)
        self._bytes += _bytes(datagram)
        while len(self._datagrams) > MAX_WAITING or self._bytes > MAX_WAITING_BYTES:
            self._bytes -= _bytes(self._datagrams.popleft())

    def take_all(self) -> Iterator[Datagram]:
        """All that are kept, in order; then none."""
        while self._datagrams:
            yield self._datagrams.popleft()
        self._bytes = 0


@dataclass
class BoatOutputs:
    """Publishes and records; a recording that fails is reported once and leaves the rest alone."""

    bus: Bus | None = None
    recording: RecordingThread | None = None
    view: BoatView | None = None  # for Foxglove and its kin
    failure: str | None = None  # of a recording that could not begin
    retry_s: float | None = None  # when recording is tried again, after a failure
    failures: int = 0  # in a row
    _reported: bool = False
    _begun_s: float = 0.0  # when the recording began that followed one that failed
    _earlier_drops: int = 0  # of recordings that failed
    _earlier_paths: tuple[Path, ...] = ()  # of the same
    _stuck: bool = False
    _waiting: WaitingDatagrams = field(default_factory=WaitingDatagrams)

    def publish(self, rows: Sequence[TopicRows]) -> None:
        """To zenoh."""
        if self.bus is not None:
            self.bus.publish_rows(rows)

    def record(self, rows: Sequence[TopicRows]) -> None:
        """To disk."""
        if self.recording is not None:
            self.recording.rows(rows)

    def show(self, rows: Sequence[TopicRows]) -> None:
        """To players."""
        if self.view is not None:
            self.view.show(rows)

    def send(self, rows: Sequence[TopicRows]) -> None:
        """To all of them."""
        self.publish(rows)
        self.record(rows)
        self.show(rows)

    def record_frames(self, link: str, receive_time_ns: int, frames: Sequence[bytes]) -> None:
        """Frames as they came, to disk; kept for the next one where a recording could not begin."""
        if self.recording is not None and frames:
            self.recording.raw(link, receive_time_ns, frames)
        elif self.failure is not None and frames:
            kept = tuple(Frame(raw, None) for raw in frames)
            self._waiting.add(Datagram(link, receive_time_ns, kept))

    def record_tick(self, now_ns: int) -> None:
        """A moment at which the loop ran on without telemetry: part of its inputs."""
        self.record_frames(TICK_LINK, now_ns, (b"",))

    @property
    def backlog(self) -> int:
        """Messages that wait to be recorded."""
        return self.recording.backlog if self.recording is not None else 0

    @property
    def drops(self) -> int:
        """Messages that were not recorded though they should have been."""
        now = self.recording.drops if self.recording is not None else 0
        return self._earlier_drops + now

    @property
    def paths(self) -> tuple[Path, ...]:
        """All recordings that are there, in order."""
        now = self.recording.paths if self.recording is not None else ()
        return tuple(path for path in (*self._earlier_paths, *now) if path.exists())

    def wants_retry(self, now_s: float) -> bool:
        """Is it time to begin another recording, after one that failed?"""
        failed = self.failure or (self.recording is not None and self.recording.failure)
        if not failed:
            return False
        if self.retry_s is None:
            if now_s - self._begun_s > LASTED_S:
                self.failures = 0
            self.retry_s = now_s + min(FIRST_RETRY_S * 2.0**self.failures, LAST_RETRY_S)
        return now_s >= self.retry_s

    def record_with(self, recording: RecordingThread, now_s: float) -> None:
        """Another recording instead of one that failed or could not begin."""
        if self.recording is not None:
            self._earlier_drops += self.recording.drops
            self._earlier_paths += self.recording.paths
            self.recording.leave()
        self.recording, self.failure, self.retry_s = recording, None, None
        self.failures += 1
        self._begun_s = now_s
        for link, receive_time_ns, frames in self._waiting.take_all():
            recording.raw(link, receive_time_ns, [frame.raw for frame in frames])

    def new_recovery(self, now_s: float) -> str | None:
        """Where it is recorded again, once that has lasted for a moment."""
        recording = self.recording
        if not self._reported or recording is None or recording.failure or self.failure:
            return None
        if now_s - self._begun_s < PROOF_S:
            return None
        self._reported = False
        return f"recording again: {recording.paths[-1]}"

    def new_stall(self) -> str | None:
        """That the disk does not take anything any more, or does so again, once each."""
        if self.recording is None or self.recording.failure is not None:
            return None
        stuck_s = self.recording.stuck_s
        if stuck_s > STUCK_S and not self._stuck:
            self._stuck = True
            return f"the disk has taken nothing for {stuck_s:.0f} s: what comes waits in memory"
        if stuck_s <= STUCK_S and self._stuck:
            self._stuck = False
            return "the disk takes what is recorded again"
        return None

    def new_failure(self) -> str | None:
        """Why recording failed, once."""
        failure = self.failure or (self.recording.failure if self.recording is not None else None)
        if failure is None or self._reported:
            return None
        self._reported = True
        return failure


def make_folder(folder: Path) -> None:
    """BadInput at the start rather than when the first boat is found."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"--out {folder}: cannot record there: {error.strerror}: choose another folder"
        ) from None


def start_recording(
    boat: LiveBoat, plan: BoatPlan, folder: Path, settings: Settings, scope: ExitStack
) -> RecordingThread:
    """A recording of that boat, open until `scope` closes; ShadowError where it cannot begin."""
    path = unused_path(folder, f"{boat.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}")
    recorder = Recorder(
        path,
        attachments=attachments_of(plan.vessel, plan.plant, as_tables(settings)),
        metadata=metadata_of(boat.name, boat.boat, plant=plan.plant, live=True),
        settings=settings.recording,
        live=True,
    )
    try:
        return scope.enter_context(RecordingThread(recorder))
    except ShadowError:
        with suppress(OSError):
            path.unlink(missing_ok=True)  # nothing but an empty beginning
        raise


def unused_path(folder: Path, stem: str) -> Path:
    """A path in the folder that no recording has, nor any part of one that rotates."""
    for number in range(1, 1000):
        path = folder / (f"{stem}.mcap" if number == 1 else f"{stem}_{number}.mcap")
        if not path.exists():
            return path
    raise ShadowError(f"{folder / stem}.mcap: there are too many of that name")


def _bytes(datagram: Datagram) -> int:
    return sum(len(frame.raw) for frame in datagram.frames)


HEALTH = [f for f in TOPICS["health"].fields if f.type is not FieldType.STRING]
assert not {f.name for f in HEALTH} & {f.name for f in TIMES}

Counts = Callable[[], Mapping[str, Mapping[str, Any]]]  # link -> count -> value


class Metrics:
    """A server of metrics at [HOST:]PORT while it is open; `health` gives it something to say."""

    def __init__(self, address: str, links: Counts, faults: Callable[[], int]) -> None:
        self.host, self._port = parse_address(address, "metrics")
        self._address, self._links, self._faults = address, links, faults
        self._newest: dict[str, tuple[bytes, float]] = {}
        self._server: Any = None
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        try:
            import prometheus_client
        except ImportError:
            raise BadInput(
                "--metrics needs prometheus_client: pip install 'shadow-gateway[metrics]'"
            ) from None
        registry = prometheus_client.CollectorRegistry()
        registry.register(self)  # type: ignore[arg-type]
        try:
            self._server, self._thread = prometheus_client.start_http_server(
                self._port, self.host, registry
            )
        except OSError as error:
            raise ShadowError(
                f"--metrics {self._address}: cannot listen there: {error.strerror}: is another "
                "program using the port?"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._server.server_close()
            self._thread.join()

    @property
    def port(self) -> int:
        """Where it listens, also where any free port was asked for."""
        return int(self._server.server_address[1])

    @property
    def text(self) -> str:
        """Where it is, and who reaches it."""
        who = "this machine" if on_this_machine(self.host) else "everyone who reaches this machine"
        return f"metrics on http://{self.host}:{self.port}/metrics, for {who}"

    def health(self, vessel: str, payload: bytes) -> None:
        """The newest health message of a boat."""
        self._newest[vessel] = payload, time.monotonic()

    def describe(self) -> list[Any]:
        """Nothing in advance: names follow from what there is."""
        return []

    def collect(self) -> Iterator[Any]:
        """All metrics as they are now."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        rows = {
            vessel: (orjson.loads(payload), time.monotonic() - at)
            for vessel, (payload, at) in list(self._newest.items())
        }
        for number in HEALTH:
            name = f"shadow_health_{number.name}"
            gauge = GaugeMetricFamily(name, number.description, labels=["vessel"])
            for vessel, (row, _) in rows.items():
                gauge.add_metric([vessel], float(row[number.name]))
            yield gauge
        age = GaugeMetricFamily("shadow_health_age_seconds", "Age of that", labels=["vessel"])
        unfit = GaugeMetricFamily(
            "shadow_unfit", "1 where the boat's data cannot judge its model", labels=["vessel"]
        )
        for vessel, (row, seconds) in rows.items():
            age.add_metric([vessel], seconds)
            unfit.add_metric([vessel], float(bool(row["unfit"])))
        yield age
        yield unfit
        links = self._links()
        for count in sorted({count for counts in links.values() for count in counts}):
            counter = CounterMetricFamily(
                f"shadow_link_{count}", f"{count} of a link", labels=["link"]
            )
            for link, counts in links.items():
                counter.add_metric([link], float(counts[count]))
            yield counter
        yield CounterMetricFamily("shadow_faults", "Defects of the gateway", value=self._faults())


ANSWERS = frozenset({"HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE"})  # that tell of a request
OBSERVE_NS = 5 * SECOND  # so often the rates that arrive are compared with those requested


class RateRequests:
    """The requests of all links."""

    def __init__(
        self, links: Iterable[Link], identity: Identity | None, rates_hz: Mapping[str, float]
    ) -> None:
        self._links = {link.name: link for link in links}
        self._requests = {
            name: LinkRequests(identity, rates_hz, link.announces)
            for name, link in self._links.items()
        }
        self._observed_ns = 0
        self._reboots: dict[int, int] = {}  # by system

    def take(self, datagram: Datagram, boats: Mapping[int, LiveBoat], now_ns: int) -> None:
        """Heartbeats and answers of boats (by system), and reboots that they show."""
        if datagram.link not in self._requests:
            return
        for frame in datagram.frames:
            m = frame.message
            if m is None or m.get_type() not in ANSWERS:
                continue
            boat = boats.get(m.get_srcSystem())
            if boat is not None and boat.boat.component == m.get_srcComponent():
                self._restart_if_rebooted(boat, now_ns)
                requests = self._requests[datagram.link]
                self._requests[datagram.link] = requests.take(m, now_ns)

    def _restart_if_rebooted(self, boat: LiveBoat, now_ns: int) -> None:
        """A boat that rebooted has forgotten what it had accepted."""
        if boat.reboots == self._reboots.get(boat.boat.system, 0):
            return
        self._reboots[boat.boat.system] = boat.reboots
        for name, requests in self._requests.items():
            self._requests[name] = requests.rebooted(Address(*boat.address), now_ns)

    def due(self, boats: Iterable[LiveBoat], now_ns: int) -> list[RequestOutcome]:
        """Send what is to be sent by now -> the outcomes of earlier requests."""
        if now_ns - self._observed_ns >= OBSERVE_NS:
            self._observed_ns = now_ns
            self._observe(boats, now_ns)
        outcomes: list[RequestOutcome] = []
        for name, requests in self._requests.items():
            if (at := requests.next_ns) is not None and now_ns >= at:
                due = requests.due(now_ns)
                self._requests[name] = due.requests
                outcomes += due.outcomes
                for message in due.messages:
                    self._links[name].send_message(message)
        return outcomes

    def _observe(self, boats: Iterable[LiveBoat], now_ns: int) -> None:
        for boat in boats:
            rates = boat.health.rates_hz()
            for name, requests in self._requests.items():
                self._requests[name] = requests.observed(Address(*boat.address), rates, now_ns)
