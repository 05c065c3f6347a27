"""Free runs of a model beside a trial: here, the trial as a model reads it, and the missing force.

A model reads measured motion, commands, voltage and wind. The missing force along a trial has the
standard deviation that the estimate leaves in it:

    f = balance(ν̇, ν, …),     var f = J P Jᵀ,     J = ∂f / ∂(η, ν, ν̇)

J comes from central differences, so that sensor effects and currents have their part in it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import InputTable, Model, Runs
from sim.state import Floats, Ints
from sim.trial import MOTION, Trial


def measured_motion(trial: Trial) -> Floats:
    """Reported motion of all rows: (T, 9) of (eta, nu, nu_dot)."""
    return np.concatenate([trial.eta, trial.nu, trial.nu_dot], axis=1)


def vessel_commands(model: Model, trial: Trial) -> Floats:
    """Recorded pulses as the vessel's commands (T, na) in [−1, 1]; no pulse is no command."""
    commands = np.zeros((len(trial), model.actuator_count))
    known = model.vessel.commands(trial.channels, trial.pwm)
    commands[:, : known.shape[1]] = known
    return commands


def input_table(model: Model, trial: Trial) -> InputTable:
    """One input table for all free runs over the trial."""
    commands = vessel_commands(model, trial)[None]
    return InputTable.of(commands, trial.dt, trial.voltage, trial.wind, float(trial.time[0]))


def runs_from(
    rows: NDArray[np.int64], steps: NDArray[np.int64], command_offset: float = 0.0
) -> Runs:
    """Free runs from rows (B,) of the trial over steps (B,).

    `command_offset` [s]: how much later than recorded commands act; below 0 where telemetry reports
    them late.
    """
    table = np.zeros(len(rows), np.int64)
    return Runs(table=table, start=rows, steps=steps, delay=np.full(len(rows), command_offset))


def delayed_commands(commands: Floats, dt: float, delay: float) -> Floats:
    """Commands (T, na) held over dt, acting `delay` [s] later, as means over each interval."""
    if delay == 0.0:
        return commands
    total = np.vstack([np.zeros(commands.shape[1]), np.cumsum(commands, axis=0)])
    grid = np.arange(len(total), dtype=float)
    before = np.minimum(grid - delay / dt, 0.0)  # before the trial: its first command
    shifted = [
        np.interp(grid - delay / dt, grid, column) + before * column[1] for column in total.T
    ]
    return np.diff(np.stack(shifted, axis=1), axis=0)


def commands_around(model: Model, trial: Trial) -> tuple[Floats, Floats]:
    """Delayed commands (T, na) over the interval before each row, and over that after it."""
    after = delayed_commands(vessel_commands(model, trial), trial.dt, model.delay)
    return np.vstack([after[:1], after[:-1]]), after


# Steps of the central differences of (η, ν, ν̇) [m, m, rad, m/s, m/s, rad/s, m/s², m/s², rad/s²]:
# far above rounding, far below what a boat's laws bend over. Chosen, not measured.
MOTION_STEP = np.array([1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])
# Time between the rows at which the standard deviation is worked out [s]. Chosen, not measured.
STD_EVERY_S = 0.5


@dataclass(frozen=True)
class MissingForce:
    """force, std (T, 3): X, Y [N], N [N m], what the vessel lacks on every row of the trial."""

    force: Floats
    std: Floats


def missing_force(trial: Trial, model: Model) -> MissingForce:
    """The missing force along the whole trial and its standard deviation."""
    return MissingForce(missing_force_only(trial, model), _std(trial, model))


class ForceInputs(NamedTuple):
    """What missing forces of a trial are worked out from, whatever a model's numbers are: reported
    motion (T, 9), commands (T, na) over the interval before each row and at it.
    """

    motion: Floats
    before: Floats
    around: Floats

    @classmethod
    def of(cls, trial: Trial, model: Model) -> "ForceInputs":
        """As the model reads the trial."""
        before, after = commands_around(model, trial)
        return cls(measured_motion(trial), before, 0.5 * (before + after))

    def forces(self, trial: Trial, model: Model, thetas: Floats) -> Floats:
        """The missing force (K, T, 3) with each of the parameters (K, P)."""
        out = np.empty((len(thetas), len(trial), 3))
        for k, theta in enumerate(thetas):
            out[k], _ = model.missing_force(
                self.motion, trial.time, self.before, self.around, theta=theta,
                voltage=trial.voltage, wind=trial.wind,
            )  # fmt: skip
        return out


def missing_force_only(trial: Trial, model: Model) -> Floats:
    """The force (T, 3) without its standard deviation, which costs several times as much."""
    return ForceInputs.of(trial, model).forces(trial, model, model.theta[None])[0]


def forces_along(
    trial: Trial, model: Model, before: Floats, around: Floats
) -> tuple[Floats, Floats]:
    """Commands (T, na) before and at each row -> missing force, τ(commands) (T, 3) [N, N, N m]."""
    return model.missing_force(
        measured_motion(trial), trial.time, before, around, voltage=trial.voltage, wind=trial.wind
    )


def _std(trial: Trial, model: Model) -> Floats:
    """Standard deviations (T, 3) from the covariance, held from one evaluated row to the next."""
    before, after = commands_around(model, trial)
    commands = 0.5 * (before + after)
    every = max(round(STD_EVERY_S / trial.dt), 1)
    # Backwards in time the memory of actuators stands still: it hardly changes J, and running it
    # along eighteen times would cost more than all the rest.
    rows = np.arange(0, len(trial), every)[::-1]
    J = np.stack([_derivative(trial, model, commands, rows, i) for i in range(MOTION)], axis=-1)
    variance = np.einsum("kij,kjl,kil->ki", J, trial.covariance[rows], J, optimize=True)
    std = np.sqrt(np.maximum(variance, 0.0))[::-1]
    return np.repeat(std, every, axis=0)[: len(trial)]


def _derivative(trial: Trial, model: Model, commands: Floats, rows: Ints, i: int) -> Floats:
    """∂f/∂(component i of the motion): (K, 3)."""
    motion = measured_motion(trial)[rows]
    shift = np.zeros(MOTION)
    shift[i] = MOTION_STEP[i]
    high, low = (
        model.missing_force(
            moved, trial.time[rows], commands[rows], commands[rows],
            voltage=trial.voltage[rows], wind=trial.wind[rows],
        )[0]
        for moved in (motion + shift, motion - shift)
    )  # fmt: skip
    return (high - low) / (2.0 * MOTION_STEP[i])
