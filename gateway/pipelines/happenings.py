"""What happened on the path, in words: the rows of the event topic."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.estimator import Rows
from gateway.estimation.names import Flag
from gateway.pipelines.feed import Feed
from gateway.pipelines.path import BROKEN, Shadowing, discontinuous
from gateway.pipelines.rows import Happening


@dataclass(frozen=True)
class Watchman:
    """Knows how things stood after the last row, so that each change is told once."""

    started: bool = False
    fresh: bool = True
    modelled: bool = False
    bound: bool = False

    def observe(self, feed: Feed, rows: Rows, out: Shadowing) -> tuple["Watchman", list[Happening]]:
        """A chunk of the path -> how things stand now, and what happened, in order."""
        told: list[Happening] = []
        first = 0 if self.started else int(out.row[0]) + 1 if len(out) else len(rows)
        if not self.started and len(out):
            told.append(_at(out, 0, "started", "info", "the first estimate is there"))
        if (rows.flags & BROKEN).any():
            told += _breaks(feed, rows, first)
        told += self._changes(out, out.fresh, self.fresh, _TELEMETRY)
        told += self._changes(out, out.from_model, self.modelled, _REFERENCE)
        told += self._changes(out, out.bound, self.bound, _LIMITS)
        told.sort(key=lambda h: h.receive_time_ns)
        if not len(out):
            return self, told
        stands = bool(out.fresh[-1]), bool(out.from_model[-1]), bool(out.bound[-1])
        return Watchman(True, *stands), told

    def _changes(
        self, out: Shadowing, now: NDArray[np.bool_], before: bool, words: "_Words"
    ) -> list[Happening]:
        if now.all() if before else not now.any():
            return []
        changed = np.flatnonzero(np.diff(np.append(before, now).astype(np.int8)) != 0)
        return [_at(out, int(k), *words[bool(now[k])]) for k in changed]


def _breaks(feed: Feed, rows: Rows, first: int) -> list[Happening]:
    """Jumps and restarts; before the first estimate there is nothing to interrupt."""
    return [
        Happening(int(feed.vehicle_time_ns[k]), int(feed.receive_time_ns[k]), *words)
        for flags, words in ((discontinuous(feed, rows), _JUMP), (rows.has(Flag.RESTART), _RESTART))
        for k in np.flatnonzero(flags)
        if k >= first
    ]


def _at(out: Shadowing, k: int, kind: str, severity: str, says: str) -> Happening:
    return Happening(int(out.vehicle_time_ns[k]), int(out.receive_time_ns[k]), kind, severity, says)


_Words = dict[bool, tuple[str, str, str]]

_TELEMETRY: _Words = {
    True: ("telemetry_back", "info", "telemetry is fresh again"),
    False: ("telemetry_silent", "warning", "the boat no longer tells its heading and velocity"),
}
_REFERENCE: _Words = {
    True: ("reference_model", "info", "the shadow follows the vessel's own prediction now"),
    False: ("reference_measured", "info", "the shadow follows the measurement now"),
}
_LIMITS: _Words = {
    True: ("limits_bind", "warning", "the plant's thrust limits bind: it cannot follow"),
    False: ("limits_free", "info", "the plant's thrust limits no longer bind"),
}
_JUMP = ("jump", "warning", "the source jumped: a discontinuity, not motion")
_RESTART = ("restart", "warning", "the filter started afresh: long silence or a new clock")
