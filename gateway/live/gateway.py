"""`shadow live`: links in, shadows out, everything recorded.

    receiver thread per link → inbox → one loop (estimate, step, publish) → recorder thread

The loop is driven by telemetry: a datagram that completes an estimate is shadowed and published at
once. Ticks take over while telemetry is silent; what waits in the inbox is no silence. Only this
loop reads the clock; what it decides follows from datagrams and ticks, which are recorded.

`shadow live` as a program, with a clean end.
"""

import gc
import sys
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
from gateway.errors import ShadowError
from gateway.ingest.log import Boat
from gateway.json_rows import TopicRows
from gateway.links import PER_LINK, Datagram, Inbox, Item, LinkEvent
from gateway.links.link import Link, opening
from gateway.links.transmitter import Identity, load_key
from gateway.live.boats import MAX_LISTED, BoatOutput, BoatPlan, Fleet, LiveBoat
from gateway.live.outputs import (
    FIRST_RETRY_S,
    BoatOutputs,
    Metrics,
    RateRequests,
    WaitingDatagrams,
    make_folder,
    start_recording,
)
from gateway.long_running import LogLine, Stop, stop_on_signals
from gateway.recording.foxglove_server import FoxgloveServer
from gateway.shadow import TICK_S
from gateway.shadow.health import SECOND
from gateway.shadow.topic_rows import EventRow, event_rows
from gateway.vessel_file import dump_vessel
from sim.state import Progress

MAX_SLEEP_S = TICK_S / 4.0  # of the loop
LOOK_NS = SECOND // 100  # between two looks for boats that have fallen silent
REPORT_INTERVAL_NS = 10 * SECOND  # between two reports of defects
TOGETHER = 64  # datagrams that wait and are handled in one go, before all else that is due
BEHIND_NS, CURRENT_NS = 2 * SECOND, SECOND // 4  # what waits so long is told; so short is current
CURRENT = ("overload_over", "warning", "what is shown is current again")

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

    strict  a defect ends the loop instead of being reported and counted: for tests
    """

    def __init__(
        self,
        plans: Sequence[BoatPlan],
        options: LiveOptions,
        progress: Progress = lambda text: None,
        *,
        clock: Clock = time.time_ns,
        steady: Clock = time.monotonic_ns,
        strict: bool = False,
    ) -> None:
        self.options = options
        self.fleet = Fleet(plans, options.settings, self._add_boat, self._report_ignored)
        self.inbox = Inbox(PER_LINK * max(len(options.endpoints), 1))
        self.links: list[Link] = []
        self.outputs: dict[int, BoatOutputs] = {}  # by system
        self.faults = 0
        self._boat_plans: dict[int, BoatPlan] = {}
        self._progress, self._clock, self._steady, self._strict = progress, clock, steady, strict
        self._scope = ExitStack()
        self._session: Any = None
        self._foxglove: FoxgloveServer | None = None
        self._metrics: Metrics | None = None
        self._leading = plans[0] if plans else None  # its boat has the topics of a recording
        self._early = WaitingDatagrams()
        self._dropped = self._newly_dropped = 0
        self._unchecked: list[LiveBoat] = []  # whose check of this second is still to come
        self._ticked_ns = 0
        self._unjudged: dict[int, LiveBoat] = {}  # by system: rows wait for their model
        self._ignored = 0  # boats without a vessel
        self._checked_s = 0
        self._behind = False  # datagrams wait longer than BEHIND_NS
        self._fault_ns = -REPORT_INTERVAL_NS

    def __enter__(self) -> "Gateway":
        self.fleet.warm_up()
        options = self.options
        if options.out is not None:
            make_folder(options.out)
        with ExitStack() as scope:
            if options.settings.zenoh.publish:
                self._session = scope.enter_context(open_session(options.settings.zenoh.bus()))
            if options.settings.foxglove.address is not None:
                self._foxglove = scope.enter_context(
                    FoxgloveServer(
                        options.settings.foxglove.address,
                        options.settings.recording.foxglove_hz,
                        options.settings.foxglove.origins,
                        self._progress,
                    )
                )
                self._progress(self._foxglove.text)
            if options.settings.metrics.address is not None:
                self._metrics = scope.enter_context(
                    Metrics(
                        options.settings.metrics.address,
                        lambda: {link.name: vars(link.counts()) for link in self.links},
                        lambda: self.faults,
                    )
                )
                self._progress(self._metrics.text)
            key = None if options.signing_key is None else load_key(options.signing_key)
            identity = None if options.silent else Identity()
            for number, text in enumerate(options.endpoints):
                link = Link(text, self.inbox, identity, key, number)
                self.links.append(scope.enter_context(link))
            self._rate_requests = RateRequests(self.links, identity, options.settings.links.rates)
            self._scope = scope.pop_all()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._scope.__exit__(*exception)

    def run(self, stop: Stop | Event) -> None:
        """Shadow until `stop` is set."""
        while not stop.is_set():
            try:
                item = self.inbox.get(timeout=MAX_SLEEP_S)
            except Empty:
                item = None
            self.turn(item)
        self.catch_up()

    def unfinished(self) -> list[str]:
        """Why recordings could not be written to their ends, once they are closed."""
        boats = self.fleet.boats
        failures = {boats[n].name: out.new_failure() for n, out in self.outputs.items()}
        return [f"{name}: {failure}" for name, failure in failures.items() if failure]

    def left(self) -> list[LogLine]:
        """Once recordings are closed: where they are, and what stands of each model."""
        lines = list[LogLine]()
        for number, outputs in self.outputs.items():
            boat = self.fleet.boats[number]
            lines += [LogLine(f"recorded: {path}", vessel=boat.name) for path in outputs.paths]
            if (last := boat.verdict) is not None:
                text = f"{boat.name}, at the end: {last.text}"
                lines.append(LogLine(text, last.severity, last.kind, boat.name))
        return lines

    def catch_up(self) -> None:
        """Hold all rows that still wait for it against their models."""
        while self._unjudged:
            self._guarded(self._judge)

    def turn(self, item: Item | None) -> None:
        """One round of the loop: an item, if one came, and what is due."""
        self._guarded(self._turn, item)

    def _turn(self, item: Item | None) -> None:
        oldest = item
        if isinstance(item, Datagram):
            datagrams, item = self._waiting(item)
            self._guarded(self._datagrams, datagrams)
        if isinstance(item, LinkEvent):
            self._link_event(item)
        now_ns = self._clock()
        self._note_delay(max(now_ns - oldest.receive_time_ns, 0) if oldest is not None else 0)
        behind = item is not None and len(self.inbox) > 0
        self._run_due(max(now_ns - item.receive_time_ns, 0) if behind and item else 0)
        if self._unjudged and not len(self.inbox):
            self._judge()

    def _guarded(self, work: Callable[..., None], *given: Any) -> None:
        """Around all that the loop does: a defect is told, and does not end the shadow."""
        try:
            work(*given)
        except Exception as error:  # the outermost loop
            if self._strict:
                raise
            self._fault(error)

    def _waiting(self, first: Datagram) -> tuple[list[Datagram], Item]:
        """A datagram and those that wait behind it, and the last item that was taken for that."""
        datagrams = [first]
        while len(self.inbox) and len(datagrams) < TOGETHER:
            item = self.inbox.get(timeout=0)
            if not isinstance(item, Datagram):
                return datagrams, item
            datagrams.append(item)
        return datagrams, datagrams[-1]

    def _datagrams(self, datagrams: Sequence[Datagram]) -> None:
        """Publish as it is made; all else can wait until then. Frames are recorded in any case."""
        published = list[tuple[LiveBoat, list[TopicRows]]]()
        try:
            for boat, messages in self.fleet.received(datagrams):
                self._guarded(self._publish, boat, messages, published)
        finally:
            for datagram in datagrams:
                self._record_frames(datagram)
            for boat, rows in published:
                self.outputs[boat.boat.system].record(rows)
                self.outputs[boat.boat.system].show(rows)
        for datagram in datagrams:
            self._rate_requests.take(datagram, self.fleet.boats, self._steady())

    def _publish(
        self,
        boat: LiveBoat,
        messages: Sequence[tuple[Any, int]],
        published: list[tuple[LiveBoat, list[TopicRows]]],
    ) -> None:
        """What comes of a boat's messages goes out, and is added to what was published."""
        told, first_ns = list[LogLine](), None
        for output in boat.datagrams(messages):
            if output.rows:
                self.outputs[boat.boat.system].publish(output.rows)
                published.append((boat, output.rows))
            if output.out is not None and len(output.out):
                self._unjudged[boat.boat.system] = boat
                if first_ns is None:
                    first_ns = int(output.out.receive_time_ns[0])
            told += [_line(boat, event) for event in output.events]
        if first_ns is not None:
            boat.health.late_by(self._clock() - first_ns)
        for text in told:
            self._progress(text)

    def _record_frames(self, datagram: Datagram) -> None:
        """Raw frames to the recordings they belong to; none is lost while no boat is known."""
        if not self.outputs:
            self._early.add(datagram)
            return
        for link, receive_time_ns, heard in (*self._early.take_all(), datagram):
            for system, frames in self.fleet.recorded(heard).items():
                self.outputs[system].record_frames(link, receive_time_ns, frames)

    def _note_delay(self, waited_ns: int) -> None:
        """Events when what was handled had waited for long, and when it no longer does."""
        if self._behind is (waited_ns > (CURRENT_NS if self._behind else BEHIND_NS)):
            return
        self._behind = not self._behind
        text = f"this machine is too slow: what is shown is {waited_ns / SECOND:.0f} s old"
        event = ("overload", "error", text)
        for boat in self.fleet.boats.values():
            self._send_event(boat, *(event if self._behind else CURRENT))

    def _run_due(self, behind_ns: int) -> None:
        """Ticks, rate requests, and the checks of each second: due by what has been heard.

        One boat is checked a turn: all of them at one moment would hold every datagram up.
        """
        now_ns, steady_ns = self._clock() - behind_ns, self._steady() - behind_ns
        if not 0 <= now_ns - self._ticked_ns < LOOK_NS:
            self._ticked_ns = now_ns
            self._tick(now_ns)
        for outcome in self._rate_requests.due(self.fleet.boats.values(), steady_ns):
            self._progress(outcome.text)
            boat = self.fleet.boats[outcome.boat.system]
            self._send_event(boat, "rate_request", "info", outcome.text)
        if now_ns // SECOND != self._checked_s and not self._unchecked:
            self._checked_s = now_ns // SECOND
            self._unchecked = list(self.fleet.boats.values())
            self._newly_dropped = self._count_drops()
        if self._unchecked:
            self._check(self._unchecked.pop(), now_ns)

    def _tick(self, now_ns: int) -> None:
        """The shadows of silent boats run on."""
        for boat in self.fleet.due(now_ns):
            self.outputs[boat.boat.system].record_tick(now_ns)
            for output in boat.tick(now_ns):
                self._send(boat, output)
            self._unjudged[boat.boat.system] = boat

    def _judge(self) -> None:
        """The rows of the boat that has waited longest for it, held against its model."""
        boat = self._unjudged.pop(next(iter(self._unjudged)))
        output = boat.judge()
        if output.rows:
            self._send(boat, output)

    def _send(self, boat: LiveBoat, output: BoatOutput) -> None:
        self.outputs[boat.boat.system].send(output.rows)
        for event in output.events:
            self._progress(_line(boat, event))

    def _count_drops(self) -> int:
        """Datagrams that were dropped since this was last asked."""
        before, self._dropped = self._dropped, sum(link.counts().dropped for link in self.links)
        return self._dropped - before

    def _check(self, boat: LiveBoat, now_ns: int) -> None:
        """Once a second: health, a recording that failed, datagrams that were dropped."""
        outputs = self.outputs[boat.boat.system]
        status = boat.status(now_ns, outputs.backlog, outputs.drops)
        outputs.send(status)
        if self._metrics is not None:
            for part in status:
                if part.topic == "health":
                    self._metrics.health(boat.name, part.payloads[-1])
        if failure := outputs.new_failure():
            self._send_event(boat, "recording_failed", "error", failure)
        if stall := outputs.new_stall():
            self._send_event(boat, "recording_stalled", "warning", stall)
        now_s = self._steady() / SECOND
        if outputs.wants_retry(now_s):
            self._record_again(boat, outputs, now_s)
        if again := outputs.new_recovery(now_s):
            self._send_event(boat, "recording_again", "warning", again)
        if self._newly_dropped:
            text = f"{self._newly_dropped} datagrams dropped: more came than can be handled"
            self._send_event(boat, "overload", "error", text)

    def _link_event(self, event: LinkEvent) -> None:
        severity = "info" if event.kind in ("listening", "connected", "heard") else "warning"
        text = f"{event.link}: {event.text}"
        self._progress(LogLine(text, severity, f"link_{event.kind}"))
        for boat in self.fleet.boats.values():
            rows = boat.event(f"link_{event.kind}", severity, text, event.receive_time_ns)
            self.outputs[boat.boat.system].send(rows)

    def _send_event(self, boat: LiveBoat, kind: str, severity: str, text: str) -> None:
        if severity != "info":
            self._progress(LogLine(f"{boat.name}: {text}", severity, kind, boat.name))
        self.outputs[boat.boat.system].send(boat.event(kind, severity, text, self._clock()))

    def _fault(self, error: Exception) -> None:
        """Count a defect; report it once in a while."""
        self.faults += 1
        if self._steady() - self._fault_ns >= REPORT_INTERVAL_NS:
            self._fault_ns = self._steady()
            text = f"defect of the gateway, {self.faults} so far: {error!r}"
            self._progress(LogLine(text, "error", "fault"))
            for boat in self.fleet.boats.values():
                rows = boat.event("fault", "error", text, self._clock())
                self.outputs[boat.boat.system].send(rows)

    def _add_boat(self, boat: LiveBoat, plan: BoatPlan) -> None:
        """Give a new boat its keys and its recording."""
        outputs = self.outputs[boat.boat.system] = BoatOutputs()
        boat.patient = True
        self._boat_plans[boat.boat.system] = plan
        self._progress(f"{boat.boat}: shadowed as {boat.name}")
        if self._session is not None:
            model, status = dump_vessel(plan.vessel).encode(), self._status(boat)
            where = self.options.settings.zenoh.bus()
            bus = Bus(boat.name, model=model, status=status, settings=where, session=self._session)
            outputs.bus = self._scope.enter_context(bus)
            if bus.others:
                text = (f"{boat.name}: another gateway publishes under that name too: subscribers "
                        "get both; --name gives this one a name of its own")  # fmt: skip
                self._progress(LogLine(text, "warning", "name_taken", boat.name))
        if self._foxglove is not None:
            outputs.view = self._foxglove.boat(boat.name, leading=plan is self._leading)
        if self.options.out is not None:
            folder, settings = self.options.out, self.options.settings
            try:
                recording = start_recording(boat, plan, folder, settings, self._scope)
            except ShadowError as error:
                outputs.failure = str(error)
                return
            outputs.recording = recording
            self._progress(f"recording: {recording.paths[-1]}")

    def _record_again(self, boat: LiveBoat, outputs: BoatOutputs, now_s: float) -> None:
        """After a disk was full, or the like: another file, as soon as it takes one."""
        assert self.options.out is not None
        plan, folder = self._boat_plans[boat.boat.system], self.options.out
        try:
            recording = start_recording(boat, plan, folder, self.options.settings, self._scope)
        except ShadowError as error:
            outputs.failure, outputs.retry_s = str(error), now_s + FIRST_RETRY_S
            return
        outputs.record_with(recording, now_s)

    def _report_ignored(self, boat: Boat) -> None:
        self._ignored += 1
        if self._ignored <= MAX_LISTED:
            self._progress(f"{boat}: not followed, no vessel is given for it; "
                           f"--vessel {boat.system}=FILE does that")  # fmt: skip
        elif self._ignored == MAX_LISTED + 1:
            self._progress("more boats are heard than are named here: none of them is followed")

    def _status(self, boat: LiveBoat) -> Callable[[], bytes]:
        """The answer of the queryable `status`, made on a thread of zenoh."""

        def status() -> bytes:
            links = {link.name: vars(link.counts()) for link in self.links}
            about = {"name": boat.name, "boat": str(boat.boat), "system": boat.boat.system}
            judged = None if boat.judged is None else event_rows([boat.judged]).messages()[0]
            return orjson.dumps({**about, "links": links, "faults": self.faults, "judged": judged})

        return status


def _line(boat: LiveBoat, event: EventRow) -> LogLine:
    """An event of a boat as a line."""
    return LogLine(f"{boat.name}: {event.text}", event.severity, event.kind, boat.name)


# A busy thread (the recorder) keeps the interpreter for so long when another one (the loop, when a
# datagram comes) wants it. Python's default is 5 ms; shorter than this costs more of the processor,
# since each thread that waits asks so often: benchmarks/results/live_latency.md.
SWITCH_S = 0.002


def run_until_stopped(plans: Sequence[BoatPlan], options: LiveOptions, progress: Progress) -> None:
    """Run until SIGINT, SIGTERM or SIGHUP; then everything is finished cleanly."""
    stop = stop_on_signals()
    sys.setswitchinterval(SWITCH_S)
    progress("getting ready: the first start with a vessel compiles for a while")
    with Gateway(plans, options, progress) as gateway:
        gc.collect()
        gc.freeze()  # what was loaded by now stays: it is not searched again and again
        progress(f"{opening(options.endpoints)}; Ctrl-C ends")
        gateway.run(stop)
    for line in gateway.left():
        progress(line)
    if unfinished := gateway.unfinished():
        raise ShadowError("; ".join(unfinished))
    progress("finished")
