"""Measurements as events: in order of receipt for the filter, of time for the smoother.

One event of the filter is a prediction to its time, a gate, a measurement update.

A measurement that fails the gate again and again, for long enough, is a discontinuity of its
source (a yaw reset, a lane switch, a shifted origin) and not motion: noise is added to the states
that it measures, and it is used. A gyro has no discontinuities: when a few of its measurements in a
row fail, the boat has begun to turn faster than was assumed, and they are used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation import (
    KINDS,
    STATES,
    FilterModel,
    FilterSettings,
    Flag,
    GateRecord,
    MeasurementKind,
    State,
)
from gateway.estimation.model import (
    Event,
    Workspace,
    innovation_covariance,
    linearise,
    predict,
    update,
)
from gateway.estimation.scatter import noise_factor, observe_noise
from gateway.samples import Quantity, Samples
from sim.kernel.compiled import compiled
from sim.state import Floats, Ints, wrap

KIND_OF = {
    Quantity.YAW: MeasurementKind.YAW,
    Quantity.YAW_RATE: MeasurementKind.YAW_RATE,
    Quantity.VELOCITY: MeasurementKind.VELOCITY,
    Quantity.POSITION: MeasurementKind.POSITION,
    Quantity.BODY_VELOCITY: MeasurementKind.BODY_VELOCITY,
}


@dataclass(frozen=True)
class Events:
    """K measurements in order of receipt.

    time_s  (K,)    the boat's clock, seconds after an epoch fixed for the session
    kind    (K,)    `MeasurementKind`
    z       (K, 2)  values in the unit of the kind; the second is unused where there is one
    std     (K, 2)  of the white part of their errors
    """

    time_s: Floats
    kind: NDArray[np.int64]
    z: Floats
    std: Floats

    def __post_init__(self) -> None:
        shapes = (self.time_s.shape, self.kind.shape, self.z.shape, self.std.shape)
        count = len(self.time_s)
        if shapes != ((count,), (count,), (count, 2), (count, 2)):
            raise ValueError(f"events: shapes {shapes} do not belong together")

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, part: slice | NDArray[np.generic]) -> "Events":
        return Events(*(column[part] for column in vars(self).values()))

    def thinned(self, rate_hz: float) -> "Events":
        """The first of each kind in each step of time."""
        step = np.floor(self.time_s * rate_hz)
        _, first = np.unique(np.column_stack([self.kind, step]), axis=0, return_index=True)
        return self[np.sort(first)]


def make_events(kind: MeasurementKind, time_s: Floats, z: Floats, std: float) -> Events:
    """Measurements of one kind: times (K,) [s], values (K,) or (K, 1) or (K, 2), one std."""
    count = len(time_s)
    values = np.zeros((count, 2))
    columns = np.asarray(z, float)
    columns = columns[:, np.newaxis] if columns.ndim == 1 else columns
    values[:, : columns.shape[1]] = columns
    return Events(
        np.asarray(time_s, float),
        np.full(count, int(kind), np.int64),
        values,
        np.full((count, 2), float(std)),
    )


def ticks(time_s: Floats) -> Events:
    """Times (K,) [s] at which only a prediction is wanted."""
    return make_events(MeasurementKind.TICK, time_s, np.zeros(len(time_s)), 1.0)


def join(parts: Sequence[Events]) -> Events:
    """All events of the parts, one part after another."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return Events(*(np.concatenate(column) for column in columns))


def from_samples(columns: Sequence[Samples], settings: FilterSettings, epoch_ns: int) -> Events:
    """Columns of a log -> events in the order of the log, without quantities that are not measured.

    The caller chooses one source per quantity.
    """
    chosen = [samples for samples in columns if samples.quantity in KIND_OF and len(samples)]
    if not chosen:
        return ticks(np.zeros(0))
    parts = [_from_one(samples, settings, epoch_ns) for samples in chosen]
    order = np.concatenate([samples.order for samples in chosen])
    # of the facts in one message, yaw stands before what depends on it
    kinds = np.concatenate([part.kind for part in parts])
    return join(parts)[np.lexsort((kinds, order))]


def _from_one(samples: Samples, settings: FilterSettings, epoch_ns: int) -> Events:
    kind = KIND_OF[samples.quantity]
    white = settings.white_std(kind, samples.equivalent)
    return make_events(kind, samples.seconds(epoch_ns), samples.values, white)


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


def timelines(events: Events, grid: Floats, settings: FilterSettings) -> Iterator[Timeline]:
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


# Chosen, not measured: what follows is far beyond the motion of a boat.
LOST_YAW = 0.5  # rad, std of a heading with which nothing that turns with it can be used
JUMP_POSITION = 1e3  # m, std that is added after a discontinuity
JUMP_SPEED = 5.0  # m/s
JUMP_YAW = 3.0  # rad
JUMP_YAW_RATE = 2.0  # rad/s
TURN_RUN = 2  # gated yaw rates in a row that are a turn

# Largest credible measurement by kind [none, rad, rad/s, m/s, m, m/s]
IMPLAUSIBLE = np.array([0.0, 1e4, 50.0, 100.0, 1e7, 100.0])


class KalmanState(NamedTuple):
    """Mean x (13,), covariance P (13, 13) and gates (7, 13) of the filter at one time."""

    x: Floats
    P: Floats
    gates: Floats


USED, GATED, WAITING = int(Flag.USED), int(Flag.GATED), int(Flag.WAITING)
VALID, JUMP = int(Flag.VALID), int(Flag.JUMP)


@compiled
def initialise(state: KalmanState, model: FilterModel) -> None:
    """The state becomes that before any measurement."""
    P = state.P
    state.x[:] = 0.0
    P[:] = 0.0
    state.gates[:] = 0.0
    P[State.NORTH, State.NORTH] = P[State.EAST, State.EAST] = model.prior_position_m**2
    P[State.YAW, State.YAW] = np.pi**2
    P[State.U, State.U] = P[State.V, State.V] = model.prior_speed_mps**2
    P[State.R, State.R] = model.prior_yaw_rate_radps**2
    P[State.U_DOT, State.U_DOT] = model.surge_acceleration_mps2**2
    P[State.V_DOT, State.V_DOT] = model.sway_acceleration_mps2**2
    P[State.R_DOT, State.R_DOT] = model.yaw_acceleration_radps2**2
    P[State.POSITION_ERROR_NORTH, State.POSITION_ERROR_NORTH] = model.position_error_m**2
    P[State.POSITION_ERROR_EAST, State.POSITION_ERROR_EAST] = model.position_error_m**2
    P[State.VELOCITY_ERROR_FIRST, State.VELOCITY_ERROR_FIRST] = model.velocity_error_mps**2
    P[State.VELOCITY_ERROR_SECOND, State.VELOCITY_ERROR_SECOND] = model.velocity_error_mps**2


@compiled
def valid(gates: Floats) -> int:
    """Flag.VALID once yaw and velocity or position are known, else 0."""
    seen = gates[:, GateRecord.SEEN]
    moving = seen[MeasurementKind.VELOCITY] + seen[MeasurementKind.BODY_VELOCITY]
    if seen[MeasurementKind.YAW] > 0.0 and moving + seen[MeasurementKind.POSITION] > 0.0:
        return VALID
    return 0


@compiled
def predict_over(state: KalmanState, span: float, model: FilterModel, work: Workspace) -> None:
    """Predicts over span [s] in steps short enough for the linearisation."""
    steps = int(np.ceil(span / model.max_step_s - 1e-9))
    for _ in range(steps):
        predict(state.x, state.P, span / steps, model, work.F, work.Q)


@compiled
def implausible(event: Event, components: int) -> bool:
    """Whether a measurement or its std is no number or beyond any boat."""
    for a in range(components):
        if not (np.isfinite(event.z[a]) and np.abs(event.z[a]) <= IMPLAUSIBLE[event.kind]):
            return True
        if not (np.isfinite(event.std[a]) and event.std[a] > 0.0):
            return True
    return False


@compiled
def inflate_covariance(kind: int, since: float, P: Floats) -> None:
    """Adds the noise of a discontinuity, gated for `since` [s], to the states that are measured."""
    if kind == MeasurementKind.YAW:
        P[State.YAW, State.YAW] += JUMP_YAW**2
    elif kind == MeasurementKind.YAW_RATE:
        P[State.R, State.R] += JUMP_YAW_RATE**2
        P[State.YAW, State.YAW] += (JUMP_YAW_RATE * since) ** 2
    elif kind == MeasurementKind.POSITION:
        P[State.NORTH, State.NORTH] += JUMP_POSITION**2
        P[State.EAST, State.EAST] += JUMP_POSITION**2
    else:
        P[State.U, State.U] += JUMP_SPEED**2
        P[State.V, State.V] += JUMP_SPEED**2


@compiled
def is_discontinuity(event: Event, gate: Floats, model: FilterModel) -> bool:
    """Counts an outlier in the gate (13,) of its kind; whether that is a discontinuity by now."""
    if gate[GateRecord.GATED_RUN] == 0.0:
        gate[GateRecord.GATED_SINCE] = event.time
    gate[GateRecord.GATED_RUN] += 1.0
    if event.kind == MeasurementKind.YAW_RATE:
        return bool(gate[GateRecord.GATED_RUN] >= TURN_RUN)
    long_enough = event.time - gate[GateRecord.GATED_SINCE] >= model.gated_for_s
    return bool(long_enough and gate[GateRecord.GATED_RUN] >= model.gated_in_a_row)


@compiled
def move_innovation(x: Floats, at: Floats, m: int, work: Workspace) -> None:
    """The innovation in `work`, taken at another state (13,), becomes that at x (13,)."""
    for a in range(m):
        for i in range(STATES):
            work.y[a] -= work.H[a, i] * (x[i] - at[i])


@compiled
def update_gated(
    state: KalmanState, event: Event, at: Floats, model: FilterModel, work: Workspace
) -> tuple[float, int, int]:
    """Gates and uses one measurement at its time -> NIS, components used (0: none), flags.

    `at` is the mean (13,) to linearise at: the state's own, or one that is known better.
    """
    x, P, kind = state.x, state.P, event.kind
    yaw_seen, gate = state.gates[MeasurementKind.YAW, GateRecord.SEEN], state.gates[kind]
    m = linearise(kind, at, event.z, model.gyro_delay_s, work.H, work.y)
    if m == 0:
        return 0.0, 0, 0
    move_innovation(x, at, m, work)
    if implausible(event, m):
        return 0.0, 0, GATED
    if kind == MeasurementKind.YAW and yaw_seen == 0.0:
        x[State.YAW] = wrap(event.z[0])
        work.y[0] = 0.0
    elif kind != MeasurementKind.YAW and (yaw_seen == 0.0 or P[State.YAW, State.YAW] > LOST_YAW**2):
        return 0.0, 0, WAITING
    factor = noise_factor(gate)
    work.R[0], work.R[1] = factor * event.std[0] ** 2, factor * event.std[1] ** 2
    if kind == MeasurementKind.YAW_RATE:  # what is not known of its delay
        squared = at[State.R_DOT] ** 2 + P[State.R_DOT, State.R_DOT]  # mean of it [rad²/s⁴]
        work.R[0] += model.gyro_delay_std_s**2 * squared
    nis = innovation_covariance(P, m, work)
    observe_noise(gate, event, m, model, work)
    flags = USED
    bound = model.gate_one if m == 1 else model.gate_two
    if nis > bound and gate[GateRecord.SEEN] > 0.0:
        if not is_discontinuity(event, gate, model):
            return nis, 0, GATED
        inflate_covariance(kind, event.time - gate[GateRecord.GATED_SINCE], P)
        innovation_covariance(P, m, work)
        flags |= JUMP
    gate[GateRecord.SEEN] = 1.0
    gate[GateRecord.GATED_RUN] = 0.0
    update(x, P, m, work)
    return nis, m, flags
