"""What comes of a replay: frames and topics to a recording and to zenoh, and a summary."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.bus import Bus
from gateway.config import Settings
from gateway.ingest.log import Boat, Log, Statistics
from gateway.json_rows import TopicRows
from gateway.recording.file import Attachment
from gateway.recording.recorder import Recorder
from gateway.shadow.path import ShadowRows
from sim.state import Floats


class LinkFrames(NamedTuple):
    """Raw frames of one link, with their receive times."""

    link: str
    frames: list[bytes]
    receive_time_ns: Sequence[int] | NDArray[np.int64]


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
            if self.recorder is not None:
                self.recorder.write_rows(*part)
            if self.bus is not None and part.payloads:
                wanted = part.payloads if self.bus.wants(part.topic) else part.payloads[-1:]
                for payload in wanted:
                    self.bus.publish(part.topic, payload)

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

    def to_dict(self) -> dict[str, Any]:
        """What `shadow replay --json` prints of a log: SI units and radians."""
        channels = ("x", "y", "psi", "u", "v", "r")
        return {
            "log": self.log,
            "boat": self.boat,
            "seconds": self.seconds,
            "rows": self.rows,
            "wall_seconds": self.wall_seconds,
            "following_rmse": dict(zip(channels, self.rmse.tolist(), strict=True)),
            "missing_force_rms": dict(zip("XYN", self.missing.tolist(), strict=True)),
            "events": self.events,
            "notes": self.notes,
            "recordings": [str(path) for path in self.recordings],
        }


def _notes(statistics: Statistics) -> tuple[str, ...]:
    """What a user should know about the log that was replayed."""
    odd = {
        "bytes were no message": statistics.junk_bytes,
        "messages had a wrong checksum": statistics.bad_checksum,
    }
    notes = [f"{count} {what}" for what, count in odd.items() if count]
    if statistics.truncated_tail:
        notes.append("the log is cut off at its end: read up to there")
    return (*notes, *statistics.notes)


@dataclass
class ReplayTotals:
    """Sums over the rows of a replay, for its summary."""

    count: int = 0
    compared: int = 0  # rows while telemetry was fresh, which the sums of squares are of
    squares: Floats = field(default_factory=lambda: np.zeros(6))
    missing: Floats = field(default_factory=lambda: np.zeros(3))
    events: int = 0
    first_s: float = 0.0
    last_s: float = 0.0

    def add(self, step: ReplayStep) -> None:
        """Add rows and events of a step."""
        for out in step.outs:
            self._add_rows(out)
        self.events += sum(len(part.payloads) for part in step.rows if part.topic == "event")

    def _add_rows(self, out: ShadowRows) -> None:
        if not len(out):
            return
        self.first_s = self.first_s if self.count else float(out.time_s[0])
        self.last_s = float(out.time_s[-1])
        self.count += len(out)
        error = (out.shadow - out.estimate)[out.fresh, :6]
        error[:, 2] = (error[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        self.compared += len(error)
        self.squares += (error**2).sum(axis=0)
        self.missing += (out.residuals.missing[out.fresh] ** 2).sum(axis=0)

    def summary(
        self, log: Log, boat: Boat, wall_seconds: float, files: tuple[Path, ...]
    ) -> ReplaySummary:
        """The sums as root mean squares."""
        count = max(self.compared, 1)
        return ReplaySummary(
            log.path, str(boat), self.last_s - self.first_s, self.count,
            wall_seconds, np.sqrt(self.squares / count), np.sqrt(self.missing / count),
            self.events, files, _notes(log.statistics),
        )  # fmt: skip
