"""Validation of a vessel on a recording whose telemetry tells commands late."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification.identify import identify
from sim.model import Model
from sim.prediction.free_runs import Ruler, free_run, nrmse, predict
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
