"""`shadow live`: links in, shadow out, everything on disk.

    receiver thread per link → inbox → one loop (estimate, step, publish) → recorder thread

The loop is driven by telemetry: a datagram that completes an estimate is shadowed and published at
once. Ticks take over while telemetry is silent. Only this loop reads the clock; what it decides
follows from datagrams and ticks, which are recorded.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty
from threading import Event
from typing import Any

import orjson

from gateway.bus import Bus, open_session
from gateway.config import Settings
from gateway.errors import BadInput, ShadowError
from gateway.ingest.log import Boat
from gateway.links.inbox import PER_LINK, Datagram, Inbox, Item, LinkEvent
from gateway.links.link import Link
from gateway.links.signing import load_key
from gateway.links.transmitter import Identity
from gateway.live.boat import LiveBoat
from gateway.live.boats import BoatPlan, Fleet
from gateway.live.outputs import Outlet, Unclaimed, start_recording
from gateway.live.rate_requests import RateRequests
from gateway.recording.foxglove_server import FoxgloveServer
from gateway.shadow.health import SECOND
from gateway.shadow.inputs import TICK_S
from gateway.vessel_file import dump_vessel

WAIT_S = TICK_S / 4.0  # longest sleep of the loop
QUIET_NS = 10 * SECOND  # between two reports of the same trouble

Clock = Callable[[], int]


@dataclass(frozen=True)
class LiveOptions:
    """What a user may choose about a live shadow."""

    endpoints: tuple[str, ...]
    out: Path | None
    silent: bool = False
    signing_key: Path | None = None
    settings: Settings = field(default_factory=Settings)


class Gateway:
    """The loop and what it holds; opened with `with`, run by `run`.

    strict  a defect ends the loop instead of being told and counted: for tests
    """

    def __init__(
        self,
        plans: Sequence[BoatPlan],
        options: LiveOptions,
        tell: Callable[[str], None] = lambda says: None,
        *,
        clock: Clock = time.time_ns,
        steady: Clock = time.monotonic_ns,
        strict: bool = False,
    ) -> None:
        self.options = options
        self.fleet = Fleet(plans, options.settings, self._found, self._ignored)
        self.inbox = Inbox(PER_LINK * max(len(options.endpoints), 1))
        self.links: list[Link] = []
        self.outlets: dict[int, Outlet] = {}
        self.faults = 0
        self._tell, self._clock, self._steady, self._strict = tell, clock, steady, strict
        self._scope = ExitStack()
        self._session: Any = None
        self._foxglove: FoxgloveServer | None = None
        self._leading = plans[0] if plans else None  # its boat has the topics of a recording
        self._unclaimed = Unclaimed()
        self._dropped = 0
        self._housekept_s = 0
        self._fault_ns = -QUIET_NS

    def __enter__(self) -> "Gateway":
        self.fleet.prepare()
        options = self.options
        if options.out is not None:
            _writable(options.out)
        with ExitStack() as scope:
            if options.settings.zenoh.publish:
                self._session = scope.enter_context(open_session(options.settings.zenoh.bus()))
            if options.settings.foxglove.address is not None:
                self._foxglove = scope.enter_context(
                    FoxgloveServer(
                        options.settings.foxglove.address, options.settings.recording.foxglove_hz
                    )
                )
                self._tell(self._foxglove.says)
            key = None if options.signing_key is None else load_key(options.signing_key)
            identity = None if options.silent else Identity()
            for number, text in enumerate(options.endpoints):
                link = Link(text, self.inbox, identity, key, number)
                self.links.append(scope.enter_context(link))
            self._asking = RateRequests(self.links, identity, options.settings.links.rates)
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
            self.turn(item)

    def turn(self, item: Item | None) -> None:
        """One round of the loop: what came, if anything, and what is due."""
        try:
            if isinstance(item, Datagram):
                self._datagram(item)
            elif item is not None:
                self._link_event(item)
            self._time_goes_by(self._clock())
        except Exception as error:  # the outermost loop: a defect must not end the shadow
            if self._strict:
                raise
            self._fault(error)

    def _datagram(self, datagram: Datagram) -> None:
        """Publish as it is made; all else can wait until then."""
        said = []
        for boat, spoken in self.fleet.datagram(datagram):
            if spoken.rows:
                self.outlets[boat.boat.system].publish(spoken.rows)
                said.append((boat, spoken.rows))
        late_ns = self._clock() - datagram.receive_time_ns
        for boat in {boat.boat.system: boat for boat, _ in said}.values():
            boat.health.late_by(late_ns)
        self._keep(datagram)
        for boat, rows in said:
            self.outlets[boat.boat.system].record(rows)
            self.outlets[boat.boat.system].show(rows)
        self._asking.listen(datagram, self.fleet.boats.values(), self._steady())

    def _keep(self, datagram: Datagram) -> None:
        """Raw frames to the recordings they belong to; none is lost while no boat is known."""
        if not self.outlets:
            self._unclaimed.keep(datagram)
        for system, outlet in self.outlets.items():
            frames = self.fleet.frames_of(datagram.frames, self.fleet.boats[system])
            outlet.raw(datagram.link, datagram.receive_time_ns, frames)

    def _time_goes_by(self, now_ns: int) -> None:
        for boat in self.fleet.due(now_ns):
            outlet = self.outlets[boat.boat.system]
            if outlet.recording is not None:
                outlet.recording.tick(now_ns)
            for spoken in boat.tick(now_ns):
                outlet.send(spoken.rows)
        for answer in self._asking.due(self.fleet.boats.values(), self._steady()):
            self._tell(answer.text)
            self._say(self.fleet.boats[answer.boat.system], "rate_request", "info", answer.text)
        if now_ns // SECOND != self._housekept_s:
            self._housekept_s = now_ns // SECOND
            self._housekeep(now_ns)

    def _housekeep(self, now_ns: int) -> None:
        """Once a second: health, and what went wrong beside the path."""
        dropped = sum(link.counts().dropped for link in self.links)
        for system, boat in self.fleet.boats.items():
            outlet = self.outlets[system]
            outlet.send(boat.status(now_ns, outlet.backlog, outlet.drops))
            if failure := outlet.news():
                self._say(boat, "recording_failed", "error", failure)
            if dropped > self._dropped:
                says = f"{dropped - self._dropped} datagrams dropped: more came than can be handled"
                self._say(boat, "overload", "error", says)
        self._dropped = dropped

    def _link_event(self, event: LinkEvent) -> None:
        severity = "info" if event.kind in ("listening", "connected") else "warning"
        says = f"{event.link}: {event.text}"
        self._tell(says)
        for boat in self.fleet.boats.values():
            rows = boat.say(f"link_{event.kind}", severity, says, event.receive_time_ns)
            self.outlets[boat.boat.system].send(rows)

    def _say(self, boat: LiveBoat, kind: str, severity: str, says: str) -> None:
        if severity != "info":
            self._tell(f"{boat.name}: {says}")
        self.outlets[boat.boat.system].send(boat.say(kind, severity, says, self._clock()))

    def _fault(self, error: Exception) -> None:
        """Counted always, told seldom."""
        self.faults += 1
        if self._steady() - self._fault_ns >= QUIET_NS:
            self._fault_ns = self._steady()
            says = f"defect of the gateway, {self.faults} so far: {error!r}"
            self._tell(says)
            for boat in self.fleet.boats.values():
                self.outlets[boat.boat.system].send(boat.say("fault", "error", says, self._clock()))

    def _found(self, boat: LiveBoat, plan: BoatPlan) -> None:
        """A boat spoke for the first time: give it its keys and its recording."""
        outlet = self.outlets[boat.boat.system] = Outlet()
        self._tell(f"{boat.boat}: shadowed as {boat.name}")
        if self._session is not None:
            model, status = dump_vessel(plan.vessel).encode(), self._status(boat)
            bus = Bus(boat.name, model=model, status=status, session=self._session)
            outlet.bus = self._scope.enter_context(bus)
        if self._foxglove is not None:
            outlet.view = self._foxglove.boat(boat.name, leading=plan is self._leading)
        if self.options.out is not None:
            folder, settings = self.options.out, self.options.settings
            try:
                recording = start_recording(boat, plan, folder, settings, self._scope)
            except ShadowError as error:
                outlet.failure = str(error)
                return
            outlet.recording = recording
            self._tell(f"recording: {recording.paths[-1]}")
        for datagram in self._unclaimed.claimed():
            frames = [frame.raw for frame in datagram.frames]
            outlet.raw(datagram.link, datagram.receive_time_ns, frames)

    def _ignored(self, boat: Boat) -> None:
        self._tell(f"{boat}: ignored, no vessel is given for it; --vessel {boat.system}=FILE does")

    def _status(self, boat: LiveBoat) -> Callable[[], bytes]:
        """What the queryable `status` answers, on a thread of zenoh."""

        def status() -> bytes:
            links = {link.name: vars(link.counts()) for link in self.links}
            about = {"name": boat.name, "boat": str(boat.boat), "system": boat.boat.system}
            return orjson.dumps({**about, "links": links, "faults": self.faults})

        return status


def _writable(folder: Path) -> None:
    """Said at the start rather than when the first boat is heard."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"--out {folder}: cannot record there: {error.strerror}: choose another folder"
        ) from None
