"""What `import sim` offers to a notebook: a few calls from vessels and trials to results.

    trials = gateway.load_trials("voyage.tlog")
    boat = gateway.load_vessel("otter")
    sim.compare(trials, boat)                how far the model is from the measurement, and where
    sim.identify(trials, boat)               its parameters with intervals
    sim.diagnose(trials, boat)               which physical effect is missing

Results have `to_dict()`; those that are tables have `to_pandas()` (pandas only if installed).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.comparison.compare import Comparison
from sim.comparison.compare import compare as compare_trial
from sim.diagnosis.answer import Diagnosis
from sim.model import Model
from sim.prediction.segments import CompareSettings
from sim.state import Floats
from sim.trial import MOTION_NAMES, Trial, data_frame
from sim.vessel import Vessel


@dataclass(frozen=True)
class Simulation:
    """Motion of a vessel under commands, as its sensors would report it.

    time     (T,)     s
    motion   (T, 9)   eta [m, m, rad], nu [m/s, m/s, rad/s], nu_dot
    commands (T, na)  in [−1, 1], held over the interval that begins at their row
    """

    time: Floats
    motion: Floats
    commands: Floats

    @property
    def eta(self) -> Floats:
        """North, east, yaw (T, 3) [m, m, rad]."""
        return self.motion[:, :3]

    @property
    def nu(self) -> Floats:
        """u, v, r (T, 3) [m/s, m/s, rad/s]."""
        return self.motion[:, 3:6]

    def to_dict(self) -> dict[str, Any]:
        """Columns by name, as lists."""
        columns = dict(zip(MOTION_NAMES, self.motion.T.tolist(), strict=True))
        return {"time": self.time.tolist(), **columns, "commands": self.commands.tolist()}

    def to_pandas(self) -> Any:
        """One row per time; ImportError where pandas is not installed."""
        columns = {name: self.motion[:, i] for i, name in enumerate(MOTION_NAMES)}
        commands = {f"command_{i + 1}": c for i, c in enumerate(self.commands.T)}
        return data_frame({"time": self.time, **columns, **commands})


def simulate(
    vessel: Vessel,
    commands: Floats,
    dt: float,
    *,
    start: Floats | None = None,
    voltage: Floats | None = None,
    wind: Floats | None = None,
) -> Simulation:
    """Commands (T, na) in [−1, 1], each held over dt [s] -> the motion of the vessel.

    Columns are thrusters, then rudders, in the order of the vessel. start (6,) is eta and nu at the
    first row, default at rest at the origin; voltage (T,) [V]; wind (T, 2) [m/s, of the air towards
    north and east].
    """
    table = np.atleast_2d(np.asarray(commands, dtype=float))
    model = Model.of(vessel)
    if table.shape[1] != len(vessel.actuators):
        names = ", ".join(a.name for a in vessel.actuators)
        raise ValueError(
            f"commands have {table.shape[1]} columns: {vessel.name} takes one for each of {names}"
        )
    _, reports = model.simulate(table, dt, start, voltage=voltage, wind=wind)
    time = dt * np.arange(len(table), dtype=float)
    return Simulation(time, reports[0, : len(table)], table)


def compare(
    trials: Trial | Sequence[Trial],
    vessels: Vessel | Sequence[Vessel],
    settings: CompareSettings | None = None,
) -> list[Comparison]:
    """Each vessel on each trial; the first vessel sets the scales, horizons and noise floor.

    NoUsableTimeError where a trial has no time to compare over.
    """
    some = [trials] if isinstance(trials, Trial) else trials
    models = [Model.of(v) for v in ([vessels] if isinstance(vessels, Vessel) else vessels)]
    return [comparison for trial in some for comparison in compare_trial(trial, models, settings)]


def add(diagnosis: Diagnosis, *effects: str) -> Vessel:
    """The better vessel of a diagnosis: with the effects named, or with all that it found, a
    curve too.

    Numbers are those that were fitted along with these effects; ValueError names the combinations
    that were.
    """
    if not effects:
        return diagnosis.vessel
    steps = (*diagnosis.ladder, *diagnosis.alternatives)
    for step in steps:
        if set(step.effects) == set(effects):
            return step.vessel
    known = "; ".join(", ".join(s.effects) for s in steps if s.effects) or "none"
    raise ValueError(f"no fit with {', '.join(effects)}: there are fits with {known}")
