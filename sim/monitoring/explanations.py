"""What may explain that a model lacks something while its boat sails, with priors, as tables.

`sim.monitoring.causes` has the law of each, `sim.monitoring.filters` the filter.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.monitoring import WindModel
from sim.monitoring.causes import BOAT_ERRORS, Hull, Law
from sim.monitoring.filters import BOAT_DRIFT_S, DRIFT_S, NONE
from sim.state import Floats, Ints
from sim.vessel import Vessel

# Standard deviations at the start. Chosen on the tuning voyages of benchmarks/live_naming.py.
CURRENT_PRIOR_MPS = 0.5  # of either component
THRUST_PRIOR = 0.6  # standard deviation of a thruster's share
COMPASS_PRIOR_RAD = 0.25
DRAG_PRIOR = 0.8
ANYTHING_PRIOR = 0.25  # of the thrust full ahead, and of that at half the beam
ANYTHING_DRIFT_S = 120.0  # in which it wanders by its prior


ALL_THRUSTERS = ""  # one share for all of them: another battery, other propellers


class Explanation(NamedTuple):
    """One explanation: prior standard deviations of o (n,), time of its walk [s]."""

    law: Law
    prior: Floats
    drift_s: float = DRIFT_S
    thruster: int = 0
    name: str = ALL_THRUSTERS  # of the thruster


@dataclass(frozen=True)
class Explanations:
    """All explanations of a vessel as tables: F of them, N components of the longest.

    prior (F, N) standard deviation at the start, 0 beyond the last component of each, walk_s (F, N)
    as in `DisturbanceFilter`; `which` (F, 3): law, thruster, number of components
    """

    laws: tuple[Law, ...]  # the first of nothing but the boat's own errors
    names: tuple[str, ...]  # of their thrusters
    prior: Floats
    walk_s: Floats
    which: Ints

    @classmethod
    def of(cls, boat: Floats, each: list[Explanation]) -> "Explanations":
        """Standard deviations of b (10,), and the explanations, the first of nothing."""
        length = BOAT_ERRORS + max(len(one.prior) for one in each)
        prior, walk = np.zeros((len(each), length)), np.full((len(each), length), BOAT_DRIFT_S)
        sizes = [BOAT_ERRORS + len(one.prior) for one in each]
        for f, one in enumerate(each):
            prior[f, : sizes[f]] = np.append(boat, one.prior)
            walk[f, BOAT_ERRORS:] = one.drift_s
        which = [(one.law, one.thruster, size) for one, size in zip(each, sizes, strict=True)]
        laws, names = tuple(one.law for one in each), tuple(one.name for one in each)
        return cls(laws, names, prior, walk, np.array(which, np.int64))


def explanations(vessel: Vessel, thrust: float, wind: float) -> Iterator[Explanation]:
    """All explanations; thrust full ahead [N], prior of the wind's g."""
    yield Explanation(Law.NOTHING, NONE)
    yield Explanation(Law.CURRENT, np.full(2, CURRENT_PRIOR_MPS))
    yield Explanation(Law.WIND, np.full(2, wind))
    for i, thruster in enumerate(vessel.thrusters):
        yield Explanation(Law.THRUST, np.array([THRUST_PRIOR]), DRIFT_S, i, thruster.name)
    if len(vessel.thrusters) > 1:
        prior, count = np.array([THRUST_PRIOR]), len(vessel.thrusters)
        yield Explanation(Law.THRUST, prior, DRIFT_S, count, ALL_THRUSTERS)
    yield Explanation(Law.COMPASS, np.array([COMPASS_PRIOR_RAD]))
    yield Explanation(Law.DRAG, np.array([DRAG_PRIOR]))
    size = ANYTHING_PRIOR * thrust * np.array([1.0, 1.0, 0.5 * vessel.hull.beam])
    yield Explanation(Law.ANYTHING, size, ANYTHING_DRIFT_S)


def hull_of(vessel: Vessel, air: WindModel) -> Hull:
    """What the laws take of a vessel."""
    d = vessel.dynamics
    return Hull(np.array([d.X_u, d.X_uu, d.Y_v, d.Y_vv, d.N_r, d.N_rr]), air.numbers)
