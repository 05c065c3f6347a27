"""Motion from a whole recording: forward with the filter's own step, and back.

Memory stays bounded over hours: the forward pass keeps its state once per chunk of steps, and the
backward pass goes through one chunk after another, running each forward again.

In an outage the filter's yaw is soon so bad that nothing linearised at it is true. So all is done
twice: the second pass is linearised along the path of the first (an iterated smoother: B. M. Bell,
The iterated Kalman smoother as a Gauss-Newton method, SIAM Journal on Optimization 4(3), 1994).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.backward import (
    Trace,
    backward_prediction,
    backward_update,
    new_trace,
    smoothed_motion,
    store_step,
)
from gateway.estimation.events import NO_GRID, Events, Timeline, timelines
from gateway.estimation.filter import add_heading_error
from gateway.estimation.measurement import new_workspace
from gateway.estimation.motion import predict, predict_about
from gateway.estimation.names import GATE_RECORDS, KINDS, STATES, Flag
from gateway.estimation.settings import FilterModel, FilterSettings
from gateway.estimation.step import initialise, update_gated, valid
from gateway.jit import compiled
from sim.state import Floats, Ints
from sim.trial import MOTION

CHUNK = 1024  # steps held in memory at once
PASSES = 2
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
    model = settings.kernel_model()
    mean = np.zeros((len(grid_times), MOTION))
    covariance = np.zeros((len(grid_times), MOTION, MOTION))
    known = np.zeros(len(grid_times), np.bool_)
    gated = 0
    for line in timelines(events, np.asarray(grid_times, np.float64), settings):
        path = np.full((len(line.time), STATES), np.nan)
        for _ in range(PASSES):
            outliers = _smooth_segment(line, model, path, mean, covariance, known)
        gated += outliers
    _fill_unknown(mean, covariance, known, model)
    return SmoothedMotion(
        grid_times, mean[:, :3], mean[:, 3:6], mean[:, 6:], covariance, known, gated
    )


def _smooth_segment(
    line: Timeline,
    model: FilterModel,
    path: Floats,
    mean: Floats,
    covariance: Floats,
    known: NDArray[np.bool_],
) -> int:
    """Fills the grid points of one segment and its path (n, 13); how many events were gated.

    The path comes in as NaN, or as that of the pass before.
    """
    starts = range(0, len(line.time), CHUNK)
    x, P = np.zeros((len(starts) + 1, STATES)), np.zeros((len(starts) + 1, STATES, STATES))
    gates = np.zeros((len(starts) + 1, KINDS, GATE_RECORDS))
    initialise(x[0], P[0], gates[0], model)
    trace = new_trace(min(CHUNK, len(line.time)))
    gated = 0
    before = path.copy()
    for n, start in enumerate(starts):
        x[n + 1], P[n + 1], gates[n + 1] = x[n], P[n], gates[n]
        part = line.cut(slice(start, start + CHUNK))
        gated += forward(part, model, before, start, x[n + 1], P[n + 1], gates[n + 1], trace)
    lam, Lam = np.zeros(STATES), np.zeros((STATES, STATES))
    for n in range(len(starts) - 1, -1, -1):
        part = line.cut(slice(starts[n], starts[n] + CHUNK))
        if n < len(starts) - 1:  # the trace of the last chunk is there already
            forward(part, model, before, starts[n], x[n], P[n], gates[n], trace)
        here = path[starts[n] : starts[n] + CHUNK]
        backward(part.grid, model, trace, lam, Lam, here, mean, covariance, known)
    return gated


@compiled
def forward(
    line: Timeline,
    model: FilterModel,
    path: Floats,
    start: int,
    x: Floats,
    P: Floats,
    gates: Floats,
    trace: Trace,
) -> int:
    """The filter over n steps, in place, leaving its trace; how many events were gated.

    The first of them is step `start` of the path (…, 13) to linearise along, NaN: along itself.
    """
    work = new_workspace()
    moved = np.zeros(STATES)
    gated = 0
    for n in range(len(line.time)):
        span = line.span[n] if gates[:, 0].any() else 0.0
        along = not np.isnan(path[start + n, 0])
        if span <= 0.0:
            set_identity(work.F)
        elif along:
            at = path[start + n - 1]
            predict_about(x, P, at, span, model, work.F, work.Q, moved)
        else:
            predict(x, P, span, model, work.F, work.Q)
        at = path[start + n] if along else x
        _, used, flags = update_gated(
            x, P, gates, line.time[n], line.kind[n], line.z[n], line.std[n], at, model, work
        )
        gated += 1 if flags & GATED else 0
        store_step(trace, n, x, P, used, valid(gates), work)
    return gated


@compiled
def set_identity(F: Floats) -> None:
    """The transition F (13, 13) over no time."""
    F[:] = 0.0
    for i in range(STATES):
        F[i, i] = 1.0


@compiled
def backward(
    grid: Ints,
    model: FilterModel,
    trace: Trace,
    lam: Floats,
    Lam: Floats,
    path: Floats,
    mean: Floats,
    covariance: Floats,
    known: NDArray[np.bool_],
) -> None:
    """Back over n steps, λ and Λ in place, filling the path (n, 13) and the grid's rows."""
    work = new_workspace()
    for n in range(len(grid) - 1, -1, -1):
        path[n] = trace.x[n] - trace.P[n] @ lam
        row = grid[n]
        if row != NO_GRID:
            smoothed_motion(trace.x[n], trace.P[n], lam, Lam, work.A, mean[row], covariance[row])
            add_heading_error(mean[row], model.heading_error_rad, covariance[row])
            known[row] = trace.valid[n] != 0
        if trace.used[n] > 0:
            backward_update(trace, n, lam, Lam, work)
        backward_prediction(trace.F[n], lam, Lam)


def _fill_unknown(
    mean: Floats, covariance: Floats, known: NDArray[np.bool_], model: FilterModel
) -> None:
    """Holds the nearest known motion where there is none, with the std before any measurement."""
    x, P, gates = np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros((KINDS, GATE_RECORDS))
    initialise(x, P, gates, model)
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
