"""How long a vessel takes to turn once round."""

import numpy as np

from sim.excitation.limits import Limits
from sim.excitation.mixing import helm_gain, mixed, within_travel
from sim.model import Model
from sim.state import Eta
from sim.vessel import Vessel

DT = 0.1  # s
LONGEST, SHORTEST = 120.0, 8.0  # s


def seconds_of_a_turn(vessel: Vessel, limits: Limits, throttle: float, steer: float) -> float:
    """Sticks held -> when the bow has been round [s]: the slower of the two ways to begin.

    From rest, and out of a steady turn to the other side; slew is allowed for. Two minutes at most.
    """
    helm = min(helm_gain(vessel) * steer * limits.steer, limits.steer)
    ahead, count = throttle * limits.throttle, round(LONGEST / DT)
    other, turn = within_travel(vessel, np.array([[ahead, -helm], [ahead, helm]]))
    before = np.stack([np.zeros(2), other])  # (2, 2): one row per run
    sticks = np.concatenate([np.repeat(row[:, None], count, axis=1)
                             for row in (before, np.stack([turn, turn]))], axis=1)  # fmt: skip
    yaw = Model.of(vessel).simulate(mixed(vessel, sticks), DT)[0][:, count:, Eta.YAW]
    round_it = np.abs(yaw - yaw[:, :1]) >= 2.0 * np.pi
    steps = np.where(round_it.any(axis=1), round_it.argmax(axis=1), count)
    eased = max(2.0 * helm / limits.steer_rate, ahead / limits.throttle_rate)
    return min(max(float(steps.max()) * DT + eased, SHORTEST), LONGEST)
