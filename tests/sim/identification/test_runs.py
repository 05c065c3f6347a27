"""Runs of several trials in one call of the model."""

from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit import fit_effects, start_values, unknowns_for
from sim.diagnosis.fit_problem import SupersetModel
from sim.effects.catalogue import named
from sim.identification import IdentifySettings
from sim.identification.at_rest import track_std
from sim.identification.noise import Noise
from sim.identification.parameters import OFFSETS, ROUNDING, unknowns_of
from sim.identification.runs import RunSet, errors_of_trials, run_errors
from sim.identification.shooting import FitInputs, build_run_set, projected_residuals
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import sailed, sailed_with, with_effect
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


def test_what_motors_that_lag_give_as_a_run_begins_follows_from_their_own_lag() -> None:
    """Else a fit sees what a lag does along a run, not what it did before, and stops half way."""
    trial = sailed("thruster_lag", 40.0, 3, tau=0.6)
    settings = IdentifySettings(free=("m33", "thruster_lag.tau"), offsets=False, horizons=(3.0,))
    vessels = [with_effect(WAM_V, "thruster_lag", tau=tau) for tau in (0.2, 0.6)]
    noise = Noise(track_std(trial), np.full(3, 0.5))
    problems, errors = [unknowns_of(Model.of(v), 1, settings) for v in vessels], []
    z = np.array([[120.0, 0.6], [70.5, 0.6], [70.5, 0.2]])
    for unknowns in problems:
        (track,) = FitInputs(unknowns, [trial], settings).tracks()
        run_set = build_run_set(track, unknowns, unknowns.start, noise, 3.0, settings)
        errors.append(run_errors(run_set, unknowns, z))
    assert errors[0] == pytest.approx(errors[1], abs=1e-12)
    truth, lag = errors[0][1], errors[0][2]
    assert np.abs(truth[..., 2]).max() < 0.1 * np.abs(lag[..., 2]).max()
    first = np.abs(lag[:, 0, :2] - truth[:, 0, :2]).max()  # of each run
    assert first > 0.01


def test_a_lag_and_a_moment_of_inertia_that_is_off_are_fitted_in_one_go() -> None:
    """A file whose boat is a third too hard to turn: each fit went a fifth of the way to the lag,
    and what came of the last was told as sure.
    """
    dynamics = replace(WAM_V.dynamics, m33=0.75 * WAM_V.dynamics.m33, N_r=1.4 * WAM_V.dynamics.N_r)
    lag = AddedEffect(named("thruster_lag"), {"tau": 0.2})
    trial = sailed_with(
        with_effect(replace(WAM_V, dynamics=dynamics), "thruster_lag", tau=0.6), 200.0, 3
    )
    superset, plain = SupersetModel.of(WAM_V, [lag.effect], [trial]), Model.of(WAM_V)
    base = fit_base(superset, plain, [trial], DiagnoseSettings())
    unknowns = unknowns_for(superset, [lag], 1, base.problem.settings)
    first = fit_effects([lag], unknowns, base.problem, start_values(unknowns, base))
    second = fit_effects([lag], unknowns, base.problem, first.z)
    tau = unknowns.column("thruster_lag.tau")
    assert first.z[tau] == pytest.approx(second.z[tau], abs=0.02)
    assert first.z[tau] == pytest.approx(0.6, abs=0.1)


def test_runs_of_reports_that_are_late_begin_where_the_boat_was() -> None:
    """Half a second late in hard turns: with the exact model no more is left than rounding, where
    starts from one moment alone were off by a tenth of the speed.
    """
    trial = sailed_with(with_effect(WAM_V, "velocity_latency", delay=0.5), 60.0, 3, noise=0.0)
    settings = IdentifySettings(free=("velocity_latency.delay",), offsets=False)
    unknowns = unknowns_of(Model.of(with_effect(WAM_V, "velocity_latency", delay=0.2)), 1, settings)
    (track,) = FitInputs(unknowns, [trial], settings).tracks()
    noise = Noise(np.full(3, 0.01), np.full(3, 0.5))
    run_set = build_run_set(track, unknowns, unknowns.start, noise, 3.0, settings)
    z = np.array([[0.5], [0.2]])
    late, early = np.abs(run_errors(run_set, unknowns, z))
    assert late[..., :2].max() < 0.02
    assert early[..., :2].max() > 10.0 * late[..., :2].max()
    assert late[..., 2].max() < 1e-3


def test_a_law_of_lateness_that_cannot_be_switched_off_is_left_to_the_effect_itself() -> None:
    """Starts that were shifted as well would count it twice."""
    plain = named("velocity_latency")
    own = replace(
        plain, name="own_latency", parameters=(replace(plain.parameters[0], neutral=None),)
    )
    with_own, with_it = (
        Model.of(WAM_V.with_effects(AddedEffect(e, {"delay": 0.4}))) for e in (own, plain)
    )
    assert with_own.ages(with_own.theta[None]).tolist() == [0.0]
    assert with_it.ages(with_it.theta[None]).tolist() == [0.4]
    assert with_it.ages(with_it.in_time(with_it.theta[None])).tolist() == [0.0]
