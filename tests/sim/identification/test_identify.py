"""Identification on motion whose parameters are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.effects.steady_current import EFFECT as CURRENT
from sim.effects.thruster_lag import EFFECT as LAG
from sim.identification import BASE, IdentifySettings
from sim.identification.fast_damping import MAX_DAMPING_RATE
from sim.identification.identify import identify
from sim.identification.parameters import UnknownNameError, unknowns_of
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel
from tests.sim.identification.noisy_trials import noisy, off, wander
from tests.sim.vessels import WAMV
from tests.sim.voyages import WAM_V, legs, trial_of


def value(found, name, trial=None):
    return next(e for e in found.estimates if e.name == name and e.trial in (None, trial))


@pytest.fixture(scope="module")
def plain():
    return identify([noisy(WAMV, 400.0, seed=1)], off(WAMV))


def test_intervals_hold_the_truth(plain):
    held = [e.ci95[0] <= getattr(WAMV.dynamics, e.name) <= e.ci95[1] for e in plain.estimates]
    assert sum(held) >= 8
    assert all(e.identifiable for e in plain.estimates if e.name in ("m11", "m33", "N_r", "X_uu"))


def test_masses_are_found_far_better_than_they_were(plain):
    for name in ("m11", "m22", "m33"):
        assert value(plain, name).value == pytest.approx(getattr(WAMV.dynamics, name), rel=0.03)


def test_error_falls_on_blocks_that_the_fit_did_not_see(plain):
    (judged,) = plain.validation
    assert judged.after.nrmse < 0.6 * judged.before.nrmse


def test_thrust_and_mass_freed_together_are_named_as_inseparable():
    names = (*BASE, "left.ahead", "left.astern", "right.ahead", "right.astern")
    found = identify([noisy(WAMV, 200.0, seed=2)], off(WAMV), IdentifySettings(free=names))
    assert any("thrust and mass cannot be told apart" in says for says in found.trade)
    assert not value(found, "m11").identifiable
    assert "share of thrust" in value(found, "m11").doubt


def test_a_fixed_mass_tells_thrust():
    names = (*BASE, "left.ahead", "left.astern", "right.ahead", "right.astern")
    settings = IdentifySettings(free=names, fix=("m11",))
    found = identify([noisy(WAMV, 200.0, seed=2)], WAMV, settings)
    assert not any("thrust and mass" in says for says in found.trade)
    for name, truth in (("left.ahead", 90.0), ("right.astern", -85.0)):
        assert value(found, name).identifiable
        assert value(found, name).value == pytest.approx(truth, rel=0.03)


@pytest.mark.slow
def test_a_survey_alone_leaves_hard_turns_and_full_throttle_untold():
    eta, nu, nu_dot, drive = legs(WAM_V, 300.0, 0.1)
    rng = np.random.default_rng(1)
    sizes = ((0.025, 2.0), (0.025, 2.0), (0.002, 0.4))
    nu = nu + np.stack([wander(*size, len(nu), rng) for size in sizes], axis=1)
    found = identify([trial_of(eta, nu, nu_dot, drive, 0.1, np.eye(9))], off(WAM_V))
    for name, manoeuvre in (
        ("X_uu", "up to full throttle"),
        ("Y_vv", "hard turns at full speed"),
        ("N_rr", "spinning on the spot"),
    ):
        assert not value(found, name).identifiable
        assert manoeuvre in value(found, name).doubt
    for name in ("m33", "N_r"):
        assert value(found, name).identifiable
    held = [e.ci95[0] <= getattr(WAM_V.dynamics, e.name) <= e.ci95[1] for e in found.estimates]
    assert sum(held) >= 8


def test_a_limit_that_was_hit_is_named():
    straight = replace(WAMV, dynamics=replace(WAMV.dynamics, X_u=-60.0, X_uu=0.0))
    found = identify([noisy(straight, 200.0, seed=9)], off(WAMV))
    assert "stands at its upper limit, 0 N s²/m²" in value(found, "X_uu").doubt
    assert value(found, "X_u").value == pytest.approx(-60.0, rel=0.03)


def test_a_boat_that_only_goes_straight_does_not_tell_its_sway():
    trial = noisy(WAMV, 150.0, seed=3, steering=0.0)
    found = identify([trial], off(WAMV))
    for name in ("m22", "Y_v", "Y_vv"):
        assert not value(found, name).identifiable
        assert "turns" in value(found, name).doubt
    assert value(found, "m11").identifiable


def test_each_recording_has_a_current_of_its_own():
    flows = (0.3, 1.0), (0.2, -2.0)
    trials = [
        replace(noisy(WAMV.with_effects(_current(*flow)), 150.0, seed=4 + i), name=f"day {i}")
        for i, flow in enumerate(flows)
    ]
    settings = IdentifySettings(free=("m11", "steady_current.*"))
    found = identify(trials, off(WAMV, "m11").with_effects(_current(0.1, 0.0)), settings)
    for i, (speed, direction) in enumerate(flows):
        assert value(found, "steady_current.speed", f"day {i}").value == pytest.approx(
            speed, abs=0.03
        )
        angle = value(found, "steady_current.direction", f"day {i}")
        assert angle.value == pytest.approx(direction, abs=0.15)
        assert angle.ci95[0] < angle.value < angle.ci95[1]


@pytest.mark.slow
def test_the_lag_of_an_effect_is_fitted_along():
    lagging = WAMV.with_effects(AddedEffect(LAG, {"tau": 0.5}))
    start = off(WAMV).with_effects(AddedEffect(LAG, {"tau": 0.2}))
    settings = IdentifySettings(free=(*BASE, "thruster_lag.tau"))
    found = identify([noisy(lagging, 300.0, seed=6)], start, settings)
    assert value(found, "thruster_lag.tau").value == pytest.approx(0.5, abs=0.06)


def test_what_is_fixed_stays():
    found = identify([noisy(WAMV, 100.0, seed=7)], off(WAMV), IdentifySettings(fix=("Y_vv",)))
    assert found.vessel.dynamics.Y_vv == off(WAMV).dynamics.Y_vv
    assert found.vessel.dynamics.m11 != off(WAMV).dynamics.m11


def test_a_prior_holds_what_the_data_do_not_tell():
    trial = noisy(WAMV, 100.0, seed=3, steering=0.0)
    found = identify([trial], off(WAMV), IdentifySettings(priors={"m22": 0.05}))
    assert value(found, "m22").value == pytest.approx(off(WAMV).dynamics.m22, rel=0.05)


def test_a_name_that_is_not_there_is_refused():
    with pytest.raises(UnknownNameError, match="no parameter 'm44'"):
        identify([noisy(WAMV, 60.0)], WAMV, IdentifySettings(free=("m44",)))


def test_bad_rows_that_are_not_usable_change_nothing():
    trial = noisy(WAMV, 120.0, seed=8)
    usable = trial.usable.copy()
    usable[400:600] = False
    cut = replace(trial, usable=usable)
    torn = replace(cut, nu=np.where(usable[:, None], cut.nu, 50.0))
    a, b = (identify([t], off(WAMV)) for t in (cut, torn))
    assert value(a, "m11").value == pytest.approx(value(b, "m11").value, rel=1e-6)


def _current(speed, direction):
    return AddedEffect(CURRENT, {"speed": speed, "direction": direction})


MOST_STEPS = 2e7  # of the model in one fit, some five seconds; a fit from a right file takes 0.2e6
FACTORS = st.lists(st.sampled_from([0.2, 0.33, 0.7, 1.0, 1.5, 3.0, 5.0]), min_size=9, max_size=9)


def scaled(factors: list[float]) -> Vessel:
    numbers = zip(BASE, factors, strict=True)
    changed = {name: f * getattr(WAMV.dynamics, name) for name, f in numbers}
    return replace(WAMV, dynamics=replace(WAMV.dynamics, **changed))


def ends(boat: Vessel, file: Vessel, seed: int) -> None:
    """A fit of the boat's trial from the file gives finite numbers, in bounded work."""
    made, whole = [], Model._rolled

    def counted(self, start, runs, inputs, thetas, substeps, horizon):
        made.append(float(runs.steps.sum() * substeps))
        return whole(self, start, runs, inputs, thetas, substeps, horizon)

    trial = noisy(boat, 40.0, seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Model, "_rolled", counted)
        found = identify([trial], file, IdentifySettings())
    assert all(np.isfinite(e.value) for e in found.estimates)
    assert sum(made) < MOST_STEPS


@pytest.mark.slow
@settings(max_examples=6, deadline=None, derandomize=True)
@given(FACTORS, FACTORS, st.integers(1, 100))
def test_a_fit_of_any_hull_from_any_file_ends(boat, file, seed):
    ends(scaled(boat), scaled(file), seed)


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(FACTORS, FACTORS, st.integers(1, 100))
def test_fits_of_many_hulls_from_many_files_end(boat, file, seed):
    ends(scaled(boat), scaled(file), seed)


AT_ONCE = replace(WAMV, dynamics=replace(WAMV.dynamics, m33=0.02 * WAMV.dynamics.m33))


def yaw_damping_rate(vessel: Vessel, trial: Trial) -> float:
    """[1/s] at the yaw rate that all but a hundredth of the rows stay below."""
    d, r = vessel.dynamics, float(np.quantile(np.abs(trial.nu[:, 2]), 0.99))
    return -(d.N_r + 2.0 * d.N_rr * r) / d.m33


def test_a_boat_that_follows_its_helm_at_once_is_no_hull_without_inertia():
    """Its damping is over within a row: what lies below that is held, said, and not simulated."""
    trial = noisy(AT_ONCE, 200.0, seed=5)
    assert yaw_damping_rate(AT_ONCE, trial) > 2.5 * MAX_DAMPING_RATE
    found = identify([trial], off(WAMV))
    assert yaw_damping_rate(found.vessel, trial) == pytest.approx(MAX_DAMPING_RATE, rel=1e-3)
    assert "any stronger would look the same" in value(found, "N_r").doubt
    assert not value(found, "X_u").doubt
    fastest = np.abs(trial.nu).max(axis=0)
    steps = [Model.of(v).steps_in(trial.dt, None, fastest) for v in (found.vessel, AT_ONCE)]
    assert steps[0] <= 3 < steps[1]
    (unseen,) = found.validation
    assert unseen.after.scores.r2["r"] > 0.9  # it turns as the boat does


def test_of_an_axis_that_is_held_only_the_damping_that_makes_it_fast_is_called_strong():
    """One at its weakest, beside another that has all of it, is not "held at the strongest"."""
    weak = {"X_u": -1e-4, "X_uu": -40.0, "N_r": -60.0, "N_rr": -0.5}
    model = Model.of(replace(WAMV, dynamics=replace(WAMV.dynamics, m11=3.0, m33=3.0, **weak)))
    known = unknowns_of(model, 1, IdentifySettings(fastest=(2.0, 0.5, 0.5)))
    quick = replace(known, each=tuple(replace(u, start=1.0) for u in known.each))  # of a slow hull
    z = quick.from_named(np.array([u.start for u in known.each]))
    assert quick.faster_than_rows(z) == {"X_uu", "N_r"}


@pytest.mark.slow
def test_a_vessel_that_is_given_as_quick_as_that_stays_so():
    trial = noisy(AT_ONCE, 200.0, seed=5)
    found = identify([trial], AT_ONCE)
    assert yaw_damping_rate(found.vessel, trial) > 2.0 * MAX_DAMPING_RATE


def test_damping_that_is_fast_only_at_speeds_that_are_never_reached_is_not_held():
    """A hull as an Otter's: with the square of the turn rate, which stays small."""
    slow = replace(WAMV, dynamics=replace(WAMV.dynamics, N_rr=-8.0 * WAMV.dynamics.m33))
    trial = noisy(slow, 200.0, seed=5)
    assert -2.0 * slow.dynamics.N_rr / slow.dynamics.m33 > 1.5 * MAX_DAMPING_RATE  # at 1 rad/s
    assert yaw_damping_rate(slow, trial) < 0.8 * MAX_DAMPING_RATE
    found = identify([trial], off(slow))
    assert not value(found, "N_rr").doubt
    assert value(found, "N_rr").value == pytest.approx(slow.dynamics.N_rr, rel=0.1)
