"""How the usable time of a trial is divided: stretches, blocks, and segments for free runs.

How an error of the start state propagates: the model linearised along the measured track.

    A_k = ∂ reported(t_k + h) / ∂ reported(t_k),     Φ_j = A_{k+j−1} … A_{k+1} A_k
    spread_j = √( mean over u, v, r of (Φ_j P₀ Φ_jᵀ)_ii / scale_i² )

Linearising along the measured track, not along a free run, keeps Φ true where a free run of an
unstable hull has left the track. The memory of actuators is left out: commands fix it.

Above its critical speed a hull is unstable on course: a free run of the *true* model leaves the
track there, because its start is not known exactly. What comes after says nothing of the model:
a horizon ends where the spread exceeds its limit.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import InputTable, Model
from sim.prediction import input_table, measured_motion, runs_from
from sim.state import Floats, Ints
from sim.trial import Trial

# Blocks of time by which held-out tests, cross-fits and leave-one-block-out intervals resample a
# trial [s]: two to three of the longest free runs (8 to 10 s). Chosen, not measured.
BLOCK_S = 25.0
# Time left out between blocks [s], because residuals are autocorrelated. Chosen, not measured.
GUARD_S = 5.0
# Shortest usable time that still gives a segment [s]. Chosen, not measured.
SHORTEST_STRETCH_S = 2.0


class NoUsableTimeError(ValueError):
    """A trial has too little usable time, or too little in one piece, for what was asked."""


class NotFiniteError(NoUsableTimeError):
    """Rows that are marked usable hold numbers that are not finite."""


class RowRange(NamedTuple):
    """Rows start … stop − 1 of a trial."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


def usable_stretches(usable: NDArray[np.bool_]) -> list[RowRange]:
    """Flags (T,) -> the ranges of rows that are all usable, in order."""
    padded = np.concatenate(([0], np.asarray(usable, np.int8), [0]))
    edges = np.flatnonzero(np.diff(padded))
    return [RowRange(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def time_blocks(
    usable: NDArray[np.bool_], dt: float, length: float = BLOCK_S, guard: float = GUARD_S
) -> list[RowRange]:
    """Usable time cut into blocks of at least `length` [s], at least `guard` [s] apart.

    A stretch shorter than `length` but longer than half of it is a block of its own; what is
    shorter still is left out.
    """
    wanted, gap = max(round(length / dt), 1), int(np.ceil(guard / dt - 1e-9))
    out: list[RowRange] = []
    for stretch in usable_stretches(usable):
        first = max(stretch.start, out[-1].stop + gap) if out else stretch.start
        room = stretch.stop - first
        if room < wanted / 2:
            continue
        count = max((room + gap) // (wanted + gap), 1)
        width = (room - (count - 1) * gap) // count
        starts = range(first, first + count * (width + gap), width + gap)
        out += [RowRange(start, start + width) for start in starts]
    return out


# A free run so long is another voyage: its error says nothing of the model that a shorter one does
# not. Longer ones are slips of the pen. Chosen, not measured.
LONGEST_HORIZON_S = 3600.0


@dataclass(frozen=True)
class CompareSettings:
    """Free runs of `horizon` [s] that start every `every` [s].

    A horizon ends early where the standard deviation of its start state, carried along the measured
    track, exceeds `spread_limit` (root mean square over u, v, r in units of the nrmse scales) or
    `spread_growth` times its value at the start, whichever is larger: below the first the start
    state hardly shows in the error; the second lets a coarse estimate of a steady boat run on.
    No horizon is cut below `shortest` [s]; the spread is evaluated at nodes every `node` [s].
    `block` [s]: length of the blocks of the bootstrap interval, which draws from `seed`.
    """

    horizon: float = 10.0
    every: float = 2.5
    shortest: float = 1.0
    node: float = 0.25
    spread_limit: float = 0.25
    spread_growth: float = 2.0
    block: float = 30.0
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("horizon", "every", "shortest", "node", "block"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be longer than 0 s, not {getattr(self, name)}")
        if not self.horizon <= LONGEST_HORIZON_S:
            most = f"at most {LONGEST_HORIZON_S:.0f} s"
            raise ValueError(f"horizon {self.horizon:g} s is too long: {most}")
        if self.horizon < self.shortest:
            raise ValueError(f"horizon {self.horizon} s is below the shortest, {self.shortest} s")


@dataclass(frozen=True)
class Segments:
    """Segments of a trial that a model predicts in one free run each.

    rows     (S,)  row of the trial where the segment starts
    nodes    (S,)  its length in nodes
    stride         steps of the trial from node to node
    """

    rows: Ints
    nodes: Ints
    stride: int

    @property
    def steps(self) -> Ints:
        """Lengths (S,) in steps of the trial."""
        return self.nodes * self.stride


def segments_of(trial: Trial, settings: CompareSettings) -> Segments:
    """Segments that lie within one usable stretch each; NoUsableTimeError if there is none.

    A stretch shorter than the horizon gives one segment as long as itself.
    """
    stride = max(round(settings.node / trial.dt), 1)
    node = stride * trial.dt
    longest = max(round(settings.horizon / node), 1)
    apart = max(round(settings.every / node), 1)
    rows, nodes = [], []
    for stretch in usable_stretches(trial.usable):
        room = (len(stretch) - 1) // stride
        if room * node < min(SHORTEST_STRETCH_S, settings.horizon) - 1e-9:
            continue
        first = np.arange(0, max(room - longest, 0) + 1, apart)
        rows.append(stretch.start + stride * first)
        nodes.append(np.full(len(first), min(room, longest)))
    if not rows:
        raise NoUsableTimeError(
            f"{trial.name}: no usable stretch of {SHORTEST_STRETCH_S:g} s or more to compare over"
        )
    return Segments(np.concatenate(rows), np.concatenate(nodes), stride)


def longest_stretch(trial: Trial) -> RowRange:
    """The longest range of usable rows; NoUsableTimeError if there is none."""
    stretches = usable_stretches(trial.usable)
    if not stretches:
        raise NoUsableTimeError(f"{trial.name}: no usable time")
    return max(stretches, key=len)


def require_finite(trial: Trial) -> None:
    """Raise NotFiniteError where usable rows hold motion that is not finite."""
    for key in ("eta", "nu", "nu_dot"):
        if not np.isfinite(getattr(trial, key)[trial.usable]).all():
            raise NotFiniteError(
                f"{trial.name}: {key} is not finite in rows that are marked usable: leave them out"
            )


STATE = 6  # components of the reported pose and velocity (eta, nu)
# Steps of the central differences [m, m, rad, m/s, m/s, rad/s]. Chosen, not measured.
STATE_STEP = np.array([1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4])
# Steps of the forward differences of u, v, r [m/s, m/s, rad/s]. Chosen, not measured.
VELOCITY_STEP = np.array([1e-3, 1e-3, 1e-3])
CHUNK = 2000  # rows that are differentiated in one call, which bounds the memory


def transitions(model: Model, trial: Trial, rows: Ints, stride: int) -> Floats:
    """Rows (K,) -> A (K, 6, 6) over `stride` steps of the trial, SI units."""
    inputs, motion = input_table(model, trial), measured_motion(trial)
    chunks = [rows[i : i + CHUNK] for i in range(0, len(rows), CHUNK)]
    parts = [_transitions(model, inputs, motion, chunk, stride) for chunk in chunks]
    return np.concatenate([np.zeros((0, STATE, STATE)), *parts])


def _transitions(
    model: Model, inputs: InputTable, motion: Floats, rows: Ints, stride: int
) -> Floats:
    shift = np.zeros((2 * STATE, motion.shape[1]))
    shift[:STATE, :STATE], shift[STATE:, :STATE] = np.diag(STATE_STEP), -np.diag(STATE_STEP)
    starts = (motion[rows, None, :] + shift).reshape(-1, motion.shape[1])
    runs = runs_from(np.repeat(rows, 2 * STATE), np.full(len(starts), stride))
    _, reports = model.run(model.true_states(starts), runs, inputs)
    ends = reports[:, stride, :STATE].reshape(len(rows), 2, STATE, STATE)
    return np.swapaxes((ends[:, 0] - ends[:, 1]) / (2.0 * STATE_STEP[:, None]), 1, 2)


def start_transitions(model: Model, trial: Trial, segments: Segments) -> Floats:
    """Φ (S, J+1, 6, 6) from each segment's start to its nodes; NaN past its end."""
    ends = zip(segments.rows, segments.nodes, strict=True)
    nodes = np.unique(np.concatenate([row + segments.stride * np.arange(n) for row, n in ends]))
    A = transitions(model, trial, nodes, segments.stride)
    at = np.searchsorted(nodes, segments.rows)
    out = np.full((len(at), int(segments.nodes.max()) + 1, STATE, STATE), np.nan)
    out[:, 0] = np.eye(STATE)
    for j in range(out.shape[1] - 1):
        going = np.flatnonzero(segments.nodes > j)
        out[going, j + 1] = A[at[going] + j] @ out[going, j]
    return out


def start_variance(trial: Trial, segments: Segments, phi: Floats) -> Floats:
    """Φ (S, J+1, 6, 6) -> variance (S, J+1, 6) that the start state's covariance leaves there."""
    P = trial.covariance[segments.rows, :STATE, :STATE]
    return np.einsum("sjik,skl,sjil->sji", phi, P, phi, optimize=True)


def nodes_within_limit(
    variance: Floats, segments: Segments, scales: Floats, dt: float, settings: CompareSettings
) -> Ints:
    """Variance (S, J+1, 6), scales (3,) -> length in nodes (S,) that each segment may run."""
    spread = np.sqrt(np.mean(variance[..., 3:] / scales**2, axis=-1))
    limit = np.maximum(settings.spread_limit, settings.spread_growth * spread[:, :1])
    nodes = np.arange(spread.shape[1])
    past = ~(spread <= limit) & (nodes <= segments.nodes[:, None])
    first = np.where(past.any(axis=1), np.argmax(past, axis=1), segments.nodes)
    shortest = int(np.ceil(settings.shortest / (segments.stride * dt) - 1e-9))
    return np.minimum(np.maximum(first, shortest), segments.nodes).astype(np.int64)


def shifted_velocities(
    model: Model, trial: Trial, motion: Floats, rows: Ints, steps: Ints
) -> Floats:
    """Free runs from rows (S,) of a motion (T, 9), and with u, v, r shifted by `VELOCITY_STEP`:

    nu (S, 4, H+1, 3), NaN past the end.
    """
    start = np.repeat(motion[rows], 4, axis=0)
    for i in range(3):
        start[i + 1 :: 4, 3 + i] += VELOCITY_STEP[i]
    runs = runs_from(np.repeat(rows, 4), np.repeat(steps, 4))
    _, reports = model.run(model.true_states(start), runs, input_table(model, trial))
    return reports[..., 3:6].reshape(len(rows), 4, -1, 3)
