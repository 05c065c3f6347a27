"""Runs of several trials in one call of the model."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification import IdentifySettings
from sim.identification.innovations import track_std
from sim.identification.noise import Noise
from sim.identification.parameters import OFFSETS, ROUNDING, unknowns_of
from sim.identification.runs import RunSet, errors_of_trials, run_errors
from sim.identification.shooting import FitInputs, build_run_set, projected_residuals
from sim.model import Model
from sim.trial import Trial
from tests.sim.diagnosis.sailed import sailed, with_effect
from tests.sim.voyages import WAM_V, simulated

LENGTHS_S = (30.0, 12.0, 21.0)


@pytest.mark.parametrize("tied", [False, True])
def test_several_trials_together_have_the_errors_of_each_alone(tied: bool) -> None:
    """Of other lengths, one of another time step, one too short for a run, a current on each.

    Commands that act early and velocities that are late read the inputs beyond a trial's end.
    """
    trials: list[Trial] = [
        sailed("steady_current", s, 3, speed=0.3, direction=1.0) for s in LENGTHS_S
    ]
    trials += [simulated(WAM_V, 15.0, 0.05), sailed(seconds=0.5)]
    settings = IdentifySettings(free=("m11", "N_r", "steady_current.*"), tied=tied)
    model = Model.of(with_effect(WAM_V, "steady_current", speed=0.2, direction=0.5))
    unknowns = unknowns_of(model, len(trials), settings)
    z = unknowns.start + 0.1 * np.arange(len(unknowns)) * np.array([u.scale for u in unknowns.each])
    for name, value in zip((*OFFSETS, ROUNDING), (-0.06, 0.04, 0.002), strict=True):
        z[unknowns.column(name)] = value
    sets: list[RunSet] = []
    for track in FitInputs(unknowns, trials, settings).tracks():
        noise = Noise(track_std(track.trial), np.full(3, 0.5))
        sets.append(
            build_run_set(track, unknowns, z, noise, 3.0, replace(settings, horizons=(3.0,)))
        )
    several = [np.tile(z, (k + 1, 1)) for k in range(len(sets))]
    together = errors_of_trials(sets, unknowns, several)
    for run_set, own, errors in zip(sets, several, together, strict=True):
        assert errors == pytest.approx(run_errors(run_set, unknowns, own), abs=1e-12)
        left = projected_residuals(run_set, errors)
        assert left.shape == (len(own), 3 * int(run_set.within.sum()))
    assert [len(w.rows.first) > 0 for w in sets] == [True, True, True, True, False]
