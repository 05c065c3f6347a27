"""A light hull that leaves its course, under a file by which it would hold it."""

from pathlib import Path

import pytest

from benchmarks.hidden.cases import LOG, VESSEL, cases, materialise
from gateway.offline.diagnose import DIAGNOSIS_TRIALS
from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel
from sim.comparison.compare import compare
from sim.diagnosis.answer import Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.effects.catalogue import named
from sim.model import Model

FEW = tuple(named(name) for name in ("steady_current", "hull_lift", "compass_deviation"))


@pytest.mark.slow
def test_a_cause_that_is_found_is_not_unknown_for_the_file_that_is_off(tmp_path: Path) -> None:
    """By the ruler of the file the true model errs by seven floors; `compare` says it does not."""
    case = next(c for c in cases("tuning") if c.name == "tuning-291")
    materialise(case, tmp_path)
    (trial,), boat = (
        load_trials(tmp_path / LOG, None, DIAGNOSIS_TRIALS),
        load_vessel(tmp_path / VESSEL),
    )
    found = diagnose([trial], boat, DiagnoseSettings(effects=FEW))
    assert (found.verdict, found.effects) == (Verdict.EXPLAINED, ("steady_current",))
    left = found.ladder[-1].heldout.nrmse
    # no more than the recording states as noise, and so the most that noise can show
    assert left == found.noise_floor < 0.25 * found.ladder[0].heldout.nrmse
    alone, fitted = compare(trial, [Model.of(boat), Model.of(found.vessel)])
    assert fitted.nrmse == pytest.approx(left, rel=0.1)
    assert alone.nrmse == pytest.approx(found.ladder[0].heldout.nrmse, rel=0.1)
    assert fitted.noise_floor_nrmse == pytest.approx(found.noise_floor, rel=0.1)
