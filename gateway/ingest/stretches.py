"""Values and rates of one boat as series, and what they do over stretches of time."""

import numpy as np

from gateway.ingest.mapping import Origin, to_local
from gateway.samples import Quantity, Samples
from sim.state import Floats, turned

GAP_S = 0.6  # a longer silence ends a stretch
HUGE = 1e6  # rad or m in a stretch, in whatever unit: no boat
UNITS = {  # rate over what the values say -> the usual mistake
    57.296: "degrees taken for radians", 1.0 / 57.296: "radians taken for degrees",
    1.9438: "knots taken for m/s", 0.5144: "m/s taken for knots",
    3.6: "km/h taken for m/s", 1.0 / 3.6: "m/s taken for km/h",
    100.0: "cm/s taken for m/s", 0.01: "m/s taken for cm/s", 2.2369: "mph taken for m/s",
}  # fmt: skip


def metres(place: Floats, quantity: Quantity) -> Floats:
    """Positions (K, 2), local or global -> [m] from where most of them lie: a first fix may err."""
    if quantity is not Quantity.GLOBAL_POSITION:
        return place
    return to_local(place, Origin(*map(float, np.median(place, axis=0))))


def over_ground(velocity: Floats, yaw: Floats) -> Floats:
    """Velocities ahead and to starboard (K, 2), headings (K,) -> towards north, east (K, 2)."""
    return turned(velocity, yaw)


def ascending(samples: Samples, start_ns: int) -> tuple[Floats, Floats]:
    """Times (K,) [s] that rise and values (K, n) that are known."""
    time, values = samples.seconds(start_ns), np.asarray(samples.values, np.float64)
    good = np.isfinite(values).all(axis=1)
    time, values = time[good], values[good]
    order = np.argsort(time, kind="stable")
    time, values = time[order], values[order]
    new = np.concatenate([[True], np.diff(time) > 0.0]) if len(time) else np.zeros(0, bool)
    return time[new], values[new]


def unbroken(time: Floats, begin: Floats, end: Floats, gap_s: float = GAP_S) -> np.ndarray:
    """Which stretches (M,) hold no silence of the times (K,)."""
    gaps = np.concatenate([[0.0], np.cumsum(np.diff(time) > gap_s)])
    first = np.clip(np.searchsorted(time, begin, side="right") - 1, 0, len(time) - 1)
    last = np.clip(np.searchsorted(time, end), 0, len(time) - 1)
    return np.asarray(gaps[first] == gaps[last])


def integrals(time: Floats, rate: Floats) -> Floats:
    """Integrals of rates (L, n) from the first time on."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(steps, axis=0)])


def value_at(time: Floats, y: Floats, when: Floats) -> Floats:
    """A series (K,) at other times (M,), between its rows."""
    return np.interp(when, time, y)


def changes(time: Floats, y: Floats, begin: Floats, end: Floats) -> Floats:
    """By how much series (K, n) change over stretches: (M, n)."""
    each = [value_at(time, column, end) - value_at(time, column, begin) for column in y.T]
    return np.stack(each, axis=1)
