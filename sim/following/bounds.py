"""What a boat can do, and how long a state may run on: a state beyond either begins anew.

    |u|, |v| <= MAX_SPEED_MPS,   |r| <= MAX_TURN_RADPS,   all finite

Beyond them a model has diverged: its numbers describe no boat at the motion that was asked of it.
"""

import numpy as np

from sim.jit import jitable

MAX_SPEED_MPS = 150.0  # the fastest boat so far went 142 m/s (Spirit of Australia, 1978)
MAX_TURN_RADPS = 20.0  # chosen: small racing boats on a short line turn about half as fast
# Between two rows; a state older than that says nothing about now. The estimator begins anew after
# as long a silence, see `gap_s` of its settings.
LONGEST_SPAN_S = 60.0


@jitable
def is_possible(u: float, v: float, r: float) -> bool:
    """Velocities [m/s, m/s, rad/s] of a state -> whether a boat can have them; not where NaN."""
    return abs(u) <= MAX_SPEED_MPS and abs(v) <= MAX_SPEED_MPS and abs(r) <= MAX_TURN_RADPS


@jitable
def within(value: float, limit: float) -> float:
    """The value cut off at ±limit; NaN becomes the limit."""
    if np.isnan(value):
        return limit
    return min(max(value, -limit), limit)


@jitable
def runs_on(now: float, before: float) -> bool:
    """Whether a state of `before` [s] can be carried to `now`; not where there is none (NaN)."""
    return abs(now - before) <= LONGEST_SPAN_S
