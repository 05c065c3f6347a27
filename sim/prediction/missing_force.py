"""The missing force along a trial, with the standard deviation that the estimate leaves in it.

    f = balance(ν̇, ν, …),     var f = J P Jᵀ,     J = ∂f / ∂(η, ν, ν̇)

J comes from central differences, so that sensor effects and currents have their part in it.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.prediction.inputs import delayed_commands, measured_motion, vessel_commands
from sim.state import Floats, Ints
from sim.trial import MOTION, Trial

STEP = np.array([1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])  # SI, of (η, ν, ν̇)
EVERY = 0.5  # s between the rows where the spread is worked out


@dataclass(frozen=True)
class MissingForce:
    """force, std (T, 3): X, Y [N], N [N m], what the vessel lacks on every row of the trial."""

    force: Floats
    std: Floats


def missing_force(trial: Trial, model: Model) -> MissingForce:
    """Balance along the whole trial, and how sure it is."""
    _, around = _commands(trial, model)
    return MissingForce(missing_force_only(trial, model), _std(trial, model, around))


def missing_force_only(trial: Trial, model: Model) -> Floats:
    """The force alone (T, 3): what it is known to costs several times as much."""
    before, around = _commands(trial, model)
    force, _ = model.missing_force(
        measured_motion(trial), trial.time, before, around, voltage=trial.voltage, wind=trial.wind
    )
    return force


def _commands(trial: Trial, model: Model) -> tuple[Floats, Floats]:
    """Commands (T, na) before each row; at it they are the mean of before and after."""
    after = delayed_commands(vessel_commands(model, trial), trial.dt, model.delay)
    before = np.vstack([after[:1], after[:-1]])
    return before, 0.5 * (before + after)


def _std(trial: Trial, model: Model, commands: Floats) -> Floats:
    """Standard deviations (T, 3) from the covariance, worked out now and then and held between."""
    every = max(round(EVERY / trial.dt), 1)
    # Backwards in time the memory of actuators stands still: it hardly changes J, and running it
    # along eighteen times would cost more than all the rest.
    rows = np.arange(0, len(trial), every)[::-1]
    J = np.stack([_slope(trial, model, commands, rows, i) for i in range(MOTION)], axis=-1)
    variance = np.einsum("kij,kjl,kil->ki", J, trial.covariance[rows], J, optimize=True)
    std = np.sqrt(np.maximum(variance, 0.0))[::-1]
    return np.repeat(std, every, axis=0)[: len(trial)]


def _slope(trial: Trial, model: Model, commands: Floats, rows: Ints, i: int) -> Floats:
    """∂f/∂(component i of the motion): (K, 3)."""
    motion = measured_motion(trial)[rows]
    shift = np.zeros(MOTION)
    shift[i] = STEP[i]
    high, low = (
        model.missing_force(
            moved, trial.time[rows], commands[rows], commands[rows],
            voltage=trial.voltage[rows], wind=trial.wind[rows],
        )[0]
        for moved in (motion + shift, motion - shift)
    )  # fmt: skip
    return (high - low) / (2.0 * STEP[i])
