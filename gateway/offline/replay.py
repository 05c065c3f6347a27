"""What comes of a replay: frames and topics to a recording and to zenoh, and a summary.

`shadow replay`: a recording through the path that also runs live, to MCAP and zenoh.

log → samples → filter inputs → shadow path → topics → recorder and bus
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.bus import Bus
from gateway.config import Settings, as_tables
from gateway.errors import BadInput, printable
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.log import BoatSamples, Log, choose_floating
from gateway.ingest.mapping import Origin
from gateway.ingest.mavlink.log import Frames, MavlinkLog
from gateway.ingest.mcap.log import enclosure_of_file
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.json_rows import TopicRows
from gateway.live.boats import BoatPlan
from gateway.live.rerun import fleet_of, recorded_live, rerun
from gateway.long_running import Interrupts
from gateway.offline.notices import delay_assumed
from gateway.offline.replay_summary import ReplaySummary, ReplayTotals
from gateway.recording.reader import Recording
from gateway.recording.recorder import Attachment, Recorder
from gateway.recording.writer import Payloads
from gateway.shadow import FilterInputs, filter_inputs_of, origin_of
from gateway.shadow.events import EventDetector
from gateway.shadow.health import LogHealth
from gateway.shadow.model_monitor import APPLY_EVERY_NS, Adapt, ModelMonitor, taken_over
from gateway.shadow.path import ShadowPath, ShadowRows
from gateway.shadow.topic_rows import EventRow, attachments_of, event_rows, metadata_of, topic_rows
from gateway.vessel_file import zenoh_key
from sim.plants import PlantChoice
from sim.vessel import Vessel


class LinkFrames(NamedTuple):
    """Raw frames of one link, with their receive times."""

    link: str
    frames: Payloads
    receive_time_ns: NDArray[np.int64]


class ReplayStep(NamedTuple):
    """Rows of the path and messages that some inputs led to; `raw` makes the inputs' frames."""

    outs: list[ShadowRows]
    rows: list[TopicRows]
    raw: Callable[[], LinkFrames]


@dataclass(frozen=True)
class ReplayOutputs:
    """Recorder and bus, either of which may be absent."""

    recorder: Recorder | None
    bus: Bus | None

    def write(self, step: ReplayStep) -> None:
        """Raw frames first: they were received before what follows from them."""
        if self.recorder is not None:
            raw = step.raw()
            self.recorder.write_raw(raw.frames, raw.receive_time_ns, link=raw.link)
            for part in step.rows:
                self.recorder.write_rows(part)
        if self.bus is not None:
            self.bus.publish_rows(step.rows)

    @property
    def files(self) -> tuple[Path, ...]:
        """The recordings that were written."""
        return self.recorder.paths if self.recorder is not None else ()


def open_outputs(
    scope: ExitStack,
    name: str,
    file: Path | None,
    attachments: Sequence[Attachment],
    metadata: dict[str, dict[str, str]],
    settings: Settings,
) -> ReplayOutputs:
    """Open what the settings ask for until `scope` closes; `file` None: no recording.

    The first attachment is the vessel file, which the bus offers as the model.
    """
    recorder = bus = None
    if file is not None:
        recorder = scope.enter_context(
            Recorder(file, attachments=attachments, metadata=metadata, settings=settings.recording)
        )
    if settings.zenoh.publish:
        model = attachments[0].data
        bus = scope.enter_context(Bus(name, model=model, settings=settings.zenoh.bus()))
    return ReplayOutputs(recorder, bus)


# Of received facts, processed at a time. 5 takes a tenth longer; 20 makes recordings of all topics
# 6 % larger: the same numbers in several topics stand too far apart to be compressed.
CHUNK_S = 10.0
MAX_CHUNK = 10_000  # measurements, where many share a receipt: memory goes with them
PACE_S = 0.02  # the same at the speed at which it was recorded

Pace = Callable[[float], None]  # sleeps for so many seconds, if above 0
ShareDone = Callable[[float], None]  # called with the share of the work that is done, 0 to 1


@dataclass(frozen=True)
class ReplayOptions:
    """What a user may choose about a replay."""

    out: Path | None = None  # folder for the recording; None: do not record
    realtime: bool = False
    system: int | None = None
    name: str | None = None  # key on zenoh; default: the vessel's name in small letters
    mapping: Path | None = None  # of a .csv
    anyway: bool = False  # take the log of a vehicle that says it is no boat
    stem: str | None = None  # of the recording's name; default: the log's
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class ReplayInput:
    """A log made ready for the path; `settings` with what the boat's parameters add.

    assumed  where they do not tell it, a sentence each
    """

    settings: Settings
    log: Log
    decoded: BoatSamples
    origin: Origin | None
    feed: FilterInputs
    assumed: tuple[str, ...] = ()


def replay_input_of(
    log: Log,
    system: int | None = None,
    settings: Settings | None = None,
    anyway: bool = False,
) -> ReplayInput:
    """Decode a log and choose its sources; BadInput where heading or velocity is missing."""
    settings, boat = settings or Settings(), choose_floating(log, system, anyway)
    parameters, given = log.parameters(boat), settings.filter
    decoded = log.decode(boat)
    if not decoded.tabular:  # of a table nobody knows anything
        settings = replace(settings, filter=given.with_parameters(parameters, boat.autopilot))
    choices = choose(decoded.samples)
    for needed in ("yaw", "velocity"):
        if needed not in choices:
            raise BadInput(f"{log.path}: nothing in it tells {needed}: there is nothing to follow")
    origin = origin_of(decoded, choices)
    feed = filter_inputs_of(decoded, choices, origin, settings.filter)
    chosen = settings.filter is given
    assumed = () if chosen else delay_assumed(decoded, choices, parameters)
    return ReplayInput(settings, log, decoded, origin, feed, assumed)


def options_by_log(logs: Sequence[Path], options: ReplayOptions) -> list[ReplayOptions]:
    """Options for each of several logs: those with one name (.tlog, .BIN) get two recordings."""
    count: Counter[str] = Counter()
    out = []
    for log in logs:
        count[log.stem] += 1
        number = f"-{count[log.stem]}" if count[log.stem] > 1 else ""
        out.append(replace(options, stem=f"{log.stem}{number}"))
    return out


def replay(
    log_path: str | Path,
    vessel: Vessel,
    plant: Vessel | PlantChoice | None = None,
    options: ReplayOptions | None = None,
    progress: ShareDone = lambda share: None,
) -> ReplaySummary:
    """Run a recording through the shadow; `progress` is called with the share done.

    `plant` plays the shadow: a vessel, another kind of plant, or by default the vessel itself.
    """
    options = options or ReplayOptions()
    played_by = plant if isinstance(plant, PlantChoice) else PlantChoice(vessel=plant)
    log = open_log(log_path, options.mapping)
    given = replay_input_of(log, options.system, options.settings, options.anyway)
    following = given.settings.following
    path = ShadowPath.of(
        vessel,
        played_by,
        given.settings.filter,
        reference=following.reference,
        follower=following.follower,
        rate_hz=following.rate_hz,
    )
    interrupts = Interrupts()
    pace = interrupts.sleep if options.realtime else None
    name, began, totals = options.name or zenoh_key(vessel), time.monotonic(), ReplayTotals()
    ours = log.recording if isinstance(log, MavlinkLog) else None
    live = ours if ours is not None and recorded_live(ours) else None
    if live is not None:
        plan = BoatPlan(vessel, played_by, name=name)
        steps = _live_steps(live, plan, options.settings, pace, progress)
    else:
        steps = _log_steps(path, given, pace, progress)
    file = recording_file(log.path, options)
    replaced = file is not None and file.exists()
    with interrupts, ExitStack() as scope:
        outputs = open_outputs(
            scope,
            name,
            file,
            [*attachments_of(vessel, played_by, as_tables(given.settings)), *_enclosed(log)],
            metadata_of(
                name,
                given.decoded.boat,
                plant=played_by,
                log=printable(Path(log.path).name),
                live=live is not None,
            ),
            options.settings,
        )
        for step in steps:
            interrupts.check()
            totals.add(step.outs, step.rows)
            outputs.write(step)
    if not totals.count:
        raise BadInput(f"{log_path}: the filter never found heading and velocity together")
    summary = totals.summary(log, given.decoded.boat, time.monotonic() - began, outputs.files)
    note = ("an earlier recording of that name was replaced",) if replaced else ()
    assumed = given.assumed if live is None else ()  # that one has its boat's own parameters
    return replace(summary, notes=(*summary.notes, *assumed, *note))


def _enclosed(log: Log) -> list[Attachment]:
    """The log itself, where it is not frames that are recorded one by one."""
    if isinstance(log, MavlinkLog):
        return []
    beside = isinstance(log, CsvLog) and log.mapping.path != log.path and Path(log.mapping.path)
    return enclosure_of_file(Path(log.path), beside or None)


def recording_file(log_path: str | Path, options: ReplayOptions) -> Path | None:
    """Where a replay of that log is recorded; None where it is not."""
    stem = options.stem or Path(log_path).stem
    return None if options.out is None else options.out / f"{stem}-shadow.mcap"


def _log_steps(
    path: ShadowPath, given: ReplayInput, pace: Pace | None, progress: ShareDone
) -> Iterator[ReplayStep]:
    """A log, chunk by chunk."""
    adapt = given.settings.following.adapt
    state, detector = path.start(), EventDetector.of(path.model.vessel)
    monitor = ModelMonitor.of(path.model, adapt is not Adapt.OFF)
    applies = adapt is Adapt.APPLY
    health = LogHealth.of(given.log, given.decoded)
    feed, log = given.feed, given.log
    frames = log.frames if isinstance(log, MavlinkLog) else ()
    boots = _boot_rows(feed, [begin for begin, _ in given.decoded.sessions[1:]])
    start, first_frame = 0, 0
    chunk_s = PACE_S if pace else CHUNK_S
    for end in _chunk_ends(feed, boots, chunk_s, pace, APPLY_EVERY_NS if applies else None):
        chunk, rebooted = feed[start:end], list[EventRow]()
        if start in boots:
            times = int(chunk.vehicle_time_ns[0]), int(chunk.receive_time_ns[0])
            monitor, judged = monitor.rebooted(times)
            rebooted = [EventRow(*times, "reboot", "warning", "the autopilot rebooted"), *judged]
        if applies:
            monitor, path = taken_over(monitor, path, int(chunk.receive_time_ns[0]))
        state, out, filtered = path.advance(state, chunk)
        detector, events = detector.observe(chunk, filtered, out)
        rows = list(topic_rows(out, given.origin))
        monitor, monitored, warnings = monitor.observe(out)
        rows += [*monitored, event_rows([*rebooted, *events, *warnings])]
        rows.append(health.advance(chunk.receive_time_ns, filtered, out))
        last = end == len(feed)
        frame_end = len(frames) if last else int(chunk.order[-1]) + 1 if frames else 0
        frame_end = max(first_frame, frame_end)
        yield ReplayStep([out], rows, partial(_frames_between, frames, first_frame, frame_end))
        start, first_frame = end, frame_end
        progress(end / len(feed))


def _boot_rows(feed: FilterInputs, boots: Sequence[int]) -> list[int]:
    """The first row of each boot that began at those times of the boat's clock [ns]."""
    latest = np.maximum.accumulate(feed.vehicle_time_ns)
    rows = np.searchsorted(latest, np.array(boots, np.int64))
    return sorted({int(k) for k in rows if k < len(feed)})


def _frames_between(frames: Frames | tuple[()], start: int, end: int) -> LinkFrames:
    if not frames:
        return LinkFrames("", Payloads.of([]), np.empty(0, np.int64))
    first = frames.headers.offset[start:end]
    packed = Payloads(frames.data, first, first + frames.headers.length[start:end])
    return LinkFrames("", packed, frames.receive_time_ns[start:end])


def _live_steps(
    recording: Recording, plan: BoatPlan, settings: Settings, pace: Pace | None, progress: ShareDone
) -> Iterator[ReplayStep]:
    """A recording of `shadow live`: the same inputs in the same order give the same shadow."""
    raw = recording.raw()
    first_ns, began = int(raw.receive_time_ns[0]), time.monotonic()
    for one in rerun(fleet_of(recording, plan, settings), recording.path):
        k = one.frames.start
        if pace:
            due = began + (int(raw.receive_time_ns[k]) - first_ns) * 1e-9
            pace(due - time.monotonic())
        data = np.frombuffer(raw.data, np.uint8)
        frames = Payloads(data, raw.start[one.frames], raw.end[one.frames])
        link, receipts = raw.links[raw.link[k]], raw.receive_time_ns[one.frames]
        yield ReplayStep(one.outs, one.rows, partial(LinkFrames, link, frames, receipts))
        progress(one.frames.stop / len(raw))


def _chunk_ends(
    feed: FilterInputs, boots: Sequence[int], chunk_s: float, pace: Pace | None, cut_ns: int | None
) -> Iterator[int]:
    """Where each chunk ends; at the recorded speed, each when its time has come.

    Each of `boots` (rows) begins one, and every multiple of `cut_ns` (by receipt) ends one, however
    long chunks are.
    """
    period = feed.receive_time_ns // cut_ns if cut_ns else np.zeros(len(feed), np.int64)
    turns = np.unique([*(np.flatnonzero(np.diff(period)) + 1), *boots, len(feed)])
    receive = (feed.receive_time_ns - feed.receive_time_ns[0]) * 1e-9
    since = np.maximum.accumulate(receive)  # the receiver's clock may have stepped back
    began, start = time.monotonic(), 0
    while start < len(feed):
        end = int(np.searchsorted(since, since[start] + chunk_s, side="left"))
        end = min(
            max(end, start + 1),
            start + MAX_CHUNK,
            int(turns[np.searchsorted(turns, start, side="right")]),
        )
        if pace:
            pace(began + float(since[end - 1]) - time.monotonic())
        yield end
        start = end
