"""Where a live model is wrong: what its errors have in common, over the last minutes.

Every second has a heading, a speed, a turn and a throttle; each bin keeps how much error and how
much time fell into it, forgotten over minutes. The worst is the one with the most error beyond its
share of time, as in `where`.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim.diagnosis.moment import Moment
from sim.diagnosis.words import COMPASS
from sim.state import Floats, Nu

FORGET_S = 300.0
NEEDED_S = 5.0  # in a bin, before it is named
EXCESS = 0.15  # share of the error beyond the share of the time
VISITED_S = 3.0  # a heading that counts
HEADINGS = tuple(f"heading {name}" for name in COMPASS)
SPEEDS_MPS = (0.3, 0.8, 1.5, 2.5, 4.0)
SPEEDS = (
    f"slower than {SPEEDS_MPS[0]:g} m/s",
    *(f"at {a:g} to {b:g} m/s" for a, b in pairwise(SPEEDS_MPS)),
    f"faster than {SPEEDS_MPS[-1]:g} m/s",
)
SHARP_RADPS = 0.1
TURNS = ("turning to port", "going straight", "turning to starboard")
PUSHES = (-0.05, 0.05, 0.5)  # of the thrust full ahead
THROTTLES = ("with thrust astern", "without thrust", "at low throttle", "at high throttle")
PLACES = (*HEADINGS, *SPEEDS, *TURNS, *THROTTLES)
STARTS = np.cumsum([0, len(HEADINGS), len(SPEEDS), len(TURNS)])


@dataclass(frozen=True)
class Haunts:
    """error, seconds (n,) of each of `PLACES`; every second is in four of them."""

    error: Floats
    seconds: Floats

    @classmethod
    def start(cls) -> "Haunts":
        """Nothing seen yet."""
        return cls(np.zeros(len(PLACES)), np.zeros(len(PLACES)))

    def observe(self, moment: Moment, z: float, ahead: float) -> "Haunts":
        """One more second with that error; `ahead` [N] is the thrust of full throttle."""
        kept = 1.0 - 1.0 / FORGET_S
        error, seconds = kept * self.error, kept * self.seconds
        here = places_of(moment, ahead)
        error[here] += z
        seconds[here] += 1.0
        return Haunts(error, seconds)

    @property
    def headings(self) -> int:
        """How many of the eight headings were sailed."""
        return int(np.count_nonzero(self.seconds[: len(HEADINGS)] >= VISITED_S))

    @property
    def worst(self) -> str:
        """The place that holds most error beyond its time; empty where there is none."""
        total, time = self.error.sum() / 4.0, self.seconds.sum() / 4.0
        if total <= 0.0 or time <= 0.0:
            return ""
        excess = np.where(self.seconds >= NEEDED_S, self.error / total - self.seconds / time, 0.0)
        k = int(np.argmax(excess))
        return PLACES[k] if excess[k] > EXCESS else ""


def places_of(moment: Moment, ahead: float) -> list[int]:
    """Heading, speed, turn and throttle of a second, as numbers of `PLACES`."""
    nu = moment.nu
    sector = round(moment.yaw / (np.pi / 4.0)) % 8
    speed = int(np.searchsorted(SPEEDS_MPS, np.hypot(nu[Nu.U], nu[Nu.V])))
    turn = int(np.searchsorted((-SHARP_RADPS, SHARP_RADPS), nu[Nu.R]))
    push = int(np.searchsorted(PUSHES, moment.commanded[0] / ahead)) if ahead > 0.0 else 1
    return [int(start) + k for start, k in zip(STARTS, (sector, speed, turn, push), strict=True)]
