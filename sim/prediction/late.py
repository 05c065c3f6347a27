"""Runs of a model whose position and velocity over ground are reported late.

Where she was when a run begins is reported `age` later: (p, V)(t) = reported (p, V)(t + age), the
heading and the yaw rate are those of t. What a run itself says of its first `age` is older than its
beginning: there the report stands for it, which tells nothing. `observe` of such an effect knows
one moment alone and is right to second order; in half a second of a hard turn that is not enough.
"""

import numpy as np

from sim.model import Model
from sim.state import Eta, Floats, Ints, Nu, turned

U, V = 3 + Nu.U, 3 + Nu.V  # columns of reported motion
OVER_GROUND = [Eta.NORTH, Eta.EAST, U, V]  # that are late


def true_starts(
    model: Model, theta: Floats, motion: Floats, rows: Ints, dt: float, moved: Floats | None = None
) -> Floats:
    """True pose and velocity at rows (S,) of reported motion (T, 9), dt [s] apart, as each of theta
    (K, P) has it: (S K, 6), those of one row together; `moved` (S K, 9): added to the reports.
    """
    reported, ages = np.repeat(motion[rows], len(theta), axis=0), model.ages(theta)
    if ages.any():
        at = np.minimum((rows[:, None] + ages / dt).ravel(), len(motion) - 1.0)
        before = np.minimum(np.floor(at).astype(np.int64), len(motion) - 2)
        share = (at - before)[:, None]
        ground = motion[:, OVER_GROUND]
        ground[:, 2:] = turned(motion[:, [U, V]], motion[:, Eta.YAW])
        then = (1.0 - share) * ground[before] + share * ground[before + 1]
        then[:, 2:] = turned(then[:, 2:], -reported[:, Eta.YAW])
        reported[:, OVER_GROUND] = then
        theta = model.in_time(theta)
    return model.true_states(reported if moved is None else reported + moved, theta=theta)


def reported_before(
    model: Model, theta: Floats, reports: Floats, motion: Floats, rows: Ints, dt: float
) -> None:
    """In reports (S, K, H, 9) of runs from rows (S,), what is older than their beginning becomes
    the reported motion (T, 9).
    """
    ages = model.ages(theta)
    for k in np.flatnonzero(ages):
        old = slice(0, int(np.ceil(ages[k] / dt)))
        run = reports[:, k, old]
        at = np.minimum(rows[:, None] + np.arange(run.shape[1]), len(motion) - 1)
        known = np.isfinite(run[..., :1])
        run[..., OVER_GROUND] = np.where(known, motion[at][..., OVER_GROUND], np.nan)
