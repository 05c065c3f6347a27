"""Voyages in a current, and what tests of a diagnosis share."""

import numpy as np

from sim.diagnosis.diagnose import DiagnoseSettings
from sim.effects.catalogue import named
from sim.vessel import AddedEffect
from tests.sim.voyages import trial_of, voyage

NOISE = np.array([0.02, 0.02, 0.003, 0.01, 0.01, 0.003, 0.03, 0.03, 0.01])


FEW = DiagnoseSettings(effects=tuple(map(named, ("steady_current", "heading_offset"))))


KEEL = """
from sim.effects.effect import Effect, Parameter, Scope
from sim.state import Wrench


def force(flow, p):
    return Wrench(0.0, 0.0, -p.k * flow.u * flow.r)


EFFECT = Effect(
    name="keel", scope=Scope.BOAT, force=force, looks_like="turns too fast at speed",
    parameters=(Parameter("k", unit="N s²", lower=0.0, upper=500.0, start=10.0),),
)
"""


def sailed(seconds, current, seed):
    """A voyage in a current towards (north, east), by physics of its own."""
    *motion, drive = voyage(seconds, 0.1, seed=seed, current=current)
    rng = np.random.default_rng(seed)
    noisy = [m + rng.normal(size=m.shape) * NOISE[3 * i : 3 * i + 3] for i, m in enumerate(motion)]
    return trial_of(*noisy, drive, 0.1, np.diag(NOISE**2))


def found_current():
    return AddedEffect(FEW.effects[0], {"speed": 0.1, "direction": 0.0})


def refused(done, *expected):
    status, out, err = done
    assert (status, out) == (2, "")
    assert err.count("\n") == 1, err
    for part in expected:
        assert part in err, err
