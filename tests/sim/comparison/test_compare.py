"""The comparison as a whole: what is said, in strict JSON, under one ruler."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sim.comparison.compare import compare
from sim.model import Model
from sim.prediction.segments import CompareSettings
from tests.sim.voyages import WAM_V, simulated

KEYS = {"log", "seconds", "vessel", "horizon_s", "cut_short", "rmse", "mae", "r2", "fit_percent",
        "nrmse", "noise_floor_nrmse", "free_run", "where"}  # fmt: skip
CHANNELS = {"u", "v", "r", "x", "y", "psi"}
SLUGGISH = replace(WAM_V, name="sluggish", dynamics=replace(WAM_V.dynamics, X_u=-60.0))
AWAY = replace(WAM_V, name="away", dynamics=replace(WAM_V.dynamics, X_u=200.0, X_uu=400.0))


@pytest.fixture(scope="module")
def found():
    models = [Model.of(v) for v in (WAM_V, SLUGGISH, AWAY)]
    return compare(simulated(WAM_V), models)


def test_json_is_strict_and_has_the_keys(found):
    for one in found:
        said = json.loads(json.dumps(one.to_dict(), allow_nan=False))
        assert set(said) - {"place"} == KEYS | {"independence"}
        assert set(said["rmse"]) == set(said["mae"]) == CHANNELS
        assert set(said["free_run"]) - {"diverged"} == {"rmse", "mae", "r2"}
        assert {"by", "from", "to", "unit", "share", "says"} == set(said["where"][0])
        headings = [b for b in said["where"] if b["by"] == "heading"]
        assert all(0.0 <= b["from"] < b["to"] <= 2.0 * np.pi for b in headings)


def test_the_better_model_has_the_smaller_error_and_the_ruler_is_one(found):
    right, wrong, away = found
    assert right.nrmse < 1e-3 < 0.05 < wrong.nrmse < away.nrmse
    assert right.ruler is wrong.ruler
    assert right.scores.fit_percent["u"] > 99.9 > wrong.scores.fit_percent["u"]
    low, high = wrong.nrmse_ci95
    assert low < wrong.nrmse < high


def test_the_floor_and_horizons_are_those_of_the_best_vessel_in_whatever_order(found):
    alone = compare(simulated(WAM_V), [Model.of(SLUGGISH)])[0]
    right, beside, _ = found
    assert beside.noise_floor_nrmse == right.noise_floor_nrmse
    assert alone.noise_floor_nrmse != beside.noise_floor_nrmse
    turned = compare(simulated(WAM_V), [Model.of(v) for v in (AWAY, SLUGGISH, WAM_V)])
    assert [one.nrmse for one in turned] == [one.nrmse for one in reversed(found)]
    assert [one.noise_floor_nrmse for one in turned] == [right.noise_floor_nrmse] * 3


@pytest.mark.parametrize(("seconds", "asked", "reached"), [(8.0, 10.0, "7.8 s"), (60.0, 5.0, "5 s"),
                                                           (60.0, 3000.0, "59.8 s")])  # fmt: skip
def test_the_horizon_that_is_told_is_the_longest_run(seconds, asked, reached):
    trial, settings = simulated(WAM_V, seconds), CompareSettings(horizon=asked)
    (one,) = compare(trial, [Model.of(WAM_V)], settings)
    assert one.horizon == reached
    assert one.to_dict()["horizon_s"] == pytest.approx(min(asked, seconds), abs=0.3)
    assert one.ruler.longest_run(trial.dt) == one.horizon_s
    assert one.cut_text == ""  # a short recording cuts no run short


def test_a_horizon_that_is_no_whole_number_of_nodes_is_told_as_it_was_asked_for():
    trial = simulated(WAM_V, 60.0, 0.1 / 1.2)  # nodes of 0.25 s
    (one,) = compare(trial, [Model.of(WAM_V)], CompareSettings(horizon=9.9))
    assert one.ruler.segments.steps.max() * trial.dt != pytest.approx(9.9)
    assert (one.horizon, one.horizon_s) == ("9.9 s", 9.9)


def test_runs_that_end_early_are_told_from_a_tenth_of_them_on(found):
    one = found[0]
    few, many = (replace(one, ruler=replace(one.ruler, cut_short=share)) for share in (0.099, 0.66))
    assert one.cut_text == few.cut_text == ""
    assert many.cut_text.startswith("on voyage 66 % of the free runs end early: ")


def test_a_free_run_that_diverges_says_so(found):
    right, _, away = found
    assert right.free_run.to_dict()["r2"]["u"] > 0.999
    assert "diverged" not in right.free_run.to_dict()
    assert away.free_run.to_dict()["diverged"] is True
    assert len(away.free_run.model) < len(right.free_run.model)


def test_a_battery_that_sags_under_throttle_is_not_told_beside_it(found):
    wrong, one = found[1], found[1].where[0]

    def told(*bins: tuple[str, float]) -> list[str]:
        where = tuple(replace(one, by=by, share=0.1 + e, time_share=0.1) for by, e in bins)
        return [b.by for b in replace(wrong, where=where).worst()]

    assert told(("voltage", 0.1), ("throttle", 0.09), ("time", 0.05)) == ["throttle", "time"]
    assert told(("voltage", 0.2), ("throttle", 0.09)) == ["voltage", "throttle"]
    assert told(("voltage", 0.1), ("heading", 0.09)) == ["voltage", "heading"]
    assert told(("voltage", 0.1), ("throttle", 0.01)) == ["voltage"]  # too little to be told


def test_nothing_is_called_worst_where_all_is_noise(found):
    right, wrong, _ = found
    loud = replace(right, noise_floor_nrmse=right.nrmse)
    assert loud.worst() == ()
    assert wrong.worst()
    assert all(b.share > b.time_share for b in wrong.worst())
