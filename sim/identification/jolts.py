"""What nobody said: when, between two messages, a command changed.

    x_{j+1} = F_j x_j + Σ_k M⁻¹ Δτ_k δ_k,     δ_k ~ N(0, σ²) [s]

Commands hold from message to message, so a change of force Δτ that was in fact δ earlier gives the
boat a jolt M⁻¹ Δτ δ that the model does not have, and the boat carries it on: by F over a step.
At 25 messages a second that is ten times what a gyro errs by. It is no error of the model: the
covariance of x is part of what the motion may be off by. (Process noise from the input: Åström,
Introduction to Stochastic Control Theory, 1970, ch. 3.)
"""

import numpy as np

from sim.diagnosis.inputs import commands_of, delayed, inputs_of, motion_of, runs_from
from sim.identification.tiles import STEP, Tiles
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial

NU = slice(3, 6)
SLOWEST = 0.5  # Hz


def jolts_of(
    trial: Trial, model: Model, tiles: Tiles, every: int, means: int, track: Floats
) -> Floats | None:
    """Covariance (S, 3n, 3n) of n means of u, v, r in each run: a message interval's, uniform.

    None where nobody knows how often commands were told.
    """
    if "commands" not in trial.rates_hz:
        return None
    rows = tiles.first[:, None] + every * np.arange(means)
    last = len(trial) - every - 1
    step = _carried(trial, model, np.minimum(rows, last), every, track)
    each = _kicks(trial, model) / np.sqrt(12.0)
    within = np.minimum(rows[..., None] + np.arange(every), len(trial) - 1)
    kick = np.einsum("sjki,sjkl->sjil", each[within], each[within])
    return _summed(step, kick).reshape(len(rows), 3 * means, 3 * means)


def _summed(step: Floats, kick: Floats) -> Floats:
    """F (S, n, 3, 3), Σ q qᵀ (S, n, 3, 3) of each mean -> covariance (S, n, 3, n, 3)."""
    S, n = kick.shape[:2]
    out = np.zeros((S, n, 3, n, 3))
    now = 0.5 * kick[:, 0]
    out[:, 0, :, 0] = now
    for j in range(1, n):
        F, new = step[:, j - 1], 0.5 * (kick[:, j - 1] + kick[:, j])
        before = np.einsum("sab,sbic->saic", F, out[:, j - 1, :, :j])
        out[:, j, :, :j] = before
        out[:, :j, :, j] = np.moveaxis(before, (1, 2, 3), (3, 1, 2))
        now = F @ now @ np.swapaxes(F, 1, 2) + new
        out[:, j, :, j] = now
    return out


def _carried(trial: Trial, model: Model, rows: Floats, every: int, track: Floats) -> Floats:
    """∂ velocity after `every` rows / ∂ velocity at rows (S, n): (S, n, 3, 3)."""
    flat = rows.reshape(-1)
    motion = np.repeat(track[flat], 4, axis=0)
    for i in range(3):
        motion[i + 1 :: 4, 3 + i] += STEP[i]
    runs = runs_from(np.repeat(flat, 4), np.full(len(motion), every, np.int64))
    _, reports = model.run(model.true_states(motion), runs, inputs_of(model, trial))
    nu = reports[:, every, NU].reshape(len(flat), 4, 3)
    F = np.swapaxes((nu[:, 1:] - nu[:, :1]) / STEP[:, None], 1, 2)
    return np.clip(np.nan_to_num(F), -2.0, 2.0).reshape(*rows.shape, 3, 3)


def _kicks(trial: Trial, model: Model) -> Floats:
    """M⁻¹ Δτ T: change of velocity (T, 3) if a row's commands had come a message earlier."""
    commands = delayed(commands_of(model, trial), trial.dt, model.delay)
    before = np.vstack([commands[:1], commands[:-1]])
    _, tau = model.missing_force(
        motion_of(trial), trial.time, before, commands, voltage=trial.voltage, wind=trial.wind
    )
    mass = model.theta[[model.names.index(name) for name in ("m11", "m22", "m33")]]
    interval = 1.0 / max(trial.rates_hz["commands"], SLOWEST)
    change = np.diff(tau, axis=0, prepend=tau[:1])
    return np.nan_to_num(change) / mass * interval
