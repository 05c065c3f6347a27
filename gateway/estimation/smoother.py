"""Motion from a whole recording: forward with the filter's own step, and back.

Memory stays bounded over hours: the forward pass keeps its state once per chunk of steps, and the
way back goes through one chunk after another, running each forward again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.backward import (
    Trace,
    back_over_prediction,
    back_over_reading,
    keep,
    new_trace,
    smoothed,
)
from gateway.estimation.events import Events
from gateway.estimation.history import Ints
from gateway.estimation.jit import compiled
from gateway.estimation.motion import predict
from gateway.estimation.names import KINDS, RECORDS, STATES, Flag
from gateway.estimation.settings import FilterSettings, Model
from gateway.estimation.step import begin, take_in, valid
from gateway.estimation.timeline import NO_GRID, Timeline, segments
from gateway.estimation.uncertainty import add_heading_error
from gateway.estimation.update import Work, new_work
from sim.state import Floats
from sim.trial import MOTION

CHUNK = 1024  # steps held in memory at once
GATED = int(Flag.GATED)


@dataclass(frozen=True)
class SmoothedMotion:
    """Motion on a grid, from everything before and after each moment.

    time        (T,)       s after the events' epoch
    eta         (T, 3)     north [m], east [m], yaw [rad, continuous]
    nu          (T, 3)     u [m/s], v [m/s], r [rad/s]
    nu_dot      (T, 3)     m/s², m/s², rad/s²
    covariance  (T, 9, 9)  of (eta, nu, nu_dot)
    known       (T,)       False: no telemetry at all; the nearest motion held, its std the prior's
    gated       events left out as outliers
    """

    time: Floats
    eta: Floats
    nu: Floats
    nu_dot: Floats
    covariance: Floats
    known: NDArray[np.bool_]
    gated: int


def smooth(
    events: Events, grid_times: Floats, settings: FilterSettings | None = None
) -> SmoothedMotion:
    """Events in any order, ascending grid times (T,) [s] -> motion on that grid."""
    settings = settings or FilterSettings()
    model = settings.model()
    mean = np.zeros((len(grid_times), MOTION))
    covariance = np.zeros((len(grid_times), MOTION, MOTION))
    known = np.zeros(len(grid_times), np.bool_)
    gated = 0
    for timeline in segments(events, np.asarray(grid_times, np.float64), settings):
        gated += _smooth_segment(timeline, model, mean, covariance, known)
    _fill_unknown(mean, covariance, known, model)
    return SmoothedMotion(
        grid_times, mean[:, :3], mean[:, 3:6], mean[:, 6:], covariance, known, gated
    )


def _smooth_segment(
    line: Timeline, model: Model, mean: Floats, covariance: Floats, known: NDArray[np.bool_]
) -> int:
    """Fills the grid points of one segment; how many events were gated."""
    starts = range(0, len(line.time), CHUNK)
    x, P = np.zeros((len(starts) + 1, STATES)), np.zeros((len(starts) + 1, STATES, STATES))
    book = np.zeros((len(starts) + 1, KINDS, RECORDS))
    begin(x[0], P[0], book[0], model)
    trace = new_trace(min(CHUNK, len(line.time)))
    gated = 0
    for n, start in enumerate(starts):
        x[n + 1], P[n + 1], book[n + 1] = x[n], P[n], book[n]
        part = line.cut(slice(start, start + CHUNK))
        gated += forward(part, model, x[n + 1], P[n + 1], book[n + 1], trace)
    lam, Lam = np.zeros(STATES), np.zeros((STATES, STATES))
    for n in range(len(starts) - 1, -1, -1):
        part = line.cut(slice(starts[n], starts[n] + CHUNK))
        if n < len(starts) - 1:  # the trace of the last chunk is there already
            forward(part, model, x[n], P[n], book[n], trace)
        backward(part.grid, model, trace, lam, Lam, mean, covariance, known)
    return gated


@compiled
def forward(line: Timeline, model: Model, x: Floats, P: Floats, book: Floats, trace: Trace) -> int:
    """The filter over n steps, in place, leaving its trace; how many events were gated."""
    work = new_work()
    gated = 0
    for n in range(len(line.time)):
        move(x, P, line.span[n] if book[:, 0].any() else 0.0, model, work)
        _, used, flags = take_in(
            x, P, book, line.time[n], line.kind[n], line.z[n], line.std[n], model, work
        )
        gated += 1 if flags & GATED else 0
        keep(trace, n, x, P, used, valid(book), work)
    return gated


@compiled
def move(x: Floats, P: Floats, span: float, model: Model, work: Work) -> None:
    """One prediction, or none; leaves its transition in `work`."""
    if span > 0.0:
        predict(x, P, span, model, work.F, work.Q)
        return
    work.F[:] = 0.0
    for i in range(STATES):
        work.F[i, i] = 1.0


@compiled
def backward(
    grid: Ints,
    model: Model,
    trace: Trace,
    lam: Floats,
    Lam: Floats,
    mean: Floats,
    covariance: Floats,
    known: NDArray[np.bool_],
) -> None:
    """Back over n steps, λ and Λ in place, filling the rows of the output that lie on the way."""
    work = new_work()
    for n in range(len(grid) - 1, -1, -1):
        row = grid[n]
        if row != NO_GRID:
            smoothed(trace.x[n], trace.P[n], lam, Lam, work.A, mean[row], covariance[row])
            add_heading_error(mean[row], model.heading_sigma, covariance[row])
            known[row] = trace.valid[n] != 0
        if trace.used[n] > 0:
            back_over_reading(trace, n, lam, Lam, work)
        back_over_prediction(trace.F[n], lam, Lam)


def _fill_unknown(mean: Floats, covariance: Floats, known: NDArray[np.bool_], model: Model) -> None:
    """Holds the nearest known motion where there is none, with the std of not knowing."""
    x, P, book = np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros((KINDS, RECORDS))
    begin(x, P, book, model)
    rows = np.flatnonzero(known)
    missing = np.flatnonzero(~known)
    covariance[missing] = P[:MOTION, :MOTION]
    if len(rows):
        after = np.clip(np.searchsorted(rows, missing), 0, len(rows) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.abs(rows[before] - missing) <= np.abs(rows[after] - missing)
        mean[missing] = mean[np.where(nearer, rows[before], rows[after])]
    else:
        mean[missing] = 0.0
