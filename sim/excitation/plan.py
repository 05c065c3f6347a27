"""What a plan is: sticks on a grid, what the autopilot gets of them, what the vessel does then."""

from dataclasses import dataclass

import numpy as np

from sim.excitation.manoeuvre import Limits, Manoeuvre, connected, corners
from sim.excitation.sticks import mixed, sticks_of
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

DT = 0.1  # s
TOLERANCE = 0.01  # of full travel: how far a script's straight lines may be from the manoeuvre


@dataclass(frozen=True)
class Plan:
    """Sticks (K, 2) at the corners (K,) [s]; on the grid (T,) sticks, commands, motion (T, 9)."""

    manoeuvre: Manoeuvre
    vessel: Vessel
    limits: Limits
    seed: int
    corner_time: Floats
    corner_sticks: Floats
    time: Floats
    sticks: Floats
    commands: Floats
    motion: Floats

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return float(self.time[-1])

    @property
    def distance(self) -> Floats:
        """How far from the start the vessel is (T,) [m]."""
        gone = self.motion[:, :2] - self.motion[0, :2]
        return np.hypot(gone[:, 0], gone[:, 1])

    @property
    def reach(self) -> float:
        """The furthest it goes from the start [m]."""
        return float(self.distance.max())

    @property
    def speed(self) -> Floats:
        """Over ground (T,) [m/s]."""
        return np.hypot(self.motion[:, 3], self.motion[:, 4])


def plan_of(
    manoeuvre: Manoeuvre,
    model: Model,
    limits: Limits,
    seed: int = 0,
    seconds: float | None = None,
) -> Plan:
    """Sticks as the script will play them, and the motion they make: nothing is left out."""
    vessel = model.vessel
    wanted = np.vstack([sticks_of(manoeuvre, vessel, DT, seed, limits, seconds), np.zeros(2)])
    time = DT * np.arange(len(wanted), dtype=float)
    kept = corners(time, wanted, TOLERANCE)
    places: Floats = np.round(wanted[kept], 3).astype(float)
    sticks = connected(time, time[kept], places)
    commands = mixed(vessel, sticks)
    motion = model.simulate(commands, DT)[1][0, :-1]
    return Plan(manoeuvre, vessel, limits, seed, time[kept], places, time, sticks, commands, motion)
