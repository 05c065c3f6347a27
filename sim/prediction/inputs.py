"""A trial as a model reads it: measured motion, commands, voltage and wind."""

import numpy as np
from numpy.typing import NDArray

from sim.model import InputTable, Model, Runs
from sim.state import Floats
from sim.trial import Trial


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
