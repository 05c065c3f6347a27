"""What the timing of commands adds to the noise of the motion, and sharp shifts of commands.

When a command changed between two messages is not recorded:

    x_{j+1} = F_j x_j + Σ_k M⁻¹ Δτ_k δ_k,     δ_k ~ N(0, σ²) [s]

Commands hold from message to message, so a change of force Δτ that was in fact δ earlier gives the
boat an impulse M⁻¹ Δτ δ that the model does not have, and the boat carries it on by F over a step.
At 25 messages a second that is ten times the error of a gyro. It is no error of the model: the
covariance of x is part of the noise. (Process noise from the input: Åström, Introduction to
Stochastic Control Theory, 1970, ch. 3.)

Sharpening. A shift of commands by the share f of a row takes f of one mean and 1 − f of its
neighbour, which spreads each change by √(f (1 − f)) rows. Taken for the boat's own sluggishness
that makes a hull turn in a third of a per cent too quickly. κ takes the second moment of that
spread out again:

    c'_k = c_k − κ (c_{k+1} − 2 c_k + c_{k−1}),     κ = ½ f (1 − f)
"""

from dataclasses import replace

import numpy as np

from sim.model import InputTable, Model
from sim.prediction.inputs import commands_around
from sim.prediction.missing_force import forces_along
from sim.prediction.segments import VELOCITY_STEP, shifted_velocities
from sim.state import Floats, Ints
from sim.trial import Trial

MIN_COMMAND_RATE_HZ = 0.5  # slower commands count as this: an interval says little then
MAX_TRANSITION = 2.0  # bound of ∂ velocity / ∂ velocity over one mean, against runs that diverge


def command_timing_covariance(
    trial: Trial, model: Model, first: Ints, every: int, means: int, track: Floats
) -> Floats | None:
    """Covariance (S, 3n, 3n) of n means of u, v, r in runs from rows first (S,) of a track (T, 9).

    The time of each command is uniform over a message interval. None where the rate of commands is
    not known, or there is no run.
    """
    if "commands" not in trial.rates_hz or not len(first):
        return None
    rows = first[:, None] + every * np.arange(means)
    step = _transitions(trial, model, np.minimum(rows, len(trial) - every - 1), every, track)
    each = _impulses(trial, model) / np.sqrt(12.0)
    within = np.minimum(rows[..., None] + np.arange(every), len(trial) - 1)
    impulse = np.einsum("sjki,sjkl->sjil", each[within], each[within])
    return _accumulated(step, impulse).reshape(len(rows), 3 * means, 3 * means)


def _accumulated(step: Floats, impulse: Floats) -> Floats:
    """F (S, n, 3, 3), Σ q qᵀ (S, n, 3, 3) of each mean -> covariance (S, n, 3, n, 3)."""
    S, n = impulse.shape[:2]
    out = np.zeros((S, n, 3, n, 3))
    now = 0.5 * impulse[:, 0]
    out[:, 0, :, 0] = now
    for j in range(1, n):
        F, new = step[:, j - 1], 0.5 * (impulse[:, j - 1] + impulse[:, j])
        before = np.einsum("sab,sbic->saic", F, out[:, j - 1, :, :j])
        out[:, j, :, :j] = before
        out[:, :j, :, j] = np.moveaxis(before, (1, 2, 3), (3, 1, 2))
        now = F @ now @ np.swapaxes(F, 1, 2) + new
        out[:, j, :, j] = now
    return out


def _transitions(trial: Trial, model: Model, rows: Ints, every: int, track: Floats) -> Floats:
    """∂ velocity after `every` rows / ∂ velocity at rows (S, n): (S, n, 3, 3)."""
    flat = rows.reshape(-1)
    steps = np.full(len(flat), every, np.int64)
    nu = shifted_velocities(model, trial, track, flat, steps)[:, :, every]
    F = np.swapaxes((nu[:, 1:] - nu[:, :1]) / VELOCITY_STEP[:, None], 1, 2)
    F = np.clip(np.nan_to_num(F), -MAX_TRANSITION, MAX_TRANSITION)
    return F.reshape(*rows.shape, 3, 3)


def _impulses(trial: Trial, model: Model) -> Floats:
    """M⁻¹ Δτ T: change of velocity (T, 3) if a row's commands had come a message earlier."""
    _, tau = forces_along(trial, model, *commands_around(model, trial))
    mass = model.theta[[model.names.index(name) for name in ("m11", "m22", "m33")]]
    interval = 1.0 / max(trial.rates_hz["commands"], MIN_COMMAND_RATE_HZ)
    change = np.diff(tau, axis=0, prepend=tau[:1])
    return np.nan_to_num(change, posinf=0.0, neginf=0.0) / mass * interval


def sharpening_factor(shift: float, dt: float) -> float:
    """κ of a shift [s]."""
    share = shift / dt % 1.0
    return 0.5 * share * (1.0 - share)


def sharpened_commands(inputs: InputTable, kappa: float) -> InputTable:
    """The same inputs with commands that make up for the spread of a shift."""
    commands = np.diff(inputs.total, axis=1)
    bend = np.zeros_like(commands)
    bend[:, 1:-1] = commands[:, 2:] - 2.0 * commands[:, 1:-1] + commands[:, :-2]
    total = np.zeros_like(inputs.total)
    np.cumsum(commands - kappa * bend, axis=1, out=total[:, 1:])
    return replace(inputs, total=total)
