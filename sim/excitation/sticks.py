"""From throttle and helm to the actuators of a vessel, and a manoeuvre on a time grid.

    thruster   c = throttle · cos α + steer · lever / longest lever
               lever = x sin α − y cos α  [m], the yaw moment per newton
    rudder     c = steer

Where there are rudders they steer alone. A thruster across the boat (bow thruster) has no share of
the throttle; one that makes no yaw moment has none of the helm. This is how an autopilot with skid
steering mixes: with throttle and steer together above full travel it keeps the helm and reduces the
throttle, as does `within_travel`.

A plan: sticks on a grid, the polyline that the autopilot plays, and the predicted motion.
"""

from dataclasses import dataclass

import numpy as np

from sim.excitation.manoeuvre import (
    Manoeuvre,
    Stick,
    StickLimits,
    corner_rows,
    polyline,
    slew_limited,
)
from sim.model import Model
from sim.state import Floats
from sim.vessel import Rudder, Thruster, Vessel

RUDDER_HELM_GAIN = 2.0  # a rudder needs more helm than a difference of thrust; chosen


def mixing_matrix(vessel: Vessel) -> Floats:
    """Each actuator's share of throttle and of steer (actuators, 2)."""
    return np.array([_share(vessel, actuator) for actuator in vessel.actuators])


def mix_sticks(vessel: Vessel, sticks: Floats) -> Floats:
    """Throttle and steer (..., 2) -> commands (..., actuators) in [−1, 1]."""
    return np.clip(sticks @ mixing_matrix(vessel).T, -1.0, 1.0)


def helm_gain(vessel: Vessel) -> float:
    """How much more helm the vessel needs than one that steers by thrust."""
    return RUDDER_HELM_GAIN if vessel.rudders else 1.0


def within_travel(vessel: Vessel, sticks: Floats) -> Floats:
    """Sticks (T, 2) with which all thrusters stay within full travel: the helm has priority."""
    out = np.clip(sticks, -1.0, 1.0)
    if not vessel.rudders:
        room = 1.0 - np.abs(out[:, Stick.STEER])
        out[:, Stick.THROTTLE] = np.clip(out[:, Stick.THROTTLE], -room, room)
    return out


def _share(vessel: Vessel, actuator: Thruster | Rudder) -> tuple[float, float]:
    if isinstance(actuator, Rudder):
        return 0.0, 1.0
    longest = max(abs(_lever(thruster)) for thruster in vessel.thrusters)
    steers = not vessel.rudders and longest > 0.0
    return float(np.cos(actuator.azimuth)), _lever(actuator) / longest if steers else 0.0


def _lever(thruster: Thruster) -> float:
    x, y = thruster.position
    return float(x * np.sin(thruster.azimuth) - y * np.cos(thruster.azimuth))


FULL = StickLimits()


def manoeuvre_sticks(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: StickLimits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Throttle and steer (T, 2) on a grid of dt [s], from neutral to neutral.

    `seconds` cuts the manoeuvre short, or repeats it. Amplitudes are scaled to the limits,
    not clipped: the shape stays.
    """
    adapted = manoeuvre.adapted_to(vessel, limits)
    count = max(round((adapted.seconds if seconds is None else seconds) / dt), 1)
    time = dt * np.arange(count, dtype=float) % adapted.seconds
    desired = adapted.sticks(time, np.random.default_rng(seed)) * limits.largest
    desired[:, Stick.STEER] = np.clip(
        helm_gain(vessel) * desired[:, Stick.STEER], -limits.steer, limits.steer
    )
    return slew_limited(within_travel(vessel, desired), limits.rates, dt)


def manoeuvre_commands(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: StickLimits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Commands (T, actuators) in [−1, 1] on a grid of dt [s]."""
    return mix_sticks(vessel, manoeuvre_sticks(manoeuvre, vessel, dt, seed, limits, seconds))


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
    desired = np.vstack(
        [manoeuvre_sticks(manoeuvre, vessel, DT, seed, limits, seconds), np.zeros(2)]
    )
    time = DT * np.arange(len(desired), dtype=float)
    kept = corner_rows(time, desired, TOLERANCE)
    corners: Floats = np.round(desired[kept], 3).astype(float)
    sticks = polyline(time, time[kept], corners)
    commands = mix_sticks(vessel, sticks)
    motion = model.simulate(commands, DT)[1][0, :-1]
    return Plan(
        manoeuvre, vessel, limits, seed, time[kept], corners, time, sticks, commands, motion
    )
