"""One voyage in two recordings: the autopilot's own log and what its radio said, or two receivers.

Counted twice it would only seem surer, and what one of them predicts of the other is no prediction.
Two recordings seem to be of one voyage where their clocks overlap and the boat turns in both alike.
So do simulated voyages that share their date and their manoeuvres: it is said, and nothing refused.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from sim.state import Floats, Nu
from sim.trial import Trial

# All chosen. Clocks of a receiver and of the boat differ by seconds; a formation turns alike within
# a second or so, but not to 0.97 of what each of its boats does.
STEP_S, MAX_SHIFT_S = 0.2, 15.0
MIN_COMMON_S = 60.0
MIN_TURN_RADPS = 0.03  # standard deviation of the yaw rate: less is no turning
MIN_ALIKE = 0.97  # correlation


def same_voyage_notices(trials: Sequence[Trial]) -> list[str]:
    """Of each two recordings that seem to be of one voyage, that they do."""
    out = list[str]()
    for one, other in combinations(trials, 2):
        seconds = seconds_alike(one, other)
        if seconds >= MIN_COMMON_S:
            out.append(
                f"{one.name} and {other.name} turn alike by the clock for {seconds:.0f} s: if "
                "they are of one voyage it counts twice, it only seems surer, and neither is "
                "unseen; then give one of them"
            )
    return out


def seconds_alike(one: Trial, other: Trial) -> float:
    """How long both tell of the same turns at the same time [s]; 0 where they do not."""
    begin = (other.start_time_ns - one.start_time_ns) * 1e-9
    first = max(float(one.time[0]), begin + float(other.time[0])) + MAX_SHIFT_S
    last = min(float(one.time[-1]), begin + float(other.time[-1])) - MAX_SHIFT_S
    if last - first < MIN_COMMON_S - 2.0 * MAX_SHIFT_S:
        return 0.0
    time = np.arange(first, last, STEP_S)
    here = np.interp(time, one.time, one.nu[:, Nu.R])
    shifts = np.arange(-MAX_SHIFT_S, MAX_SHIFT_S + 0.5 * STEP_S, STEP_S)
    alike = [
        _correlation(here, np.interp(time - begin + shift, other.time, other.nu[:, Nu.R]))
        for shift in shifts
    ]
    return last - first + 2.0 * MAX_SHIFT_S if max(alike) > MIN_ALIKE else 0.0


def _correlation(one: Floats, other: Floats) -> float:
    """Of two yaw rates (n,); 0 where a boat hardly turns."""
    if min(np.std(one), np.std(other)) < MIN_TURN_RADPS:
        return 0.0
    return float(np.corrcoef(one, other)[0, 1])
