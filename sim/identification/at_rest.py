"""Axes along which the boat hardly moved, whose numbers recordings cannot tell.

Without motion a fit explains what wanders in the measurements: of a boat that went straight for
five minutes the damping of turning was -0.003 N m s where it is -18, with an interval of 0.8.
"""

from collections.abc import Sequence

import numpy as np

from sim.identification.noise import MIN_SIGMA
from sim.state import Floats
from sim.trial import Trial

# Chosen: three simulated voyages straight ahead had 0.8 to 1.2, voyages with turns 70 to 540 in
# yaw rate and 2.5 to 9 in sway.
MIN_MOTION_STD = 3.0
MOST_STD = np.array([0.05, 0.05, 0.005])  # of u, v, r that a stated noise is believed to be here
AXES_AT_REST = {
    "surge": "the boat hardly moved ahead or astern",
    "sway": "the boat neither turned nor slid sideways",
    "yaw": "the boat hardly turned",
}


def track_std(trial: Trial) -> Floats:
    """Standard deviation of the measured u, v, r that the trial states: (3,), median in time."""
    variance = np.einsum("tii->ti", trial.covariance)[trial.usable, 3:6]
    stated = np.sqrt(np.median(variance, axis=0)) if len(variance) else MIN_SIGMA
    return np.asarray(np.maximum(np.nan_to_num(stated), MIN_SIGMA))


def axes_at_rest(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Those of `AXES_AT_REST` along which no recording shows more motion than its noise.

    Some 0.15 m/s or 1 °/s are motion, whatever a recording states.

    A turn pushes sideways: how little a boat slides in it tells of her, so sway counts as at rest
    only where yaw does.
    """
    moved = [
        np.sqrt(np.mean(t.nu[t.usable] ** 2, axis=0))
        > MIN_MOTION_STD * np.minimum(track_std(t), MOST_STD)
        for t in trials
        if t.usable.any()
    ]
    if not moved:
        return ()
    surge, sway, yaw = np.any(moved, axis=0)
    rest = {"surge": not surge, "sway": not sway and not yaw, "yaw": not yaw}
    return tuple(name for name, still in rest.items() if still)


def axis_of(name: str) -> str:
    """The axis whose motion tells a number of the base; empty of all others."""
    if name in ("m11", "X_u", "X_uu"):
        return "surge"
    if name == "m22" or name.startswith("Y_"):
        return "sway"
    return "yaw" if name == "m33" or name == "x_g" or name.startswith("N_") else ""
