"""Free runs of the model that made the data, and of others."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.model import Model
from sim.prediction import delayed_commands, measured_motion
from sim.prediction.free_runs import (
    DivergedError,
    Ruler,
    memory_at,
    memory_of_each,
    nrmse,
    predict,
)
from sim.prediction.segments import CompareSettings
from sim.vessel import BASE, AddedEffect, Sensors
from tests.sim.voyages import UNSTABLE, WAM_V, legs, simulated, trial_of

EFFECTS = {
    "plain": (),
    "thruster_lag": (AddedEffect(named("thruster_lag"), {"tau": 0.5}),),
    "heading_offset": (AddedEffect(named("heading_offset"), {"angle": 0.2}),),
    "steady_current": (AddedEffect(named("steady_current"), {"speed": 0.4, "direction": 2.0}),),
}


@pytest.mark.parametrize(
    "effect",
    [pytest.param(e, marks=pytest.mark.slow if e == "thruster_lag" else ()) for e in EFFECTS],
)
def test_the_model_that_made_the_data_shows_no_error(effect):
    """Sensors away from the origin, sensor effects and memory included."""
    vessel = replace(WAM_V, sensors=Sensors(antenna=(0.8, 0.3)), effects=EFFECTS[effect])
    trial, model = simulated(vessel), Model.of(vessel)
    ruler = Ruler.of(trial, model)
    _, _, error = predict(trial, model, ruler).predicted_rows()
    assert len(ruler.segments.rows) > 40
    assert nrmse(error, ruler.scales) < 1e-3


def test_memory_is_run_once_for_all_numbers_that_actuators_do_not_feel(monkeypatch):
    """Drag and mass leave a lag as it is; the lag itself, a water and a weaker motor do not."""
    names = ("thruster_lag", "cubic_drag", "payload_change", "steady_current", "reverse_loss")
    model = Model.of(
        WAM_V.with_effects(
            *(AddedEffect(named(n), {p.name: p.start for p in named(n).parameters}) for n in names)
        )
    )
    trial, rows = simulated(WAM_V, 30.0), np.array([5, 300, 100])
    passive = {model.names[i].partition(".")[0] for i in model.passive_columns}
    assert passive == {*BASE, "cubic_drag", "payload_change"}
    theta = np.tile(model.theta, (len(model.theta) + 1, 1))
    theta[1:] += np.diag(1e-3 * np.maximum(np.abs(model.theta), 1.0))
    each = np.stack([memory_at(replace(model, theta=t), trial, rows) for t in theta], axis=1)
    calls = []
    monkeypatch.setattr(
        "sim.prediction.free_runs.memory_at", lambda *a: calls.append(a) or memory_at(*a)
    )
    found = memory_of_each(model, trial, rows, theta)
    np.testing.assert_allclose(found, each, rtol=1e-5, atol=1e-5)
    assert len(calls) == len(theta) - len(model.passive_columns)


@pytest.mark.parametrize("effect", EFFECTS)
def test_some_of_the_segments_are_predicted_as_among_all(effect):
    """Memory too, whichever segments come before."""
    trial, model = simulated(WAM_V), Model.of(replace(WAM_V, effects=EFFECTS[effect]))
    ruler = Ruler.of(trial, Model.of(WAM_V))
    which = np.arange(len(ruler.segments.rows)) % 3 == 1
    part, whole = predict(trial, model, ruler.subset(which)), predict(trial, model, ruler)
    np.testing.assert_array_equal(part.rows, whole.rows[which])
    np.testing.assert_array_equal(part.error, whole.error[which][:, : part.error.shape[1]])
    np.testing.assert_array_equal(ruler.subset(which).blocks, ruler.blocks[which])


def test_error_is_measured_minus_model_with_yaw_wrapped():
    trial, model = simulated(WAM_V, 60.0), Model.of(WAM_V)
    ruler = Ruler.of(trial, model)
    turned = replace(trial, eta=trial.eta.copy())
    turned.eta[trial.time > 21.0, 2] += 2.0 * np.pi
    moved = replace(turned, nu=trial.nu.copy())
    moved.nu[:, 0] += 0.1 * (trial.time > 30.0)
    _, rows, error = predict(moved, model, ruler).predicted_rows()
    assert np.abs(error[:, 2]).max() < 0.5
    crossing = (rows * trial.dt > 30.05) & (rows * trial.dt < 31.0)
    assert error[crossing, 3].max() == pytest.approx(0.1, abs=0.01)


def test_no_pulse_is_no_command():
    trial, model = simulated(WAM_V, 60.0), Model.of(WAM_V)
    silent = replace(trial, pwm=np.where(trial.time[:, None] > 20.0, np.nan, trial.pwm))
    neutral = replace(trial, pwm=np.where(trial.time[:, None] > 20.0, 1500.0, trial.pwm))
    ruler = Ruler.of(trial, model)
    one, other = (
        predict(silent, model, ruler).predicted_rows()[2],
        predict(neutral, model, ruler).predicted_rows()[2],
    )
    np.testing.assert_array_equal(one, other)
    assert np.abs(one).max() > 0.1


def test_segments_stay_within_usable_stretches():
    trial, model = simulated(WAM_V, 120.0), Model.of(WAM_V)
    usable = (trial.time % 37.0 > 3.0) & ~((trial.time > 80.0) & (trial.time < 104.0))
    ruler = Ruler.of(replace(trial, usable=usable), model)
    for row, steps in zip(ruler.segments.rows, ruler.segments.steps, strict=True):
        assert usable[row : row + steps + 1].all()
    assert ruler.segments.steps.min() < ruler.segments.steps.max()  # the short stretch is used


def test_a_trial_without_usable_time_is_refused():
    trial = simulated(WAM_V, 30.0)
    with pytest.raises(ValueError, match="no usable stretch"):
        Ruler.of(replace(trial, usable=np.zeros(len(trial), bool)), Model.of(WAM_V))


def test_a_model_that_diverges_gives_finite_errors_and_says_so():
    away = replace(WAM_V, dynamics=replace(WAM_V.dynamics, X_u=200.0, X_uu=400.0))
    trial = simulated(WAM_V, 60.0)
    ruler = Ruler.of(trial, Model.of(WAM_V))
    prediction = predict(trial, Model.of(away), ruler)
    assert prediction.diverged.any()
    assert np.isfinite(prediction.predicted_rows()[2]).all()
    assert nrmse(prediction.predicted_rows()[2], ruler.scales) > 10.0


def test_an_unstable_hull_is_cut_short_and_a_stable_one_is_not():
    spread = np.diag(np.square([0.1, 0.1, 0.01, 0.02, 0.02, 0.01, 0.05, 0.05, 0.02]))

    def cut(vessel):
        return Ruler.of(trial_of(*legs(vessel, 120.0), 0.05, spread), Model.of(vessel))

    unstable = cut(UNSTABLE)
    assert cut(WAM_V).cut_short == 0.0
    assert unstable.cut_short > 0.5
    assert (unstable.segments.steps * 0.05).min() >= CompareSettings().shortest


def test_commands_are_delayed_by_parts_of_a_step():
    ramp = np.arange(20.0)[:, None]
    late = delayed_commands(ramp, 0.1, 0.25)
    np.testing.assert_allclose(late[5:, 0], ramp[5:, 0] - 2.5)
    np.testing.assert_allclose(late[:2, 0], 0.0)


def test_the_ruler_does_not_depend_on_the_other_vessels():
    trial = simulated(WAM_V, 60.0)
    assert measured_motion(trial).shape == (len(trial), 9)
    one, two = (Ruler.of(trial, Model.of(WAM_V)) for _ in range(2))
    np.testing.assert_array_equal(one.segments.steps, two.segments.steps)
    assert one.noise_floor == two.noise_floor


def test_a_model_that_is_no_number_at_once_is_refused_not_called_perfect():
    trial, vessel = simulated(WAM_V, 60.0), WAM_V
    broken = replace(vessel, dynamics=replace(vessel.dynamics, X_uu=-1e200))
    ruler = Ruler.of(trial, Model.of(vessel))
    with pytest.raises(DivergedError, match="diverges at once"):
        predict(trial, Model.of(broken), ruler)
