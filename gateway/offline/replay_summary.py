"""What a replay did: how far the shadow stayed from the estimate, what force was missing."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gateway.ingest.log import Boat, Log, Statistics
from gateway.json_rows import TopicRows
from gateway.shadow.path import ShadowRows
from gateway.topics import JUDGING, MODEL_RIGHT
from sim.state import Floats

MIN_JUDGED = 0.01  # share of the rows: of fewer no missing force is told; chosen


class Warned(NamedTuple):
    """What the shadow warned of.

    judges  it is about whether the model is right
    over    it takes back that the model is wrong
    """

    says: str
    judges: bool = False
    over: bool = False


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay did."""

    log: str
    boat: str
    seconds: float
    rows: int
    wall_seconds: float
    rmse: Floats  # (6,) shadow − estimate while measured: north, east, yaw, u, v, r
    missing: Floats | None  # (3,) root mean square of the missing force [N, N, N m]; None: unjudged
    events: int
    recordings: tuple[Path, ...]
    notes: tuple[str, ...] = ()  # what was odd about the log
    warnings: tuple[Warned, ...] = ()  # in order

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
            "missing_force_rms": (
                {} if self.missing is None else dict(zip("XYN", self.missing.tolist(), strict=True))
            ),
            "events": self.events,
            "notes": self.notes,
            "warnings": [warned.says for warned in self.warnings],
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
    judged: int = 0  # those of them in which the data could judge: they have a missing force
    squares: Floats = field(default_factory=lambda: np.zeros(6))
    missing: Floats = field(default_factory=lambda: np.zeros(3))
    events: int = 0
    warnings: list[Warned] = field(default_factory=list)
    first_s: float = 0.0
    last_s: float = 0.0

    def add(self, outs: Iterable[ShadowRows], rows: Iterable[TopicRows]) -> None:
        """Add what the shadow did and the events among the rows of topics."""
        for out in outs:
            self._add_rows(out)
        for part in rows:
            if part.topic == "event":
                self.events += len(part)
                for one in map(json.loads, part.payloads):
                    over = one["kind"] == MODEL_RIGHT
                    if over or one["severity"] != "info":
                        self.warnings.append(Warned(one["says"], one["kind"] in JUDGING, over))

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
        missing = out.residuals.missing[out.fresh]
        known = np.isfinite(missing).all(axis=1)
        self.judged += int(known.sum())
        self.missing += (missing[known] ** 2).sum(axis=0)

    def summary(
        self, log: Log, boat: Boat, wall_seconds: float, files: tuple[Path, ...]
    ) -> ReplaySummary:
        """The sums as root mean squares."""
        count = max(self.compared, 1)
        enough = self.judged > MIN_JUDGED * self.compared
        missing = np.sqrt(self.missing / self.judged) if enough else None
        return ReplaySummary(
            log.path, str(boat), self.last_s - self.first_s, self.count,
            wall_seconds, np.sqrt(self.squares / count), missing,
            self.events, files, _notes(log.statistics), tuple(self.warnings),
        )  # fmt: skip
