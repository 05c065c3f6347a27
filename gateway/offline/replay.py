"""`shadow replay`: a recording through the path that also runs live, to MCAP and zenoh.

log → samples → filter inputs → shadow path → topics → recorder and bus
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import orjson

from gateway.config import Settings, as_tables, settings_of
from gateway.errors import BadInput
from gateway.ingest.earth import Origin
from gateway.ingest.log import BoatSamples, Log, choose_boat
from gateway.ingest.mavlink.frames import Frames
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.mcap import MAGIC
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.live.boats import BoatPlan
from gateway.live.rerun import fleet_of, recorded_live, rerun
from gateway.offline.replay_outputs import (
    LinkFrames,
    ReplayStep,
    ReplaySummary,
    ReplayTotals,
    open_outputs,
)
from gateway.recording.reader import Recording
from gateway.shadow.events import EventDetector
from gateway.shadow.health import LogHealth
from gateway.shadow.inputs import FilterInputs, filter_inputs_of, origin_of
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import ShadowPath
from gateway.shadow.recording_contents import attachments_of, metadata_of
from gateway.shadow.topic_rows import event_rows, topic_rows
from gateway.vessel_file import zenoh_key
from sim.plants.table import PlantChoice
from sim.vessel import Vessel

CHUNK_S = 5.0  # of received facts that are processed at a time
PACE_S = 0.02  # the same at the speed at which it was recorded

ShareDone = Callable[[float], None]  # called with the share of the work that is done, 0 to 1


@dataclass(frozen=True)
class ReplayOptions:
    """What a user may choose about a replay."""

    out: Path | None = None  # folder for the recording; None: do not record
    realtime: bool = False
    system: int | None = None
    name: str | None = None  # key on zenoh; default: the vessel's name in small letters
    mapping: Path | None = None  # of a .csv
    stem: str | None = None  # of the recording's name; default: the log's
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class ReplayInput:
    """A log made ready for the path; `settings` with what the boat's parameters add."""

    settings: Settings
    log: Log
    decoded: BoatSamples
    origin: Origin | None
    feed: FilterInputs


def replay_input_of(
    log: Log, system: int | None = None, settings: Settings | None = None
) -> ReplayInput:
    """Decode a log and choose its sources; BadInput where heading or velocity is missing."""
    settings, boat = settings or Settings(), choose_boat(log, system)
    settings = replace(settings, filter=settings.filter.with_parameters(log.parameters(boat)))
    decoded = log.decode(boat)
    choices = choose(decoded.samples)
    for needed in ("yaw", "velocity"):
        if needed not in choices:
            raise BadInput(f"{log.path}: nothing in it tells {needed}: there is nothing to follow")
    origin = origin_of(decoded, choices)
    feed = filter_inputs_of(decoded, choices, origin, settings.filter)
    return ReplayInput(settings, log, decoded, origin, feed)


def recorded_settings(log_path: Path) -> Settings | None:
    """The configuration that a recording of ours was made with; None for any other log."""
    with log_path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return None
    attached = Recording.open(log_path).attachments.get("config.json")
    return None if attached is None else settings_of(orjson.loads(attached.data), str(log_path))


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
    given = replay_input_of(log, options.system, options.settings)
    following = given.settings.following
    path = ShadowPath.of(
        vessel,
        played_by,
        given.settings.filter,
        reference=following.reference,
        follower=following.follower,
        rate_hz=following.rate_hz,
    )
    name, began, totals = options.name or zenoh_key(vessel), time.monotonic(), ReplayTotals()
    ours = log.recording if isinstance(log, MavlinkLog) else None
    live = ours if ours is not None and recorded_live(ours) else None
    if live is not None:
        plan = BoatPlan(vessel, played_by, name=name)
        steps = _live_steps(live, plan, options.settings, options.realtime, progress)
    else:
        steps = _log_steps(path, given, options.realtime, progress)
    file = _recording_file(log, options)
    replaced = file is not None and file.exists()
    with ExitStack() as scope:
        outputs = open_outputs(
            scope,
            name,
            file,
            attachments_of(vessel, played_by, as_tables(given.settings)),
            metadata_of(
                name,
                given.decoded.boat,
                plant=played_by,
                log=Path(log.path).name,
                live=live is not None,
            ),
            options.settings,
        )
        for step in steps:
            totals.add(step)
            outputs.write(step)
    if not totals.count:
        raise BadInput(f"{log_path}: the filter never found heading and velocity together")
    summary = totals.summary(log, given.decoded.boat, time.monotonic() - began, outputs.files)
    note = ("an earlier recording of that name was replaced",) if replaced else ()
    return replace(summary, notes=(*summary.notes, *note))


def _recording_file(log: Log, options: ReplayOptions) -> Path | None:
    """Where a replay of that log is recorded; None where it is not."""
    stem = options.stem or Path(log.path).stem
    return None if options.out is None else options.out / f"{stem}-shadow.mcap"


def _log_steps(
    path: ShadowPath, given: ReplayInput, realtime: bool, progress: ShareDone
) -> Iterator[ReplayStep]:
    """A log, chunk by chunk."""
    state, detector, monitor = path.start(), EventDetector(), ModelMonitor.of(path.model)
    health = LogHealth.of(given.log, given.decoded)
    feed, log = given.feed, given.log
    frames = log.frames if isinstance(log, MavlinkLog) else ()
    start, first_frame = 0, 0
    for end in _chunk_ends(feed, PACE_S if realtime else CHUNK_S, realtime):
        chunk = feed[start:end]
        state, out, filtered = path.advance(state, chunk)
        detector, events = detector.observe(chunk, filtered, out)
        rows = list(topic_rows(out, given.origin))
        monitor, monitored, warnings = monitor.observe(out)
        rows += [*monitored, event_rows([*events, *warnings])]
        rows.append(health.advance(chunk.receive_time_ns, filtered))
        last = end == len(feed)
        frame_end = len(frames) if last else int(chunk.order[-1]) + 1 if frames else 0
        frame_end = max(first_frame, frame_end)
        yield ReplayStep([out], rows, partial(_frames_between, frames, first_frame, frame_end))
        start, first_frame = end, frame_end
        progress(end / len(feed))


def _frames_between(frames: Frames | tuple[()], start: int, end: int) -> LinkFrames:
    if not frames:
        return LinkFrames("", [], [])
    raw = [frames.raw(i) for i in range(start, end)]
    return LinkFrames("", raw, frames.receive_time_ns[start:end])


def _live_steps(
    recording: Recording, plan: BoatPlan, settings: Settings, realtime: bool, progress: ShareDone
) -> Iterator[ReplayStep]:
    """A recording of `shadow live`: the same inputs in the same order give the same shadow."""
    raw = recording.raw()
    first_ns, began = int(raw.receive_time_ns[0]), time.monotonic()
    for one in rerun(fleet_of(recording, plan, settings), recording.path):
        k = one.frames.start
        if realtime:
            due = began + (int(raw.receive_time_ns[k]) - first_ns) * 1e-9
            time.sleep(max(0.0, due - time.monotonic()))
        frames = [raw.data[raw.start[i] : raw.end[i]] for i in range(k, one.frames.stop)]
        link, receipts = raw.links[raw.link[k]], raw.receive_time_ns[one.frames]
        yield ReplayStep(one.outs, one.rows, partial(LinkFrames, link, frames, receipts))
        progress(one.frames.stop / len(raw))


def _chunk_ends(feed: FilterInputs, chunk_s: float, realtime: bool) -> Iterator[int]:
    """Where each chunk ends; at the recorded speed, each when its time has come."""
    receive = (feed.receive_time_ns - feed.receive_time_ns[0]) * 1e-9
    since = np.maximum.accumulate(receive)  # the receiver's clock may have stepped back
    began, start = time.monotonic(), 0
    while start < len(feed):
        end = int(np.searchsorted(since, since[start] + chunk_s, side="left"))
        end = max(end, start + 1)
        if realtime:
            time.sleep(max(0.0, began + float(since[end - 1]) - time.monotonic()))
        yield end
        start = end
