"""A curve with fewer points (Ramer 1972, Douglas and Peucker 1973, distance along the value axis).

An autopilot's script has kilobytes for a plan, not a row for every tenth of a second.
"""

import numpy as np

from sim.state import Floats


def corners(time: Floats, values: Floats, tolerance: float) -> list[int]:
    """Rows of (T,), (T, n) whose straight connection is off by no more than the tolerance."""
    kept, todo = {0, len(time) - 1}, [(0, len(time) - 1)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        share = (time[inside] - time[first]) / (time[last] - time[first])
        line = values[first] + share[:, None] * (values[last] - values[first])
        off = np.abs(values[inside] - line).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = first + 1 + worst
            kept.add(middle)
            todo += [(first, middle), (middle, last)]
    return sorted(kept)


def connected(time: Floats, at: Floats, values: Floats) -> Floats:
    """Straight lines through values (K, n) at times (K,), read at times (T,) -> (T, n)."""
    return np.stack([np.interp(time, at, column) for column in values.T], axis=-1)
