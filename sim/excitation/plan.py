"""A plan: sticks on a grid, the polyline that the autopilot plays, and the predicted motion."""

from dataclasses import dataclass

import numpy as np

from sim.excitation.manoeuvre import Manoeuvre, StickLimits, corner_rows, polyline
from sim.excitation.sticks import manoeuvre_sticks, mix_sticks
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

DT = 0.1  # s
TOLERANCE = 0.01  # of full travel, between the polyline and the manoeuvre


@dataclass(frozen=True)
class Plan:
    """Sticks (K, 2) at the corners (K,) [s]; on the grid (T,) sticks, commands, motion (T, 9)."""

    manoeuvre: Manoeuvre
    vessel: Vessel
    limits: StickLimits
    seed: int
    corner_time: Floats
    corner_sticks: Floats
    time: Floats
    sticks: Floats
    commands: Floats
    motion: Floats

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    @property
    def distance(self) -> Floats:
        """Distance from the start (T,) [m]."""
        return np.hypot(*(self.motion[:, :2] - self.motion[0, :2]).T)

    @property
    def reach(self) -> float:
        """Largest distance from the start [m]."""
        return float(self.distance.max())

    @property
    def speed(self) -> Floats:
        """Speed over ground (T,) [m/s]."""
        return np.hypot(self.motion[:, 3], self.motion[:, 4])


def plan_of(
    manoeuvre: Manoeuvre,
    model: Model,
    limits: StickLimits,
    seed: int = 0,
    seconds: float | None = None,
) -> Plan:
    """The sticks as the script will play them, and the motion that they make."""
    vessel = model.vessel
    wanted = np.vstack(
        [manoeuvre_sticks(manoeuvre, vessel, DT, seed, limits, seconds), np.zeros(2)]
    )
    time = DT * np.arange(len(wanted), dtype=float)
    kept = corner_rows(time, wanted, TOLERANCE)
    corners: Floats = np.round(wanted[kept], 3).astype(float)
    sticks = polyline(time, time[kept], corners)
    commands = mix_sticks(vessel, sticks)
    motion = model.simulate(commands, DT)[1][0, :-1]
    return Plan(
        manoeuvre, vessel, limits, seed, time[kept], corners, time, sticks, commands, motion
    )
