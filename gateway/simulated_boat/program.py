"""The commands of a simulated boat: a table that repeats, a pure function of time.

Built-in programs are the manoeuvres of `sim.excitation`; a table of a user's own (CSV) names each
actuator.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.offline.simulate import read_commands
from sim.excitation.catalogue import BY_NAME, Mixed
from sim.excitation.manoeuvre import Manoeuvre
from sim.excitation.sticks import manoeuvre_commands
from sim.excitation.turns import Circles, Spin
from sim.state import Floats
from sim.vessel import Vessel

STEP_S = 0.04
PROGRAMS: Mapping[str, Manoeuvre] = {**BY_NAME, "turns": Mixed((Circles(), Spin()))}


@dataclass(frozen=True)
class Program:
    """Row k of `rows` (R, na) acts from `starts` (R,) [s] on; after `period` all repeats."""

    starts: Floats
    rows: Floats
    period: float

    def row_at(self, time_s: float) -> int:
        """Which row acts at that moment; before the start it is the first."""
        into = max(time_s, 0.0) % self.period
        return int(np.searchsorted(self.starts, into, side="right")) - 1


def program_of(vessel: Vessel, wanted: str | Path = "mixed", seed: int = 0) -> Program:
    """A built-in program by its name, else a CSV of commands."""
    if str(wanted) in PROGRAMS:
        return _program(manoeuvre_commands(PROGRAMS[str(wanted)], vessel, STEP_S, seed))
    path = Path(wanted)
    if not path.exists():
        raise BadInput(f"{wanted}: neither a table of commands nor one of {', '.join(PROGRAMS)}")
    times, rows = read_commands(path, vessel)
    return Program(times[:-1], rows[:-1], float(times[-1]))


def _program(commands: Floats) -> Program:
    """Commands (T, na) on a grid -> the rows that differ from the one before."""
    new = np.append(True, np.any(np.diff(commands, axis=0) != 0.0, axis=1))
    starts = STEP_S * np.flatnonzero(new).astype(float)
    return Program(starts, commands[new], STEP_S * len(commands))
