"""`shadow live`: links in, shadow out, everything on disk.

    receiver thread per link → inbox → one loop (estimate, step, publish) → recorder thread

The loop is driven by telemetry: a datagram that completes an estimate is shadowed and published at
once. Ticks take over while telemetry is silent. Only this loop reads the clock; what it decides
follows from datagrams and ticks, which are recorded.
"""

import signal
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from threading import Event
from typing import Any

import orjson

from gateway.bus import Bus, open_session
from gateway.config import Settings, as_tables
from gateway.errors import BadInput
from gateway.links.conversation import Address
from gateway.links.inbox import PER_LINK, Empty, Inbox
from gateway.links.items import Datagram, LinkEvent
from gateway.links.link import Link
from gateway.links.requests import Requests
from gateway.links.signing import load_key
from gateway.links.voice import Identity
from gateway.messages import Rows
from gateway.pipelines.feed import TICK_S
from gateway.pipelines.fleet import BoatPlan, Fleet
from gateway.pipelines.health import SECOND
from gateway.pipelines.live_boat import LiveBoat
from gateway.pipelines.relive import LIVE
from gateway.recorder import Recorder
from gateway.recording_file import Attachment
from gateway.recording_thread import RecordingThread
from gateway.vessel_file import dump_vessel, load_vessel
from sim.effects.effect import Effect

WAIT_S = TICK_S / 4.0  # longest sleep of the loop
OBSERVE_S = 5  # so often the rates that arrive are held against those asked for


@dataclass(frozen=True)
class LiveOptions:
    """What a user may choose about a live shadow."""

    endpoints: tuple[str, ...]
    out: Path | None
    silent: bool = False
    signing_key: Path | None = None
    settings: Settings = field(default_factory=Settings)


@dataclass
class Outlet:
    """Where one boat's messages go: its keys on zenoh and its recording, either may be absent."""

    bus: Bus | None
    recording: RecordingThread | None
    told_failure: bool = False

    def send(self, rows: Sequence[Rows]) -> None:
        """Publish, then record."""
        for part in rows:
            if self.bus is not None:
                for payload in part.payloads:
                    self.bus.publish(part.topic, payload)
        if self.recording is not None:
            self.recording.rows(rows)

    def failure(self) -> str | None:
        """Why recording stopped, told once."""
        if self.recording is None or self.recording.failure is None or self.told_failure:
            return None
        self.told_failure = True
        return self.recording.failure


class Gateway:
    """The loop and what it holds; opened with `with`, run by `run`."""

    def __init__(
        self,
        plans: Sequence[BoatPlan],
        options: LiveOptions,
        tell: Callable[[str], None] = lambda says: None,
    ) -> None:
        self.options = options
        self.fleet = Fleet(plans, options.settings, self._found)
        self.inbox = Inbox(PER_LINK * max(len(options.endpoints), 1))
        self.links: list[Link] = []
        self.outlets: dict[int, Outlet] = {}
        self._tell = tell
        self._scope = ExitStack()
        self._session: Any = None
        self._identity = None if options.silent else Identity()
        self._requests: dict[str, Requests] = {}  # by link
        self._unclaimed: list[Datagram] = []  # what was heard before any boat was known
        self._housekept_s = 0

    def __enter__(self) -> "Gateway":
        self.fleet.prepare()
        with ExitStack() as scope:
            if self.options.settings.zenoh.publish:
                self._session = scope.enter_context(open_session(self.options.settings.zenoh.bus()))
            key = None if self.options.signing_key is None else load_key(self.options.signing_key)
            for number, text in enumerate(self.options.endpoints):
                link = Link(text, self.inbox, self._identity, key, number)
                announce = link.endpoint.speaks_first or key is not None
                self._requests[link.name] = Requests(self._identity, announce=announce)
                self.links.append(scope.enter_context(link))
            self._scope = scope.pop_all()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._scope.__exit__(*exception)

    def run(self, stop: Event) -> None:
        """Shadow until `stop` is set."""
        while not stop.is_set():
            try:
                item = self.inbox.get(timeout=WAIT_S)
            except Empty:
                item = None
            if isinstance(item, Datagram):
                self._datagram(item)
            elif item is not None:
                self._link_event(item)
            self._time_goes_by(time.time_ns())

    def _datagram(self, datagram: Datagram) -> None:
        said = self.fleet.datagram(datagram)
        self._record(datagram)
        for boat, spoken in said:
            outlet = self.outlets[boat.boat.system]
            outlet.send(spoken.rows)
            if spoken.rows:
                boat.health.late_by(time.time_ns() - datagram.receive_time_ns)
        self._listen(datagram)

    def _record(self, datagram: Datagram) -> None:
        """Raw frames to the recordings they belong to; none is lost while no boat is known."""
        if not self.outlets:
            self._unclaimed.append(datagram)
            self._unclaimed = self._unclaimed[-PER_LINK:]
            return
        for system, outlet in self.outlets.items():
            if outlet.recording is not None:
                frames = self.fleet.frames_of(datagram.frames, self.fleet.boats[system])
                if frames:
                    outlet.recording.raw(datagram.link, datagram.receive_time_ns, frames)

    def _time_goes_by(self, now_ns: int) -> None:
        for boat, spoken in self.fleet.tick(now_ns):
            outlet = self.outlets[boat.boat.system]
            if outlet.recording is not None:
                outlet.recording.tick(now_ns)
            outlet.send(spoken.rows)
        if any((at := r.next_ns) is not None and now_ns >= at for r in self._requests.values()):
            self._ask(now_ns)
        if now_ns // SECOND == self._housekept_s:
            return
        self._housekept_s = now_ns // SECOND
        for system, boat in self.fleet.boats.items():
            outlet = self.outlets[system]
            backlog = outlet.recording.backlog if outlet.recording is not None else 0
            drops = outlet.recording.drops if outlet.recording is not None else 0
            outlet.send(boat.status(now_ns, backlog, drops))
            if failure := outlet.failure():
                self._say(boat, "recording_failed", "error", failure, now_ns)
        self._ask(now_ns)

    def _listen(self, datagram: Datagram) -> None:
        """What boats say that concerns our requests: who they are, their answers, a reboot."""
        now, requests = datagram.receive_time_ns, self._requests[datagram.link]
        for frame in datagram.frames:
            if frame.message is not None:
                requests = requests.take(frame.message, now)
        for boat in self.fleet.boats.values():
            if boat.rebooted():
                self._say(boat, "reboot", "warning", "the autopilot rebooted", now)
                requests = requests.rebooted(Address(*boat.address), now)
        self._requests[datagram.link] = requests

    def _ask(self, now_ns: int) -> None:
        """Requests for message rates that are due, and what came of earlier ones."""
        for link in self.links:
            requests = self._requests[link.name]
            if now_ns // SECOND % OBSERVE_S == 0:
                for boat in self.fleet.boats.values():
                    rates = boat.health.rates_hz()
                    requests = requests.observed(Address(*boat.address), rates, now_ns)
            said = requests.due(now_ns)
            self._requests[link.name] = said.requests
            for message in said.messages:
                link.say(message)
            for answer in said.answers:
                if answer.boat.system in self.fleet.boats:
                    boat = self.fleet.boats[answer.boat.system]
                    self._tell(answer.says)
                    self._say(boat, "rate_request", "info", answer.says, now_ns)

    def _link_event(self, event: LinkEvent) -> None:
        kind = f"link_{event.kind}"
        severity = "info" if event.kind in ("listening", "connected") else "warning"
        self._tell(f"{event.link}: {event.says}")
        for boat in self.fleet.boats.values():
            says = f"{event.link}: {event.says}"
            self._say(boat, kind, severity, says, event.receive_time_ns)

    def _say(self, boat: LiveBoat, kind: str, severity: str, says: str, now_ns: int) -> None:
        if severity != "info":
            self._tell(f"{boat.name}: {says}")
        self.outlets[boat.boat.system].send(boat.say(kind, severity, says, now_ns))

    def _found(self, boat: LiveBoat, plan: BoatPlan) -> None:
        """A boat spoke for the first time: give it its keys and its recording."""
        vessel = dump_vessel(plan.vessel).encode()
        bus = None
        if self._session is not None:
            bus = self._scope.enter_context(
                Bus(boat.name, model=vessel, status=lambda: _status(boat), session=self._session)
            )
        recording = self._recording(boat, vessel) if self.options.out is not None else None
        self.outlets[boat.boat.system] = Outlet(bus, recording)
        self._tell(f"{boat.boat}: shadowed as {boat.name}")
        for datagram in self._unclaimed:
            if recording is not None:
                frames = [frame.raw for frame in datagram.frames]
                recording.raw(datagram.link, datagram.receive_time_ns, frames)
        self._unclaimed.clear()

    def _recording(self, boat: LiveBoat, vessel: bytes) -> RecordingThread:
        assert self.options.out is not None
        stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        config = orjson.dumps(as_tables(self.options.settings), option=orjson.OPT_INDENT_2)
        recorder = Recorder(
            self.options.out / f"{boat.name}-{stamp}.mcap",
            attachments=[
                Attachment("vessel.toml", "application/toml", vessel),
                Attachment("config.json", "application/json", config),
            ],
            metadata={
                "shadow": {
                    "gateway": version("shadow-gateway"), "vessel": boat.name,
                    "boat": str(boat.boat), "system": str(boat.boat.system), LIVE: "yes",
                }
            },
            settings=self.options.settings.recording,
            live=True,
        )  # fmt: skip
        recording = self._scope.enter_context(RecordingThread(recorder))
        self._tell(f"recording: {recorder.paths[-1]}")
        return recording


def _status(boat: LiveBoat) -> bytes:
    """What the queryable `status` answers."""
    return orjson.dumps({"name": boat.name, "boat": str(boat.boat), "system": boat.boat.system})


def plans_of(
    vessels: Sequence[str], plant: Path | None, name: str | None, effects: Sequence[Effect]
) -> list[BoatPlan]:
    """What `--vessel FILE` and `--vessel SYSID=FILE` say -> which vessel shadows which boat."""
    own = None if plant is None else load_vessel(plant, effects)
    plans = []
    for text in vessels:
        number, _, file = text.rpartition("=")
        if number and not (number.isdigit() and 1 <= int(number) <= 254):
            raise BadInput(f"--vessel {text}: expected FILE or SYSID=FILE, SYSID 1 to 254")
        system = int(number) if number else None
        key = name if name is None or len(vessels) == 1 else f"{name}-{number or 'any'}"
        plans.append(BoatPlan(load_vessel(file, effects), own, system, key))
    systems = [plan.system for plan in plans]
    if len(set(systems)) < len(systems):
        raise BadInput("--vessel: two vessels for one boat; give SYSID=FILE for each boat")
    return plans


def run_until_stopped(
    plans: Sequence[BoatPlan], options: LiveOptions, tell: Callable[[str], None]
) -> None:
    """Run until SIGINT or SIGTERM; then everything is finished cleanly."""
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with Gateway(plans, options, tell) as gateway:
        tell(f"listening on {', '.join(options.endpoints)}; Ctrl-C ends")
        gateway.run(stop)
    tell("finished")
