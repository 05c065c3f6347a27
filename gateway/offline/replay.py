"""A recording through the live path: log → facts → shadow → topics → MCAP and zenoh."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.bus import Bus
from gateway.config import Settings, as_tables, settings_of
from gateway.errors import BadInput
from gateway.ingest.decoding import Decoded, decode
from gateway.ingest.earth import Origin
from gateway.ingest.files import MCAP_MAGIC
from gateway.ingest.log import Log, Statistics
from gateway.ingest.mavlink.boats import choose_boat
from gateway.ingest.mavlink.frames import Frames
from gateway.ingest.open import open_log
from gateway.ingest.parameters import autopilot_parameters
from gateway.ingest.sources import choose
from gateway.json_rows import Rows
from gateway.live.boats import BoatPlan
from gateway.live.relive import ABOUT, LIVE, fleet_of, ran_live, relived
from gateway.recording.file import Attachment
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder
from gateway.shadow.events import EventDetector
from gateway.shadow.health import HealthMeter
from gateway.shadow.inputs import FilterInputs, feed_of, origin_of
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import Shadowing, ShadowPath, follower_of
from gateway.shadow.topic_rows import event_rows, topic_rows
from gateway.vessel_file import dump_vessel, key_of
from sim.effects.catalogue import EFFECTS
from sim.following.reference import Reference
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

CHUNK_S = 5.0  # of receipt at a time when nothing else sets the pace
PACE_S = 0.02  # at the speed at which it was recorded

Progress = Callable[[float], None]


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
class ReplaySummary:
    """What a replay did."""

    log: str
    boat: str
    seconds: float
    rows: int
    wall_seconds: float
    rmse: Floats  # (6,) shadow − estimate while measured: north, east, yaw, u, v, r
    missing: Floats  # (3,) root mean square of the missing force [N, N, N m]
    events: int
    recordings: tuple[Path, ...]
    notes: tuple[str, ...] = ()  # what was odd about the log


@dataclass(frozen=True)
class Material:
    """A log made ready for the path; `settings` with what the boat's parameters tell."""

    settings: Settings
    log: Log
    decoded: Decoded
    origin: Origin | None
    feed: FilterInputs


def prepare(log_path: str | Path, options: ReplayOptions) -> Material:
    """Read, decode, choose the sources."""
    return material_of(open_log(log_path, options.mapping), options)


def material_of(log: Log, options: ReplayOptions) -> Material:
    """The same from an opened log."""
    boat = choose_boat(log, options.system)
    told = options.settings.filter.told_by(autopilot_parameters(log, boat))
    settings = replace(options.settings, filter=told)
    decoded = decode(log, boat)
    choices = choose(decoded.samples)
    for needed in ("yaw", "velocity"):
        if needed not in choices:
            raise BadInput(f"{log.path}: nothing in it tells {needed}: there is nothing to follow")
    origin = origin_of(decoded, choices)
    return Material(
        settings, log, decoded, origin, feed_of(decoded, choices, origin, settings.filter)
    )


def recorded_settings(log_path: Path) -> Settings | None:
    """The configuration that a recording of ours was made with; None for any other log."""
    with log_path.open("rb") as file:
        if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            return None
    attached = Recording.open(log_path).attachments.get("config.json")
    return None if attached is None else settings_of(orjson.loads(attached.data), str(log_path))


def told_apart(logs: Sequence[Path], options: ReplayOptions) -> list[ReplayOptions]:
    """Options for each of several logs: those with one name (.tlog, .BIN) get two recordings."""
    seen: Counter[str] = Counter()
    out = []
    for log in logs:
        seen[log.stem] += 1
        again = seen[log.stem] > 1
        out.append(replace(options, stem=f"{log.stem}-{seen[log.stem]}" if again else log.stem))
    return out


def replay(
    log_path: str | Path,
    vessel: Vessel,
    plant: Vessel | None = None,
    options: ReplayOptions | None = None,
    progress: Progress = lambda share: None,
) -> ReplaySummary:
    """Run a recording through the shadow; `progress` is told the share done."""
    options = options or ReplayOptions()
    material = prepare(log_path, options)
    model = Model.of(vessel)
    following = material.settings.following
    path = ShadowPath(
        model,
        Reference(model, following.reference),
        follower_of(model if plant is None else Model.of(plant), following.follower),
        material.settings.filter,
        following.rate_hz,
    )
    name = options.name or key_of(vessel)
    started, tally = time.monotonic(), Tally()
    replaced = options.out is not None and recording_path(material.log, options).exists()
    again = material.log.kind == "mcap" and ran_live(Recording.open(Path(log_path)))
    if again:
        plan = BoatPlan(vessel, plant, name=name)
        recording = Recording.open(Path(log_path))
        steps = _ran_again(recording, plan, options.settings, options.realtime, progress)
    else:
        steps = _shadowed(path, material, options.realtime, progress)
    with ExitStack() as scope:
        sinks = _sinks(scope, material, vessels_of(vessel, plant), name, again, options)
        for step in steps:
            for out in step.outs:
                tally.add(out)
            tally.count_events(step.rows)
            sinks.write(step.rows, step.raw)
    if not tally.count:
        raise BadInput(f"{log_path}: the filter never found heading and velocity together")
    done = tally.summary(material, time.monotonic() - started, sinks.files())
    note = ("an earlier recording of that name was replaced",) if replaced else ()
    return replace(done, notes=(*done.notes, *note))


class RawPart(NamedTuple):
    """Frames of one link as they came, with their receipts."""

    link: str
    frames: list[bytes]
    receive_time_ns: Sequence[int] | NDArray[np.int64]


class Step(NamedTuple):
    """What some inputs led to, and what makes the frames that they were, where these are wanted."""

    outs: list[Shadowing]
    rows: list[Rows]
    raw: Callable[[], RawPart]


def _shadowed(
    path: ShadowPath, material: Material, realtime: bool, progress: Progress
) -> Iterator[Step]:
    """A log, chunk by chunk."""
    state, watchman, lookout = path.start(), EventDetector(), ModelMonitor.of(path.model)
    meter = HealthMeter.of_log(material.log, material.decoded)
    feed, frames = material.feed, _frames(material.log)
    begun, seen = 0, 0
    for end in _paced(feed, PACE_S if realtime else CHUNK_S, realtime):
        chunk = feed[begun:end]
        state, out, filtered = path.advance(state, chunk)
        watchman, happened = watchman.observe(chunk, filtered, out)
        rows = list(topic_rows(out, material.origin))
        lookout, around, odd = lookout.observe(out)
        rows += [*around, event_rows([*happened, *odd])]
        rows.append(meter.advance(chunk.receive_time_ns, filtered))
        last = end == len(feed)
        upto = len(frames) if last else int(chunk.order[-1]) + 1 if frames else 0
        yield Step([out], rows, partial(_part_of, frames, seen, max(seen, upto)))
        begun, seen = end, max(seen, upto)
        progress(end / len(feed))


def _part_of(frames: Frames | tuple[()], start: int, end: int) -> RawPart:
    if not frames:
        return RawPart("", [], [])
    raw = [frames.raw(i) for i in range(start, end)]
    return RawPart("", raw, frames.receive_time_ns[start:end])


def _ran_again(
    recording: Recording, plan: BoatPlan, settings: Settings, realtime: bool, progress: Progress
) -> Iterator[Step]:
    """A recording of `shadow live`: the same inputs in the same order give the same shadow."""
    raw = recording.raw()
    begun_ns, started = int(raw.receive_time_ns[0]), time.monotonic()
    for one in relived(fleet_of(recording, plan, settings), recording.path):
        k = one.frames.start
        if realtime:
            due = started + (int(raw.receive_time_ns[k]) - begun_ns) * 1e-9
            time.sleep(max(0.0, due - time.monotonic()))
        frames = [raw.data[raw.start[i] : raw.end[i]] for i in range(k, one.frames.stop)]
        link, receipts = raw.links[raw.link[k]], raw.receive_time_ns[one.frames]
        yield Step(one.outs, one.rows, partial(RawPart, link, frames, receipts))
        progress(one.frames.stop / len(raw))


def _paced(feed: FilterInputs, chunk_s: float, realtime: bool) -> Iterator[int]:
    """Where each chunk ends; at the recorded speed, when its time has come."""
    receive = (feed.receive_time_ns - feed.receive_time_ns[0]) * 1e-9
    since = np.maximum.accumulate(receive)  # the receiver's clock may have stepped back
    started, begun = time.monotonic(), 0
    while begun < len(feed):
        end = int(np.searchsorted(since, since[begun] + chunk_s, side="left"))
        end = max(end, begun + 1)
        if realtime:
            time.sleep(max(0.0, started + float(since[end - 1]) - time.monotonic()))
        yield end
        begun = end


def _frames(log: Log) -> Frames | tuple[()]:
    return getattr(log, "frames", ())


@dataclass(frozen=True)
class Sinks:
    """Where messages go: recorder and bus, either of which may be absent."""

    material: Material
    recorder: Recorder | None
    bus: Bus | None

    def write(self, rows: list[Rows], raw: Callable[[], RawPart]) -> None:
        """Raw frames first: they came in before what followed from them."""
        if self.recorder is not None:
            heard = raw()
            self.recorder.write_raw(heard.frames, heard.receive_time_ns, link=heard.link)
        for part in rows:
            if self.recorder is not None:
                self.recorder.write_rows(*part)
            if self.bus is not None and part.payloads:
                wanted = part.payloads if self.bus.wants(part.topic) else part.payloads[-1:]
                for payload in wanted:
                    self.bus.publish(part.topic, payload)

    def files(self) -> tuple[Path, ...]:
        """The recordings that were written."""
        return self.recorder.paths if self.recorder is not None else ()


def vessels_of(vessel: Vessel, plant: Vessel | None) -> list[Attachment]:
    """Vessel files as they travel in a recording, with the effects that are not the catalogue's."""
    named = {"vessel.toml": vessel} | ({"plant.toml": plant} if plant is not None else {})
    own = [a.effect for v in named.values() for a in v.effects if a.effect not in EFFECTS]
    return [
        *(Attachment(n, "application/toml", dump_vessel(v).encode()) for n, v in named.items()),
        *(
            Attachment(file, "text/x-python", text.encode())
            for file, text in {effect.file: effect.source_code for effect in own}.items()
        ),
    ]


def recording_path(log: Log, options: ReplayOptions) -> Path:
    """Where a replay of that log is recorded."""
    return (options.out or Path()) / f"{options.stem or Path(log.path).stem}-shadow.mcap"


def _sinks(
    scope: ExitStack,
    material: Material,
    vessels: list[Attachment],
    name: str,
    again: bool,
    options: ReplayOptions,
) -> Sinks:
    recorder = bus = None
    if options.out is not None:
        file = recording_path(material.log, options)
        config = orjson.dumps(as_tables(material.settings), option=orjson.OPT_INDENT_2)
        recorder = scope.enter_context(
            Recorder(
                file,
                attachments=[
                    *vessels,
                    Attachment("config.json", "application/json", config),
                ],
                metadata={ABOUT: _about(material, name, again)},
                settings=options.settings.recording,
            )
        )
    if options.settings.zenoh.publish:
        bus = scope.enter_context(
            Bus(name, model=vessels[0].data, settings=options.settings.zenoh.bus())
        )
    return Sinks(material, recorder, bus)


def _about(material: Material, name: str, again: bool) -> dict[str, str]:
    about = {
        "gateway": version("shadow-gateway"),
        "vessel": name,
        "log": Path(material.log.path).name,
        "boat": str(material.decoded.boat),
    }
    return about | ({LIVE: "yes", "system": str(material.decoded.boat.system)} if again else {})


def _notes(found: Statistics) -> tuple[str, ...]:
    """What a user should know about the log that was replayed."""
    odd = {
        "bytes were no message": found.junk_bytes,
        "messages had a wrong checksum": found.bad_checksum,
    }
    notes = [f"{count} {what}" for what, count in odd.items() if count]
    if found.truncated_tail:
        notes.append("the log is cut off at its end: read up to there")
    return (*notes, *found.notes)


@dataclass
class Tally:
    """Adds up what the summary tells."""

    count: int = 0
    compared: int = 0
    squares: Floats | None = None
    missing: Floats | None = None
    events: int = 0
    first_s: float = 0.0
    last_s: float = 0.0

    def count_events(self, rows: list[Rows]) -> None:
        """Take in what happened."""
        self.events += sum(len(part.payloads) for part in rows if part.topic == "event")

    def add(self, out: Shadowing) -> None:
        """Take in a chunk's rows."""
        if not len(out):
            return
        self.first_s = self.first_s if self.count else float(out.time_s[0])
        self.last_s = float(out.time_s[-1])
        self.count += len(out)
        off = (out.shadow - out.estimate)[out.fresh, :6]
        off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        self.compared += len(off)
        force = out.watched.missing[out.fresh]
        self.squares = (off**2).sum(axis=0) + (0.0 if self.squares is None else self.squares)
        self.missing = (force**2).sum(axis=0) + (0.0 if self.missing is None else self.missing)

    def summary(
        self, material: Material, wall_seconds: float, files: tuple[Path, ...]
    ) -> ReplaySummary:
        """The sums as root mean squares."""
        count = max(self.compared, 1)
        assert self.squares is not None
        assert self.missing is not None
        return ReplaySummary(
            material.log.path,
            str(material.decoded.boat),
            self.last_s - self.first_s,
            self.count,
            wall_seconds,
            np.sqrt(self.squares / count),
            np.sqrt(self.missing / count),
            self.events,
            files,
            _notes(material.log.statistics),
        )
