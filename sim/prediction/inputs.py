"""What drove the boat, as a model reads it: commands, voltage and wind of a trial.

Usable time as stretches, and as blocks with a guard between them for held-out tests.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import InputTable, Model, Runs
from sim.state import Floats
from sim.trial import Trial


def motion_of(trial: Trial) -> Floats:
    """Reported motion of all rows: (T, 9) of (eta, nu, nu_dot)."""
    return np.concatenate([trial.eta, trial.nu, trial.nu_dot], axis=1)


def commands_of(model: Model, trial: Trial) -> Floats:
    """Recorded pulses as the vessel's commands (T, na) in [−1, 1]; no pulse is no command."""
    commands = np.zeros((len(trial), model.actuator_count))
    known = model.vessel.commands(trial.channels, trial.pwm)
    commands[:, : known.shape[1]] = known
    return commands


def inputs_of(model: Model, trial: Trial) -> InputTable:
    """One input table for all free runs over the trial."""
    commands = commands_of(model, trial)[None]
    return InputTable.of(commands, trial.dt, trial.voltage, trial.wind, float(trial.time[0]))


def runs_from(rows: NDArray[np.int64], steps: NDArray[np.int64], later: float = 0.0) -> Runs:
    """Free runs from rows (B,) of the trial over steps (B,).

    Commands act `later` [s] than they are told: below 0 where telemetry tells them late.
    """
    nothing = np.zeros(len(rows), np.int64)
    return Runs(table=nothing, start=rows, steps=steps, delay=np.full(len(rows), later))


def delayed(commands: Floats, dt: float, delay: float) -> Floats:
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


GUARD = 5.0  # s between blocks: residuals are autocorrelated


class Rows(NamedTuple):
    """Rows start … stop − 1 of a trial."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


def stretches(usable: NDArray[np.bool_]) -> list[Rows]:
    """Flags (T,) -> the runs of rows that are all usable, in order."""
    padded = np.concatenate(([0], np.asarray(usable, np.int8), [0]))
    edges = np.flatnonzero(np.diff(padded))
    return [Rows(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def blocks(
    usable: NDArray[np.bool_], dt: float, length: float = 25.0, guard: float = GUARD
) -> list[Rows]:
    """Usable time cut into blocks of at least `length` [s], at least `guard` [s] apart.

    A stretch shorter than `length` but longer than half of it is a block of its own; what is
    shorter still is left out.
    """
    wanted, gap = max(round(length / dt), 1), int(np.ceil(guard / dt - 1e-9))
    out: list[Rows] = []
    for stretch in stretches(usable):
        start = max(stretch.start, out[-1].stop + gap) if out else stretch.start
        out += _cut(start, stretch.stop, wanted, gap)
    return out


def _cut(start: int, stop: int, wanted: int, gap: int) -> list[Rows]:
    """One stretch into as many equal blocks of at least `wanted` rows as fit."""
    room = stop - start
    if room < wanted / 2:
        return []
    count = max((room + gap) // (wanted + gap), 1)
    width = (room - (count - 1) * gap) // count
    return [Rows(start + i * (width + gap), start + i * (width + gap) + width)
            for i in range(count)]  # fmt: skip
