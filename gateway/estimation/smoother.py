"""Backward pass of a fixed-interval smoother.

Bryson and Frazier's form of the Rauch-Tung-Striebel smoother, modified by Bierman: it carries the
information of the future as λ (13,) and Λ (13, 13) and needs no inverse of a covariance:

    over a measurement  λ ← λ − Hᵀ (S⁻¹ y + Kᵀ λ)    Λ ← (I − K H)ᵀ Λ (I − K H) + Hᵀ S⁻¹ H
    over a prediction   λ ← Fᵀ λ                      Λ ← Fᵀ Λ F
    smoothed            x − P λ                       P − P Λ P

with x, P after the filter's own update. Source: G. J. Bierman, Fixed interval smoothing with
discrete measurements, International Journal of Control 18(1), 1973.

Motion from a whole recording: forward with the filter's own step, and back.

Memory stays bounded over hours: the forward pass keeps its state once per chunk of steps, and the
backward pass goes through one chunk after another, running each forward again.

In an outage the filter's yaw is soon so bad that nothing linearised at it is true. So all is done
twice: the second pass is linearised along the path of the first (an iterated smoother: B. M. Bell,
The iterated Kalman smoother as a Gauss-Newton method, SIAM Journal on Optimization 4(3), 1994).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation import GATE_RECORDS, KINDS, STATES, FilterModel, FilterSettings, Flag, State
from gateway.estimation.events import (
    NO_GRID,
    Events,
    KalmanState,
    Timeline,
    initialise,
    timelines,
    update_gated,
    valid,
)
from gateway.estimation.filter import add_heading_error
from gateway.estimation.model import (
    COLUMNS,
    ROWS,
    Event,
    Workspace,
    copy_matrix,
    new_workspace,
    predict,
    predict_about,
    symmetrise,
)
from sim.kernel.compiled import compiled
from sim.kernel.rows import set_row
from sim.state import Floats, Ints
from sim.trial import MOTION


class Trace(NamedTuple):
    """What the forward pass keeps of each of its n steps.

    x (n, 13), P (n, 13, 13) after the step; F (n, 13, 13), H (n, 2, 13), K (n, 13, 2),
    S_inv (n, 2, 2), y (n, 2), components used (n,), valid (n,)
    """

    x: Floats
    P: Floats
    F: Floats
    H: Floats
    K: Floats
    S_inv: Floats
    y: Floats
    used: Ints
    valid: Ints


def new_trace(size: int) -> Trace:
    """Room for that many steps."""
    s = STATES
    shapes = ((s,), (s, s), (s, s), (2, s), (s, 2), (2, 2), (2,))
    flags = [np.zeros(size, np.int64) for _ in range(2)]
    return Trace(*(np.zeros((size, *shape)) for shape in shapes), *flags)


@compiled
def store_step(trace: Trace, n: int, state: KalmanState, used: int, work: Workspace) -> None:
    """Keeps step n."""
    set_row(trace.x[n], state.x)
    copy_matrix(state.P, trace.P[n])
    copy_matrix(work.F, trace.F[n])
    trace.used[n], trace.valid[n] = used, valid(state.gates)
    if used:
        copy_matrix(work.H, trace.H[n])
        copy_matrix(work.K, trace.K[n])
        copy_matrix(work.S_inv, trace.S_inv[n])
        set_row(trace.y[n], work.y)


@compiled
def smoothed_motion(
    x: Floats, P: Floats, lam: Floats, Lam: Floats, A: Floats, mean: Floats, cov: Floats
) -> None:
    """Filtered x, P and the future's λ, Λ -> motion (9,), covariance (9, 9); A (13, 13) scratch."""
    for i in range(MOTION):
        mean[i] = x[i]
        for j in range(STATES):
            mean[i] -= P[i, j] * lam[j]
            A[i, j] = 0.0
        for k in range(STATES):
            for j in range(STATES):
                A[i, j] += P[i, k] * Lam[k, j]
    for i in range(MOTION):
        for j in range(MOTION):
            cov[i, j] = P[i, j]
            for k in range(STATES):
                cov[i, j] -= A[i, k] * P[j, k]
    symmetrise(cov)


@compiled
def backward_update(trace: Trace, n: int, lam: Floats, Lam: Floats, work: Workspace) -> None:
    """λ (13,), Λ (13, 13) before the measurement of step n, in place."""
    H, K, S_inv, y, W = trace.H[n], trace.K[n], trace.S_inv[n], trace.y[n], work.PH
    m = trace.used[n]
    for a in range(m):
        pull = 0.0
        for b in range(m):
            pull += S_inv[a, b] * y[b]
        for i in range(STATES):
            pull += K[i, a] * lam[i]
            W[i, a] = 0.0
            for j in range(STATES):
                W[i, a] += Lam[i, j] * K[j, a]
        work.R[a] = pull
    for a in range(m):
        for i in range(STATES):
            lam[i] -= H[a, i] * work.R[a]
    for a in range(m):
        for b in range(m):
            G = S_inv[a, b]
            for i in range(STATES):
                G += K[i, a] * W[i, b]
            for i in range(STATES):
                if H[a, i] != 0.0:
                    for j in range(STATES):
                        Lam[i, j] += H[a, i] * G * H[b, j]
    for a in range(m):
        for j in range(STATES):
            if H[a, j] != 0.0:
                for i in range(STATES):
                    Lam[i, j] -= W[i, a] * H[a, j]
                    Lam[j, i] -= W[i, a] * H[a, j]


@compiled
def transpose_times(F: Floats, x: Floats) -> None:
    """x (13,) becomes Fᵀ x in place, last column first: F is that of `model.transition`."""
    for i in range(State.U_DOT, STATES):
        x[i] *= F[i, i]
    for n in range(len(ROWS) - 1, -1, -1):
        x[COLUMNS[n]] += F[ROWS[n], COLUMNS[n]] * x[ROWS[n]]


@compiled
def backward_prediction(F: Floats, lam: Floats, Lam: Floats) -> None:
    """λ (13,), Λ (13, 13) before a prediction with transition F, in place."""
    transpose_times(F, lam)
    for k in range(STATES):
        transpose_times(F, Lam[k, :])
    for k in range(STATES):
        transpose_times(F, Lam[:, k])
    symmetrise(Lam)


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


class GridMotion(NamedTuple):
    """Motion on the grid as it is filled: mean (T, 9), covariance (T, 9, 9), known (T,)."""

    mean: Floats
    covariance: Floats
    known: NDArray[np.bool_]


def smooth(
    events: Events, grid_times: Floats, settings: FilterSettings | None = None
) -> SmoothedMotion:
    """Events in any order, ascending grid times (T,) [s] -> motion on that grid."""
    settings = settings or FilterSettings()
    model = settings.kernel_model()
    count = len(grid_times)
    out = GridMotion(
        np.zeros((count, MOTION)), np.zeros((count, MOTION, MOTION)), np.zeros(count, np.bool_)
    )
    gated = 0
    for line in timelines(events, np.asarray(grid_times, np.float64), settings):
        path = np.full((len(line.time), STATES), np.nan)
        for _ in range(PASSES):
            outliers = _smooth_stretch(line, model, path, out)
        gated += outliers
    _fill_unknown(out, model)
    mean = out.mean
    return SmoothedMotion(
        grid_times, mean[:, :3], mean[:, 3:6], mean[:, 6:], out.covariance, out.known, gated
    )


def _smooth_stretch(line: Timeline, model: FilterModel, path: Floats, out: GridMotion) -> int:
    """Fills the grid points of one stretch and its path (n, 13); how many events were gated.

    The path comes in as NaN, or as that of the pass before.
    """
    starts = range(0, len(line.time), CHUNK)
    states = [_new_state(model) for _ in range(len(starts) + 1)]  # before each chunk
    trace = new_trace(min(CHUNK, len(line.time)))
    gated = 0
    before = path.copy()
    for n, start in enumerate(starts):
        for after, now in zip(states[n + 1], states[n], strict=True):
            after[:] = now
        part = line.cut(slice(start, start + CHUNK))
        gated += forward(part, model, before, start, states[n + 1], trace)
    future = np.zeros(STATES), np.zeros((STATES, STATES))
    for n in range(len(starts) - 1, -1, -1):
        part = line.cut(slice(starts[n], starts[n] + CHUNK))
        if n < len(starts) - 1:  # the trace of the last chunk is there already
            forward(part, model, before, starts[n], states[n], trace)
        backward(part.grid, model, trace, future, path[starts[n] : starts[n] + CHUNK], out)
    return gated


def _new_state(model: FilterModel) -> KalmanState:
    """A state before any measurement."""
    arrays = np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros((KINDS, GATE_RECORDS))
    state = KalmanState(*arrays)
    initialise(state, model)
    return state


@compiled
def forward(
    line: Timeline, model: FilterModel, path: Floats, start: int, state: KalmanState, trace: Trace
) -> int:
    """The filter over n steps, in place, leaving its trace; how many events were gated.

    The first of them is step `start` of the path (…, 13) to linearise along, NaN: along itself.
    """
    work = new_workspace()
    moved = np.zeros(STATES)
    x, P = state.x, state.P
    gated = 0
    for n in range(len(line.time)):
        span = line.span[n] if state.gates[:, 0].any() else 0.0
        along = not np.isnan(path[start + n, 0])
        if span <= 0.0:
            set_identity(work.F)
        elif along:
            at = path[start + n - 1]
            predict_about(x, P, at, span, model, work.F, work.Q, moved)
        else:
            predict(x, P, span, model, work.F, work.Q)
        at = path[start + n] if along else x
        event = Event(line.time[n], line.kind[n], line.z[n], line.std[n])
        _, used, flags = update_gated(state, event, at, model, work)
        gated += 1 if flags & GATED else 0
        store_step(trace, n, state, used, work)
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
    future: tuple[Floats, Floats],
    path: Floats,
    out: GridMotion,
) -> None:
    """Back over n steps: future λ, Λ in place, fills the path (n, 13) and rows of the grid."""
    work = new_workspace()
    lam, Lam = future
    for n in range(len(grid) - 1, -1, -1):
        set_row(path[n], trace.x[n] - trace.P[n] @ lam)
        row = grid[n]
        if row != NO_GRID:
            mean, covariance = out.mean[row], out.covariance[row]
            smoothed_motion(trace.x[n], trace.P[n], lam, Lam, work.A, mean, covariance)
            add_heading_error(mean, model.heading_error_rad, covariance)
            out.known[row] = trace.valid[n] != 0
        if trace.used[n] > 0:
            backward_update(trace, n, lam, Lam, work)
        backward_prediction(trace.F[n], lam, Lam)


def _fill_unknown(out: GridMotion, model: FilterModel) -> None:
    """Holds the nearest known motion where there is none, with the std before any measurement."""
    rows, missing = np.flatnonzero(out.known), np.flatnonzero(~out.known)
    out.covariance[missing] = _new_state(model).P[:MOTION, :MOTION]
    if len(rows):
        after = np.clip(np.searchsorted(rows, missing), 0, len(rows) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.abs(rows[before] - missing) <= np.abs(rows[after] - missing)
        out.mean[missing] = out.mean[np.where(nearer, rows[before], rows[after])]
