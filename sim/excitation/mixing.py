"""From throttle and helm to the actuators of a vessel.

    thruster   c = throttle · cos α + steer · lever / longest lever
               lever = x sin α − y cos α  [m], the yaw moment per newton
    rudder     c = steer

Where there are rudders they steer alone. A thruster across the boat (bow thruster) has no share of
the throttle; one that makes no yaw moment has none of the helm. This is how an autopilot with skid
steering mixes: with throttle and steer together above full travel it keeps the helm and gives
throttle away, and so does `within_travel`.
"""

import numpy as np

from sim.excitation.manoeuvre import Stick
from sim.state import Floats
from sim.vessel import Rudder, Thruster, Vessel

BLADE = 2.0  # a blade wants more helm than a difference of thrust


def shares(vessel: Vessel) -> Floats:
    """Each actuator's share of throttle and of steer (actuators, 2)."""
    return np.array([_share(vessel, actuator) for actuator in vessel.actuators])


def mixed(vessel: Vessel, sticks: Floats) -> Floats:
    """Throttle and steer (..., 2) -> commands (..., actuators) in [−1, 1]."""
    return np.clip(sticks @ shares(vessel).T, -1.0, 1.0)


def helm_gain(vessel: Vessel) -> float:
    """How much more helm the vessel wants than one that steers by thrust."""
    return BLADE if vessel.rudders else 1.0


def within_travel(vessel: Vessel, sticks: Floats) -> Floats:
    """Sticks (T, 2) whose thrusters all stay within full travel: the helm goes first."""
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
