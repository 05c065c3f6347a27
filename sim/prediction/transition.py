"""How an error of the start state propagates: the model linearised along the measured track.

    A_k = ∂ reported(t_k + h) / ∂ reported(t_k),     Φ_j = A_{k+j−1} … A_{k+1} A_k
    spread_j = √( mean over u, v, r of (Φ_j P₀ Φ_jᵀ)_ii / scale_i² )

Linearising along the measured track, not along a free run, keeps Φ true where a free run of an
unstable hull has left the track. The memory of actuators is left out: commands fix it.

Above its critical speed a hull is unstable on course: a free run of the *true* model leaves the
track there, because its start is not known exactly. What comes after says nothing of the model:
a horizon ends where the spread exceeds its limit.
"""

import numpy as np

from sim.model import InputTable, Model
from sim.prediction.inputs import input_table, measured_motion, runs_from
from sim.prediction.segments import CompareSettings, Segments
from sim.state import Floats, Ints
from sim.trial import Trial

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
