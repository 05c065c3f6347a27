"""Plain mistakes of a mapping: a rate in another unit, columns of positions that are exchanged.

They show in a short recording too, and in rates that were smoothed: by how a rate and its values
go together over stretches that no window smooths. Of another unit a rate is by a factor.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gateway.ingest.sources import Choice, uniform_grid
from gateway.ingest.stretches import (
    GAP_S,
    HUGE,
    UNITS,
    ascending,
    changes,
    integrals,
    metres,
    over_ground,
    unbroken,
)
from gateway.samples import Quantity
from sim.state import Floats

# Chosen, not measured; what logs of other people show stands in the tests.
SLOW_S, SLOW_EVERY_S, FEWEST_SLOW = 10.0, 2.5, 12
SLOW_TURN_RAD, SLOW_MOVE_M = 0.1, 1.5  # root mean square, for anything to be seen
TOGETHER, APART = 0.95, 0.9  # correlations: of good recordings 0.99 and more
ABOUT_UNIT, ABOUT_ONE = 0.1, 0.15  # of a scale


class SlowAgreement(NamedTuple):
    """How a rate goes with its values over long stretches: correlation, and scale of the rate."""

    correlation: float
    scale: float

    @property
    def mistake(self) -> str | None:
        """The unit that was taken for another, where that is plain."""
        if not self.correlation > TOGETHER:
            return None
        off, text = min((abs(self.scale / factor - 1.0), text) for factor, text in UNITS.items())
        return text if off < ABOUT_UNIT else None


def slow_agreement(
    time: Floats, x: Floats, rate_time: Floats, rate: Floats, least: float
) -> SlowAgreement | None:
    """Values (K, n) and their rates (L, n), as in `rate_agreement`; None: too little is seen."""
    gap = max(GAP_S, *(3.0 * float(np.median(np.diff(t))) for t in (time, rate_time)))
    first, last = max(time[0], rate_time[0]), min(time[-1], rate_time[-1]) - SLOW_S
    begin = uniform_grid(float(first), float(last), SLOW_EVERY_S)
    end = begin + SLOW_S
    whole = unbroken(time, begin, end, gap) & unbroken(rate_time, begin, end, gap)
    begin, end = begin[whole], end[whole]
    if len(begin) < FEWEST_SLOW:
        return None
    moved, turned = (
        changes(t, y, begin, end) for t, y in ((time, x), (rate_time, integrals(rate_time, rate)))
    )
    size, other = float(np.sqrt(np.mean(moved**2))), float(np.sqrt(np.mean(turned**2)))
    if not least < size < HUGE or not 0.0 < other < HUGE:
        return None
    correlation = float(np.mean(moved * turned)) / (size * other)
    return SlowAgreement(correlation, other / size)


def plain_mistakes(choices: Mapping[str, Choice]) -> dict[str, str]:
    """Name of a rate -> a sentence, where it is of another unit than it is said to be, or where
    the columns of the positions are exchanged. Also of rates that are smoothed, and left out.
    """
    out: dict[str, str] = {}
    if "yaw" not in choices:
        return out
    start = int(choices["yaw"].samples.vehicle_time_ns[0])
    at, heading = ascending(choices["yaw"].samples, start)
    if len(at) < 2:
        return out
    turned = np.unwrap(heading[:, :1], axis=0)
    if "yaw rate" in choices:
        when, rate = ascending(choices["yaw rate"].samples, start)
        found = (
            slow_agreement(at, turned, when, rate[:, :1], SLOW_TURN_RAD) if len(when) > 1 else None
        )
        if found is not None and found.mistake is not None:
            out["yaw rate"] = _plain(choices["yaw rate"], found, "the turn of the heading")
    if "velocity" not in choices or "position" not in choices:
        return out
    when, velocity = ascending(choices["velocity"].samples, start)
    position = choices["position"].samples
    then, place = ascending(position, start)
    if len(when) < 2 or len(then) < 2:
        return out
    if choices["velocity"].samples.quantity is Quantity.BODY_VELOCITY:
        velocity = over_ground(velocity, np.interp(when, at, turned[:, 0]))
    given, other = (
        slow_agreement(then, metres(degrees, position.quantity), when, velocity, SLOW_MOVE_M)
        for degrees in (place, place[:, ::-1])
    )
    if given is not None and given.mistake is not None:
        out["velocity"] = _plain(choices["velocity"], given, "the change of position")
    elif given is not None and other is not None and _exchanged(given, other):
        degrees = position.quantity is Quantity.GLOBAL_POSITION
        what = "latitude and longitude" if degrees else "north and east"
        out["velocity"] = (
            f"{what} ({choices['position'].source}) look exchanged: only the other way round do "
            f"positions change as the velocity ({choices['velocity'].source}) says"
        )
    return out


def _exchanged(given: SlowAgreement, other: SlowAgreement) -> bool:
    """Whether positions go with the velocity with their two columns exchanged, and only so."""
    fits = other.correlation > TOGETHER and abs(other.scale - 1.0) < ABOUT_ONE
    return fits and given.correlation < APART


def _plain(rate: Choice, found: SlowAgreement, change: str) -> str:
    return f"{rate.name} ({rate.source}) is {found.scale:.2g} times {change}: {found.mistake}?"
