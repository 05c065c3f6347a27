"""From throttle and helm to the actuators of a vessel.

    thruster   c = throttle · cos α + steer · lever / longest lever
               lever = x sin α − y cos α  [m], the yaw moment per newton
    rudder     c = steer

Where there are rudders they steer alone. A thruster across the boat (bow thruster) has no share of
the throttle; one that makes no yaw moment has none of the helm. This is how an autopilot with skid
steering mixes: with throttle and steer together above full travel it keeps the helm and gives
throttle away, and so does `within_travel`.

A manoeuvre for a vessel: sticks and commands on a time grid, within limits, by a seed.
"""

import numpy as np

from sim.excitation.manoeuvre import Limits, Manoeuvre, Stick, slewed
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


FULL = Limits()


def sticks_of(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: Limits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Throttle and steer (T, 2) on a grid of dt [s], from neutral to neutral.

    `seconds` cuts the manoeuvre short, or begins it again. Amplitudes are scaled to the limits,
    not clipped: the shape stays.
    """
    suited = manoeuvre.suited(vessel, limits)
    count = max(round((suited.seconds if seconds is None else seconds) / dt), 1)
    time = dt * np.arange(count, dtype=float) % suited.seconds
    wanted = suited.sticks(time, np.random.default_rng(seed)) * limits.largest
    wanted[:, Stick.STEER] = np.clip(
        helm_gain(vessel) * wanted[:, Stick.STEER], -limits.steer, limits.steer
    )
    return slewed(within_travel(vessel, wanted), limits.rates, dt)


def commands_of(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: Limits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Commands (T, actuators) in [−1, 1] on a grid of dt [s]."""
    return mixed(vessel, sticks_of(manoeuvre, vessel, dt, seed, limits, seconds))
