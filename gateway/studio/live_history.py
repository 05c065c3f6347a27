"""The last minutes of all shadows on the bus, kept by one thread for all pages.

It takes the statuses ten times a second. zenoh waits and joins here, never on the page's own loop.

The last minutes of a live boat can be worked on: `shadow live` records each boat in a file of its
own, which can be read while it grows. Of its last minutes a copy is worked on, with the vessel that
the gateway uses. Nothing here needs the pages, so that a worker's process begins soon.
"""

import re
import time
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Self

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from gateway.errors import BadInput, ShadowError
from gateway.figures import DEGREES
from gateway.ingest.mavlink.frames import ids_by_name
from gateway.monitor import TRUTH, BusWatcher, Message, MonitorOptions, VesselStatus
from gateway.offline.export_messages import message_keys
from gateway.recording.blocks import Block
from gateway.recording.reader import Recording, rewrite
from gateway.recording.recorder import RAW
from gateway.shadow.topic_rows import LIVE, METADATA
from gateway.studio.worker import Send
from sim.state import Floats

PERIOD_S = 0.1
WINDOW_S = 60.0  # of velocities
TRACK_S = 300.0
TRACK_EVERY = 5  # messages between two points of a track
PAST_S, PAST_EVERY_S = 300.0, 0.2  # that can be gone back to, and between two moments of it
MOTION_TOPICS = ("measured", "shadow", "reference", TRUTH)
TRACKED = ("measured", "shadow", TRUTH)
RESIDUAL = "residual"
MISSING = ("missing_surge_n", "missing_sway_n", "missing_yaw_nm")
FORCES = (*MISSING, *(f"{name}_std" for name in MISSING))
MOTION = ("east_m", "north_m", "surge_mps", "sway_mps")
SAME_MOMENT_NS = 100_000_000  # two messages that are held beside each other
JUMP_M = 5.0  # within a tenth of a second: a frame or a day that begins anew
LARGEST = 1e7  # m, m/s, N or N m: what is larger would break a chart


@dataclass(frozen=True)
class WatchedBoat:
    """One boat: its status, its tracks (east, north [m]), and what it told by topic.

    rows  (n, 4) of Unix time [s], u, v [m/s], r [°/s] of a motion; (n, 7) of time, missing X, Y
          [N], N [N m] and their standard deviations of the residual
    truth_origin  where the truth's origin lies on the chart (east, north [m]); None: not known
    gone  when its gateway was last away [Unix s]: what was said before is of another run
    """

    status: VesselStatus
    tracks: dict[str, tuple[list[float], list[float]]]
    rows: dict[str, Floats]
    truth_origin: tuple[float, float] | None = None
    gone: float = 0.0

    def placed(self, topic: str) -> Message | None:
        """The latest motion of a topic, its place as the chart has it."""
        m = self.status.message(topic)
        if m is None or topic != TRUTH:
            return m
        return None if self.truth_origin is None else _moved(m, self.truth_origin)

    def rows_since(self, topic: str, time: float) -> Floats:
        """The rows of a topic after a Unix time [s]."""
        rows = self.rows.get(topic)
        return np.empty((0, 7)) if rows is None else rows[rows[:, 0] > time]


class BoatHistory:
    """Velocities and tracks of one boat."""

    def __init__(self) -> None:
        length, points = int(WINDOW_S / PERIOD_S), int(TRACK_S / PERIOD_S / TRACK_EVERY)
        self.rows = {t: deque[tuple[float, ...]](maxlen=length) for t in (*MOTION_TOPICS, RESIDUAL)}
        self.tracks = {t: deque[tuple[float, float]](maxlen=points) for t in TRACKED}
        self.truth_origin: tuple[float, float] | None = None
        self._places: dict[str, tuple[float, float]] = {}
        self.past = deque[tuple[float, VesselStatus]](maxlen=int(PAST_S / PAST_EVERY_S))
        self._counts: dict[str, int] = defaultdict(int)
        self._gone = 0.0

    def remember(self, now: float, status: VesselStatus) -> None:
        """The status of a moment [Unix s], to go back to."""
        if not status.alive:
            self._gone = now
        if not self.past or now - self.past[-1][0] >= PAST_EVERY_S:
            self.past.append((now, status))

    def as_of(self, moment: float) -> WatchedBoat | None:
        """The boat as it was at a moment [Unix s]; None where it had not been heard of."""
        known = [(at, status) for at, status in self.past if at <= moment]
        if not known:
            return None
        short = BoatHistory()
        short.truth_origin = self.truth_origin
        for _, status in known:
            short.add(status, track_every=1)
        return short.boat(known[-1][1])

    def add(self, status: VesselStatus, track_every: int = TRACK_EVERY) -> None:
        """Take the messages of each topic that are new."""
        self._place_truth(status.message(TRUTH), status.message("measured"))
        for topic in MOTION_TOPICS:
            message = status.message(topic)
            if message is not None and _plausible(message, MOTION):
                self._add_motion(topic, message, track_every)
        lacks = status.message(RESIDUAL)
        if lacks is not None and _plausible(lacks, FORCES):
            self._append(RESIDUAL, lacks, *(lacks[name] for name in FORCES))

    def _place_truth(self, truth: Message | None, measured: Message | None) -> None:
        """Both count from a place of their own: they are laid together where both are first known.

        A jump of either is a firmware that has begun anew: then they are laid together again.
        """
        if (
            truth is None
            or measured is None
            or not (_plausible(truth, MOTION) and _plausible(measured, MOTION))
        ):
            return
        now = {name: (m["east_m"], m["north_m"]) for name, m in ((TRUTH, truth), ("", measured))}
        before, self._places = self._places, now
        if any(np.hypot(*np.subtract(now[name], before[name])) > JUMP_M for name in before):
            self.truth_origin = None
            self.tracks[TRUTH].clear()
        apart_ns = abs(truth["receive_time_ns"] - measured["receive_time_ns"])
        if self.truth_origin is None and apart_ns < SAME_MOMENT_NS:
            (east, north), (x, y) = now[""], now[TRUTH]
            self.truth_origin = east - x, north - y

    def _add_motion(self, topic: str, m: Message, track_every: int) -> None:
        velocities = m["surge_mps"], m["sway_mps"], m["yaw_rate_radps"] * DEGREES
        if not self._append(topic, m, *velocities):
            return
        self._counts[topic] += 1
        if topic == TRUTH and self.truth_origin is None:
            return
        if topic in self.tracks and (self._counts[topic] - 1) % track_every == 0:
            m = _moved(m, self.truth_origin) if topic == TRUTH and self.truth_origin else m
            self.tracks[topic].append((m["east_m"], m["north_m"]))

    def _append(self, topic: str, m: Message, *values: float) -> bool:
        """A row of a topic; False where the message is not later than the last one."""
        at, rows = m["receive_time_ns"] * 1e-9, self.rows[topic]
        if rows and at <= rows[-1][0]:
            if at > rows[-1][0] - WINDOW_S:
                return False
            rows.clear()  # the clock was set back, or a recording begins again
        rows.append((at, *values))
        return True

    def boat(self, status: VesselStatus) -> WatchedBoat:
        """The boat as it is now, with copies of what is kept."""
        tracks = {
            topic: ([e for e, _ in points], [n for _, n in points])
            for topic, points in self.tracks.items()
        }
        rows = {topic: np.array(rows) for topic, rows in self.rows.items() if rows}
        return WatchedBoat(status, tracks, rows, self.truth_origin, self._gone)


def _moved(m: Message, origin: tuple[float, float]) -> Message:
    return {**m, "east_m": m["east_m"] + origin[0], "north_m": m["north_m"] + origin[1]}


def _plausible(m: Message, names: Iterable[str]) -> bool:
    """Anybody may publish: what would break a chart is left out."""
    return all(abs(m[name]) < LARGEST for name in names) and 0 < m["receive_time_ns"] < 1e19


class LiveHistory:
    """Watches the bus while it is open."""

    def __init__(self, options: MonitorOptions) -> None:
        self.where = options.where
        self._options = options
        self._lock, self._stop = Lock(), Event()
        self._boats: tuple[WatchedBoat, ...] = ()
        self._histories: dict[str, BoatHistory] = defaultdict(BoatHistory)
        self._removed: set[str] = set()  # of boats that were silent; they come back with a message
        self._thread = Thread(target=self._watch, name="live history", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(3.0)

    def boats(self) -> tuple[WatchedBoat, ...]:
        """All boats, by name."""
        with self._lock:
            return self._boats

    def as_of(self, moment: float) -> tuple[WatchedBoat, ...]:
        """All boats as they were at a moment [Unix s] of the last minutes."""
        with self._lock:
            found = [history.as_of(moment) for history in self._histories.values()]
        return tuple(boat for boat in found if boat is not None)

    def remove_silent(self) -> None:
        """Forget every boat that is gone or silent, until it is heard again."""
        with self._lock:
            silent = {b.status.name for b in self._boats if b.status.silent_s is not None}
            self._removed |= silent
            self._boats = tuple(b for b in self._boats if b.status.name not in silent)

    def _watch(self) -> None:
        with ExitStack() as scope:
            watcher = BusWatcher(self._options, scope)
            while not self._stop.wait(PERIOD_S):
                try:
                    statuses = watcher.statuses()
                except ShadowError:
                    continue
                self._take(statuses, time.time())

    def _take(self, statuses: Iterable[VesselStatus], now: float) -> None:
        """Statuses of a moment [Unix s] into the histories, and the boats as pages see them."""
        boats = []
        for status in statuses:
            heard = status.silent_s is None
            with self._lock:
                removed = status.name in self._removed and not heard
                self._removed -= {status.name} if heard else set()
                if removed:
                    self._histories.pop(status.name, None)
                    continue
                history = self._histories[status.name]
                history.add(status)
                history.remember(now, status)
            boats.append(history.boat(status))
        with self._lock:
            self._boats = tuple(boat for boat in boats if boat.status.name not in self._removed)


FROZEN_S = 300.0  # of a recording, worked on
GROWING_S = 30.0  # without a byte, and a recording no longer grows: it is flushed twice a second


def growing_recording(name: str, files: Sequence[Path]) -> Path:
    """The recording that a live gateway writes of a boat now; BadInput where there is none."""
    live = [file for file in files if file.suffix == ".mcap" and _age_s(file) < GROWING_S]
    for file in sorted(live, key=_age_s):
        try:
            about = Recording.open(file).metadata.get(METADATA, {})
        except ShadowError:
            continue  # of another program, or only just begun
        if LIVE in about and about.get("vessel") == name:
            return file
    raise BadInput(
        f"{name}: no recording of it grows in a folder that the studio was given: start it with "
        "--folder, the folder into which `shadow live` records (its --out)"
    )


def _age_s(file: Path) -> float:
    """Time since it was written to [s]."""
    return time.time() - file.stat().st_mtime


@dataclass(frozen=True)
class Frozen:
    """The last minutes of a growing recording, and the vessel file that its gateway uses."""

    file: Path
    vessel: str


def freeze_task(send: Send, path: str, folder: str) -> Frozen:
    """Copy the last minutes of a growing recording, and all parameters, into a folder."""
    send("keeping the last minutes")
    recording = Recording.open(Path(path))
    ends = [int(block.log_time_ns.max()) for block in recording.blocks() if len(block.log_time_ns)]
    since = max(ends, default=0) - round(FROZEN_S * 1e9)

    def is_kept(block: Block) -> NDArray[np.bool_]:
        raw = [number for number, channel in block.channels.items() if channel.topic == RAW]
        frames = np.flatnonzero(np.isin(block.channel, raw) & (block.end > block.start))
        kind = message_keys(block.data, block.start[frames], block.end[frames])[:, 2]
        kept = block.log_time_ns >= since
        kept[frames[kind == ids_by_name()["PARAM_VALUE"]]] = True
        return kept

    stem = re.sub(r"[^\w.+-]", "_", recording.path.stem)
    file = Path(folder) / f"{stem}-until-{time.strftime('%H%M%S')}.mcap"
    whole = file.with_suffix(".part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with whole.open("wb") as stream:
            rewrite(recording, Writer(stream, compression=CompressionType.ZSTD), is_kept)
        whole.replace(file)
    except OSError as error:
        raise ShadowError(f"{file.name}: cannot be kept: {error.strerror or error}") from error
    finally:
        whole.unlink(missing_ok=True)
    return Frozen(file, recording.attachments["vessel.toml"].data.decode())
