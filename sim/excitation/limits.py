"""How far and how fast the sticks may move: amplitude and slew rate, and neutral at both ends."""

from dataclasses import dataclass, fields

import numpy as np

from sim.state import Floats


@dataclass(frozen=True)
class Limits:
    """Largest throttle and steer (0, 1], fastest change [1/s]: ArduRover's throttle, a hand."""

    throttle: float = 1.0
    steer: float = 1.0
    throttle_rate: float = 1.0
    steer_rate: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise ValueError(f"{field.name} = {value}: expected a number above 0")
        if max(self.throttle, self.steer) > 1.0:
            raise ValueError("throttle and steer: expected at most 1, full travel")

    @property
    def largest(self) -> Floats:
        """Throttle, steer (2,)."""
        return np.array([self.throttle, self.steer])

    @property
    def rates(self) -> Floats:
        """Throttle, steer (2,) [1/s]."""
        return np.array([self.throttle_rate, self.steer_rate])


def slewed(wanted: Floats, rates: Floats, dt: float) -> Floats:
    """Sticks (T, n) on a grid of dt [s] -> the same no faster than `rates` (n,) [1/s].

    The first row and the one after the last are neutral.
    """
    if not len(wanted):
        return wanted.copy()
    step = np.asarray(rates) * dt
    left = np.arange(len(wanted), 0, -1)[:, None] * step  # how far one may be from neutral
    columns = np.clip(wanted, -left, left).T.tolist()
    return np.array([_chase(column, s) for column, s in zip(columns, step, strict=True)]).T


def _chase(wanted: list[float], step: float) -> list[float]:
    """Follow from 0 with at most `step` a row."""
    out, now = [0.0], 0.0
    for value in wanted[1:]:
        now += min(max(value - now, -step), step)
        out.append(now)
    return out
