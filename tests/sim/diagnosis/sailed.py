"""A short voyage of the project's own model with white noise: plumbing, not proof.

Whether causes are found in independent physics is measured by `benchmarks.hidden`.
"""

from functools import cache

import numpy as np

from sim.effects.catalogue import named
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V, commands, trial_of

DT = 0.1
STD = np.array([0.02, 0.02, 0.02, 0.01, 0.01, 0.002, 0.1, 0.1, 0.05])


@cache
def sailed(
    effect: str | None = None, seconds: float = 200.0, seed: int = 1, **values: float
) -> Trial:
    """What the WAM-V with an effect reports."""
    return sailed_with(with_effect(WAM_V, effect, **values) if effect else WAM_V, seconds, seed)


def sailed_with(
    vessel: Vessel, seconds: float = 200.0, seed: int = 1, noise: float = 1.0,
    drive: Floats | None = None,
) -> Trial:  # fmt: skip
    """What a vessel reports; `noise`: times the usual standard deviation; `drive` (T, 2): other
    commands than those of two motors.
    """
    drive = commands(seconds, DT, seed) if drive is None else drive
    std = noise * STD
    _, reports = on_floats(vessel).simulate(drive, DT)
    motion: Floats = reports[0, :-1] + np.random.default_rng(seed).normal(0.0, std, (len(drive), 9))
    return trial_of(
        motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, DT, np.diag(std**2)
    )  # fmt: skip


def with_effect(vessel: Vessel, effect: str, **values: float) -> Vessel:
    """The vessel with one effect more."""
    return vessel.with_effects(AddedEffect(named(effect), values))
