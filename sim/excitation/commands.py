"""A manoeuvre for a vessel: sticks and commands on a time grid, within limits, by a seed."""

import numpy as np

from sim.excitation.limits import Limits, slewed
from sim.excitation.manoeuvre import Manoeuvre, Stick
from sim.excitation.mixing import helm_gain, mixed, within_travel
from sim.state import Floats
from sim.vessel import Vessel

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
