"""Validation of a vessel on a recording whose telemetry tells commands late."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification.identify import ModelErrors, Validation, identify, unseen_losses
from sim.model import Model
from sim.prediction.free_runs import Ruler, Scores, free_run, nrmse, predict
from sim.trial import Trial
from tests.sim.voyages import WAM_V, simulated

DT = 0.05


def told_late(trial: Trial) -> Trial:
    """Every command is told one row after it acted."""
    return replace(trial, pwm=np.concatenate([trial.pwm[:1], trial.pwm[:-1]]))


@pytest.fixture(scope="module")
def late():
    return told_late(simulated(WAM_V, 150.0, DT, seed=1))


def test_the_model_that_made_the_data_has_no_error_once_it_is_told_the_time(late):
    model = Model.of(WAM_V)
    ruler = Ruler.of(late, model)
    errors = [
        np.abs(predict(late, model, ruler, t).predicted_rows()[2][:, 3:]).max() for t in (0.0, -DT)
    ]
    assert errors[1] < 1e-6 < 1e-3 < errors[0]
    runs = [free_run(late, model, ruler.scales, t).scores.rmse["u"] for t in (0.0, -DT)]
    assert runs[1] < 1e-6 < 1e-3 < runs[0]


@pytest.mark.parametrize("held_out", [True, False])
def test_the_offset_found_holds_for_what_a_vessel_is_judged_by(late, held_out):
    others = () if held_out else (told_late(simulated(WAM_V, 60.0, DT, seed=2)),)
    found = identify([late], WAM_V, others=others)
    assert found.command_offset == pytest.approx(-DT, abs=0.02)
    model = Model.of(WAM_V)
    _, _, error = predict(late, model, (ruler := Ruler.of(late, model))).predicted_rows()
    (judged,) = found.validation
    for told in (judged.before, judged.after):
        assert told.nrmse < 0.3 * nrmse(error, ruler.scales)


def judged(before: dict[str, float], after: dict[str, float], nrmse: tuple[float, float]):
    """A validation with these errors of u, v, r [m/s, m/s, rad/s]."""
    errors = [
        ModelErrors(Scores(rmse, rmse, {}, {}), whole, None)
        for rmse, whole in zip((before, after), nrmse, strict=True)
    ]
    return Validation("lake", 60.0, 0.2, *errors)


def test_what_a_fit_loses_on_unseen_time_is_said_and_what_it_gains_is_not():
    old, better = {"u": 0.4, "v": 0.1, "r": 0.10}, {"u": 0.2, "v": 0.1, "r": 0.11}
    assert unseen_losses([judged(old, better, (1.0, 0.6))]) == ()
    (line,) = unseen_losses([judged(old, old, (1.0, 1.0))])
    assert line.startswith("on time that the fit did not see (lake) the vessel is no better")
    (line,) = unseen_losses([judged(old, better, (1.0, float("nan")))])
    assert "nrmse nan, before 1.000" in line
    (line,) = unseen_losses([judged(old, better | {"r": 0.15}, (1.0, 0.7))])
    assert line == (
        "yaw rate is predicted worse on time that the fit did not see (lake): "
        "off by 0.150 rad/s, before 0.100"
    )
    near = {"u": 0.4, "v": 0.001, "r": 0.1}  # both predict sway as well as it can be measured
    assert unseen_losses([judged(near, near | {"v": 0.004}, (1.0, 0.9))]) == ()
