"""Events and grid in one line of steps, in order of the boat's time, cut where telemetry rests."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gateway.estimation.events import Events, join, ticks
from gateway.estimation.names import KINDS
from gateway.estimation.settings import FilterSettings
from sim.state import Floats, Ints

NO_GRID = -1


class Timeline(NamedTuple):
    """n steps: time (n,), span since the step before (n,) [s], the event, the row of the grid."""

    time: Floats
    span: Floats
    kind: Ints
    z: Floats
    std: Floats
    grid: Ints

    def cut(self, part: slice) -> "Timeline":
        """Some of the steps."""
        return Timeline._make(column[part] for column in self)


def segments(events: Events, grid: Floats, settings: FilterSettings) -> Iterator[Timeline]:
    """The stretches without a gap longer than the filter bridges, each with its grid points."""
    usable = np.isfinite(events.time_s) & (events.kind >= 0) & (events.kind < KINDS)
    events = events[usable]
    events = events[np.lexsort((events.kind, events.time_s))]
    cuts = np.flatnonzero(np.diff(events.time_s) > settings.gap_s) + 1
    for part in np.split(np.arange(len(events)), cuts):
        if len(part):
            yield _merge(events[part], grid, settings.max_step_s)


def _merge(events: Events, grid: Floats, max_step_s: float) -> Timeline:
    """Events of one stretch, the grid points inside it, and steps between where they are far."""
    first, last = events.time_s[[0, -1]]
    rows = np.flatnonzero((grid >= first) & (grid <= last))
    filler = _between(np.sort(np.concatenate([events.time_s, grid[rows]])), max_step_s)
    line = join([events, ticks(grid[rows]), ticks(filler)])
    row = np.full(len(line), NO_GRID)
    row[len(events) : len(events) + len(rows)] = rows
    order = np.argsort(line.time_s, kind="stable")
    line, row = line[order], row[order]
    span = np.diff(line.time_s, prepend=line.time_s[0])
    return Timeline(line.time_s, span, line.kind, line.z, line.std, row)


def _between(times: Floats, max_step_s: float) -> Floats:
    """Ascending times (n,) [s] -> times that cut their gaps into steps short enough."""
    step = np.diff(times)
    pieces = np.ceil(step / max_step_s - 1e-9).astype(np.int64)
    wide = np.flatnonzero(pieces > 1)
    parts = [times[k] + step[k] * np.arange(1, pieces[k]) / pieces[k] for k in wide]
    return np.concatenate(parts) if parts else np.zeros(0)
