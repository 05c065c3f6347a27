"""What the pilot does: a table of commands that repeats, a pure function of time.

Built-in programs are written as surge and yaw in [−1, 1] and handed out to the actuators; a table
of a user's own (CSV) speaks to each actuator by its name.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.random import Generator

from gateway.errors import BadInput
from gateway.pipelines.simulate import read_commands
from sim.state import Floats
from sim.vessel import Rudder, Thruster, Vessel

THROTTLE_RATE, HELM_RATE = 1.0, 2.0  # 1/s: ArduRover's own limit of throttle; a quick hand
EASE_STEP = 0.04  # s
BLADE = 2.0  # a blade wants more helm than a difference of thrust
Leg = tuple[float, float, float]  # seconds, surge, yaw (positive turns to starboard)


@dataclass(frozen=True)
class Program:
    """Row k of `rows` (R, na) acts from `starts` (R,) [s] on; after `period` all repeats."""

    starts: Floats
    rows: Floats
    period: float

    def row_at(self, time_s: float) -> int:
        """Which row acts at that moment; before the start it is the first."""
        into = max(time_s, 0.0) % self.period
        return int(np.searchsorted(self.starts, into, side="right")) - 1


def program_of(vessel: Vessel, wanted: str | Path = "mixed", seed: int = 0) -> Program:
    """A built-in program by its name, else a CSV of commands."""
    if str(wanted) in PROGRAMS:
        return _handed_out(vessel, PROGRAMS[str(wanted)](np.random.default_rng(seed)))
    path = Path(wanted)
    if not path.exists():
        raise BadInput(f"{wanted}: neither a table of commands nor one of {', '.join(PROGRAMS)}")
    times, rows = read_commands(path, vessel)
    return Program(times[:-1], rows[:-1], float(times[-1]))


def steps(dice: Generator) -> list[Leg]:
    """Throttle up and down, ahead and astern, with a little helm both ways."""
    levels = (0.3, 0.6, 0.9, 0.45, 0.0, -0.4, 0.2, 1.0, 0.5)
    return [(8.0, level, 0.1 * (-1) ** k) for k, level in enumerate(levels)]


def zigzag(dice: Generator) -> list[Leg]:
    """Helm from side to side at two speeds."""
    return [(5.0, surge, side * 0.35) for surge in (0.5, 0.8) for side in (1, -1, -1, 1, 1, -1)]


def turns(dice: Generator) -> list[Leg]:
    """Full circles both ways at two speeds, then on the spot."""
    circles = [(20.0, surge, side * 0.3) for surge in (0.4, 0.7) for side in (1, -1)]
    return [*circles, (10.0, 0.0, 0.5), (10.0, 0.0, -0.5)]


def chirp(dice: Generator) -> list[Leg]:
    """Helm and throttle swing faster and faster: 0.03 to 0.5 Hz in a minute."""
    step, seconds, low, high = 0.1, 60.0, 0.03, 0.5
    legs = []
    for time in np.arange(0.0, seconds, step).tolist():
        phase = 2.0 * math.pi * (low * time + 0.5 * (high - low) / seconds * time * time)
        legs.append((step, 0.5 + 0.3 * math.sin(0.7 * phase), 0.3 * math.sin(phase)))
    return legs


def random(dice: Generator) -> list[Leg]:
    """Levels and times that nobody could foresee."""
    return [
        (dice.uniform(2.0, 6.0), dice.uniform(-0.3, 0.9), dice.uniform(-0.4, 0.4))
        for _ in range(30)
    ]


def mixed(dice: Generator) -> list[Leg]:
    """One after the other."""
    return [leg for play in (steps, zigzag, turns, chirp, random) for leg in play(dice)]


def still(dice: Generator) -> list[Leg]:
    """Nobody touches anything."""
    return [(60.0, 0.0, 0.0)]


PROGRAMS: Mapping[str, Callable[[Generator], list[Leg]]] = {
    play.__name__: play for play in (mixed, steps, zigzag, turns, chirp, random, still)
}


def _handed_out(vessel: Vessel, legs: list[Leg]) -> Program:
    """Surge and yaw -> commands of each actuator."""
    seconds, surge, yaw = np.array(list(_eased(legs))).T
    ends = np.cumsum(seconds)
    ahead, helm = np.array([_share(vessel, actuator) for actuator in vessel.actuators]).T
    rows = np.clip(np.outer(surge, ahead) + np.outer(yaw, helm), -1.0, 1.0)
    return Program(ends - seconds, rows, float(ends[-1]))


def _eased(legs: list[Leg]) -> Iterator[Leg]:
    """The same legs, from one to the next as fast as a stick and MOT_SLEWRATE allow."""
    for (_, surge_was, yaw_was), (seconds, surge, yaw) in zip(legs[-1:] + legs, legs, strict=False):
        takes = max(abs(surge - surge_was) / THROTTLE_RATE, abs(yaw - yaw_was) / HELM_RATE)
        count = int(min(takes, 0.9 * seconds) / EASE_STEP)
        for k in range(1, count + 1):
            share = k / (count + 1)
            yield (
                EASE_STEP,
                surge_was + share * (surge - surge_was),
                yaw_was + share * (yaw - yaw_was),
            )
        yield seconds - count * EASE_STEP, surge, yaw


def _share(vessel: Vessel, actuator: Thruster | Rudder) -> tuple[float, float]:
    """An actuator's share of surge and of yaw; rudders steer alone where there are any."""
    if isinstance(actuator, Rudder):
        return 0.0, BLADE
    longest = max(abs(_lever(thruster)) for thruster in vessel.thrusters)
    steers = not vessel.rudders and longest > 0.0
    return math.cos(actuator.azimuth), _lever(actuator) / longest if steers else 0.0


def _lever(thruster: Thruster) -> float:
    """Yaw moment per newton of thrust [m]."""
    x, y = thruster.position
    return x * math.sin(thruster.azimuth) - y * math.cos(thruster.azimuth)
