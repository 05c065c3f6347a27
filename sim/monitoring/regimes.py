"""Where a live model is wrong: when heading west, with thrust astern.

Every second has a heading, a speed, a turn and a throttle; each bin keeps how much error and how
much time fell into it, forgotten over minutes, and the worst is the one with the most error beyond
its share of time, as in a comparison.
"""

from bisect import bisect_left
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from sim.comparison import COMPASS
from sim.monitoring import SecondMeans
from sim.state import Floats, Nu

# All chosen, not measured.
REGIME_MEMORY_S = 300.0
MIN_REGIME_S = 5.0  # in a bin, before it is named
MIN_REGIME_EXCESS = 0.15  # share of the error beyond the share of the time
MIN_HEADING_S = 3.0  # for a heading to count as sailed

SPEED_EDGES_MPS = (0.3, 0.8, 1.5, 2.5, 4.0)
TURN_EDGES_RADPS = (-0.1, 0.1)
THRUST_EDGES = (-0.05, 0.05, 0.5)  # of the thrust full ahead
HEADINGS = tuple(f"heading {name}" for name in COMPASS)
SPEEDS = (
    f"slower than {SPEED_EDGES_MPS[0]:g} m/s",
    *(f"at {a:g} to {b:g} m/s" for a, b in pairwise(SPEED_EDGES_MPS)),
    f"faster than {SPEED_EDGES_MPS[-1]:g} m/s",
)
TURNS = ("turning to port", "going straight", "turning to starboard")
THROTTLES = ("with thrust astern", "without thrust", "at low throttle", "at high throttle")
REGIMES = (*HEADINGS, *SPEEDS, *TURNS, *THROTTLES)
FIRST = (0, *accumulate(map(len, (HEADINGS, SPEEDS, TURNS))))  # regime of each kind


@dataclass(frozen=True)
class ErrorByRegime:
    """error, seconds (n,) of each of `REGIMES`; every second is in four of them.

    sailed  (8,) seconds under way on each heading since the trouble began
    """

    error: Floats
    seconds: Floats
    sailed: Floats

    @classmethod
    def start(cls) -> "ErrorByRegime":
        """The state before the first second."""
        return cls(np.zeros(len(REGIMES)), np.zeros(len(REGIMES)), np.zeros(len(HEADINGS)))

    def observe(
        self, second: SecondMeans, z: float, ahead: float, drives: bool = True
    ) -> "ErrorByRegime":
        """One more second with that error; `ahead` [N] is the thrust of full throttle.

        `drives`: whether a motor does; adrift all headings tell the same of water and air.
        """
        kept = 1.0 - 1.0 / REGIME_MEMORY_S
        error, seconds = kept * self.error, kept * self.seconds
        here = regimes_at(second, ahead)
        error[here] += z
        seconds[here] += 1.0
        sailed = self.sailed.copy()
        sailed[here[0]] += drives
        return ErrorByRegime(error, seconds, sailed)

    def reopened(self) -> "ErrorByRegime":
        """Trouble has begun: headings that were sailed before it tell nothing of it."""
        return replace(self, sailed=np.zeros(len(HEADINGS)))

    @property
    def headings(self) -> int:
        """How many of the eight headings were sailed since the trouble began."""
        return int(np.count_nonzero(self.sailed >= MIN_HEADING_S))

    @property
    def worst(self) -> str:
        """The regime that holds most error beyond its time; empty where there is none."""
        total, time = self.error.sum() / 4.0, self.seconds.sum() / 4.0
        if total <= 0.0 or time <= 0.0:
            return ""
        excess = self.error / total - self.seconds / time
        excess = np.where(self.seconds >= MIN_REGIME_S, excess, 0.0)
        k = int(np.argmax(excess))
        return REGIMES[k] if excess[k] > MIN_REGIME_EXCESS else ""


def regimes_at(second: SecondMeans, ahead: float) -> list[int]:
    """Heading, speed, turn and throttle of a second, as numbers of `REGIMES`."""
    nu = second.nu
    heading = round(second.yaw / (np.pi / 4.0)) % 8
    speed = bisect_left(SPEED_EDGES_MPS, float(np.hypot(nu[Nu.U], nu[Nu.V])))
    turn = bisect_left(TURN_EDGES_RADPS, float(nu[Nu.R]))
    throttle = 1
    if ahead > 0.0:
        throttle = bisect_left(THRUST_EDGES, float(second.commanded[0]) / ahead)
    each = (heading, speed, turn, throttle)
    return [first + k for first, k in zip(FIRST, each, strict=True)]
