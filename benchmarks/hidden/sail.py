"""Time passes: a pilot looks, sticks become pulses, nature answers, fifty times a second."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden.battery import Battery
from benchmarks.hidden.nature import SHAFTS, Nature
from benchmarks.hidden.pilots import REST, TICK, Pilot, pulses_of
from benchmarks.hidden.scene import Report

Floats = NDArray[np.float64]

PRELUDE, EPILOGUE = 6.0, 2.0  # s, disarmed before and after
GRAIN = 2.0**27


class Truth(NamedTuple):
    """What happened, every TICK: K moments, m outputs. Pulses hold for the tick that follows.

    time (K,) s after arming, motion (K, 6) as in `nature`, pulses (K, m) µs, volts and amperes (K,)
    """

    time: Floats
    motion: Floats
    pulses: NDArray[np.int64]
    volts: Floats
    amperes: Floats
    armed: NDArray[np.bool_]


def sail(nature: Nature, pilot: Pilot, noise: Report, start: list[float], seconds: float) -> Truth:
    """A voyage from `start` (north, east, yaw); `noise` (K,) is what the sensors add to it."""
    boat = nature.boat
    n = ticks_of(seconds)
    time = TICK * np.arange(n, dtype=np.float64) - PRELUDE
    armed = (time >= -0.5 * TICK) & (time < seconds - 0.5 * TICK)
    outputs = boat.outputs
    state = [*start, 0.0, 0.0, 0.0, *(0.0 for _ in outputs)]
    battery, ears = Battery(nature.tired), Ears(nature.delay, len(outputs))
    motion, pulses = np.empty((n, 6)), np.empty((n, len(outputs)), dtype=np.int64)
    electricity = np.empty((n, 2))
    for k in range(n):
        motion[k] = state[:SHAFTS]
        stick = REST
        if armed[k]:
            stick = pilot.send(_seen(nature, state, noise, k)) if armed[k - 1] else next(pilot)
        pulses[k] = pulses_of(boat, stick)
        commands = [o.command(int(p)) for o, p in zip(outputs, pulses[k], strict=True)]
        electricity[k] = battery.drawn(commands[: len(boat.motors)], TICK)
        state = stepped(nature, float(time[k]), state, ears.hear(commands), battery.volts)
    return Truth(time, motion, pulses, electricity[:, 0], electricity[:, 1], armed)


def ticks_of(seconds: float) -> int:
    """How many ticks a voyage of so many armed seconds has."""
    return round((PRELUDE + seconds + EPILOGUE) / TICK)


def stepped(
    nature: Nature, time: float, state: list[float], commands: Sequence[float], volts: float
) -> list[float]:
    """The state one tick later by Runge and Kutta's fourth order.

    It is rounded to 7e-9, so that the last bit of a sine, which is not the same on all processors,
    does not grow: a voyage is the same file everywhere.
    """

    def rates(share: float, k: Sequence[float]) -> list[float]:
        ahead = [x + share * TICK * d for x, d in zip(state, k, strict=True)]
        return nature.rates(time + share * TICK, ahead, commands, volts)

    k1 = nature.rates(time, state, commands, volts)
    k2 = rates(0.5, k1)
    k3 = rates(0.5, k2)
    k4 = rates(1.0, k3)
    return [
        math.floor((x + TICK / 6.0 * (a + 2.0 * b + 2.0 * c + d)) * GRAIN + 0.5) / GRAIN
        for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
    ]


class Ears:
    """The motors hear commands late: the mean, over a tick, of what was said `delay` before."""

    def __init__(self, delay: float, outputs: int) -> None:
        self._whole, self._share = divmod(delay / TICK, 1.0)
        self._said = [[0.0] * outputs] * (int(self._whole) + 1)

    def hear(self, commands: list[float]) -> list[float]:
        """What is said now -> what is heard now."""
        self._said.append(commands)
        earlier, later = self._said[:2]
        del self._said[0]
        return [
            s * self._share + (1.0 - self._share) * c for s, c in zip(earlier, later, strict=True)
        ]


def _seen(nature: Nature, state: list[float], noise: Report, k: int) -> Report:
    seen = nature.reported(Report._make(state[:SHAFTS]))
    return Report(*(float(x) + float(e[k]) for x, e in zip(seen, noise, strict=True)))
