"""What drives the stand-in: readings and time in, throttle and steer out; None when it is done.

    PlanPilot      the corners of a plan, straight lines in between, whatever the boat does
    MissionPilot   from waypoint to waypoint: a heading by its error and the turn rate, full cruise
                   throttle where the boat points at the waypoint

Gains of the mission are chosen for boats of a few metres that steer by thrust; a rudder gets more
helm (`helm_gain`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gateway.stand_in.json_client import SensorReply
from sim.excitation.sticks import Plan

Sticks = tuple[float, float]  # throttle, steer: −1 … 1
STEER_PER_RAD, STEER_PER_RATE, MOST_STEER = 0.8, 0.6, 0.4


class Pilot(Protocol):
    """Drives a boat from rest."""

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        """Throttle and steer at a moment [s since the start]; None: it is over."""
        ...


@dataclass(frozen=True)
class PlanPilot:
    """A plan, open loop: what its Lua script plays in the firmware."""

    plan: Plan

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        times, rows = self.plan.corner_time, self.plan.corner_sticks
        if seconds > times[-1]:
            return None
        return float(np.interp(seconds, times, rows[:, 0])), float(
            np.interp(seconds, times, rows[:, 1])
        )


class MissionPilot:
    """Waypoints (north, east) [m], each reached within `radius` [m]."""

    def __init__(
        self,
        waypoints: Sequence[tuple[float, float]],
        throttle: float,
        radius: float = 2.0,
        helm_gain: float = 1.0,
    ) -> None:
        self._ahead, self._throttle, self._radius = list(waypoints), throttle, radius
        self._helm = helm_gain

    def sticks(self, seconds: float, read: SensorReply) -> Sticks | None:
        while self._ahead:
            north, east = (a - b for a, b in zip(self._ahead[0], read.position[:2], strict=True))
            if math.hypot(north, east) > self._radius:
                break
            del self._ahead[0]
        if not self._ahead:
            return None
        error = math.remainder(math.atan2(east, north) - read.attitude[2], math.tau)
        steer = self._helm * (STEER_PER_RAD * error - STEER_PER_RATE * read.gyro[2])
        steer = max(-MOST_STEER, min(MOST_STEER, steer))
        return self._throttle * max(math.cos(error), 0.0), steer
