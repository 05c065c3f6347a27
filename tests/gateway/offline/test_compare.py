"""Logs and vessel files -> comparisons: what is read, what is left out, what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.offline.compare import TrialComparison, as_json, compare_logs, distinct_vessels
from gateway.terminal.comparison import show_comparisons
from gateway.vessel_file import load_vessel
from sim.identification import updated_vessel
from sim.trial import Stretch
from tests.conftest import ROOT
from tests.sim.voyages import WAM_V, simulated

VESSELS = ROOT / "configs" / "vessels"


@pytest.fixture
def logs(monkeypatch):
    """A log of two trials, of which one was never armed; and a log of only that."""
    good = simulated(WAM_V, 60.0)
    idle = replace(
        good, name="idle", usable=np.zeros(len(good), bool),
        excluded=(Stretch(0.0, 60.0, "disarmed"),),
    )  # fmt: skip
    trials = {"both.tlog": [good, idle], "idle.tlog": [idle]}
    monkeypatch.setattr("gateway.offline.compare.load_trials", lambda log, *_: trials[log])


def test_one_entry_per_trial_and_vessel(logs):
    said = []
    found = compare_logs(["both.tlog"], [WAM_V, replace(WAM_V, name="other")], progress=said.append)
    assert [(c.log, c.vessel) for c in found] == [("voyage", "plain"), ("voyage", "other")]
    assert any("left out, idle: no usable stretch" in line for line in said)
    assert len(json.loads(json.dumps(as_json(found), allow_nan=False))["trials"]) == 2


def test_a_log_without_usable_time_is_bad_input_with_the_reason(logs):
    with pytest.raises(BadInput, match=r"idle\.tlog: no stretch .*disarmed 60 s"):
        compare_logs(["idle.tlog"], [WAM_V])


def test_nothing_given_is_bad_input():
    with pytest.raises(BadInput, match="at least one recording"):
        compare_logs([], [WAM_V])


def test_vessels_of_one_name_are_told_apart():
    names = [v.name for v in distinct_vessels([WAM_V, replace(WAM_V, name="b"), WAM_V])]
    assert names == ["plain (#1)", "b", "plain (#3)"]


@pytest.mark.slow
def test_pictures_go_into_the_folder(logs, tmp_path):
    compare_logs(["both.tlog"], [WAM_V], pictures=tmp_path / "pictures")
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {
        f"voyage-plain-{name}.png"
        for name in (
            "velocities", "free-run", "track", "shares", "strips", "missing-force", "independence",
        )
    }  # fmt: skip


@pytest.mark.slow
def test_a_log_of_an_autopilot(shared_data):
    """The same voyage as telemetry and as flash log: the same error, near the noise."""
    vessel = VESSELS / "otter.toml"
    files = [shared_data / "sitl" / f"otter_calm.{kind}" for kind in ("tlog", "BIN")]
    tlog, flash = compare_logs(files, [vessel])
    assert tlog.nrmse == pytest.approx(flash.nrmse, rel=0.25)
    assert tlog.nrmse < 2.0 * tlog.noise_floor_nrmse
    assert tlog.scores.r2["u"] > 0.9


UNSEEN = {
    "otter": "otter_piece",
    "demo_boat": "voyage_3",
}  # not fitted to these recordings
PUBLISHED = {"iacquabot", "wam-v"}  # identified by others, on data that are not here


@pytest.mark.parametrize("name", [path.stem for path in sorted(VESSELS.glob("*.toml"))])
def test_each_vessel_that_ships_is_what_it_says(name):
    vessel = load_vessel(name)
    assert vessel.sketch == (name not in UNSEEN.keys() | PUBLISHED)
    if name in UNSEEN:
        log = ROOT / "recordings" / f"{UNSEEN[name]}.tlog"
        (found,) = compare_logs([log], [vessel])
        assert found.nrmse < 1.2 * found.noise_floor_nrmse
        assert not any("sketch" in notice for notice in found.notices)
    elif vessel.sketch:
        assert f"{vessel.source}): identify it first" in " ".join(vessel.assumptions)
    else:
        assert "Robotics 2025" in vessel.source


def test_a_sketch_is_one_until_its_numbers_are_fitted():
    sketch = load_vessel("blueboat")
    assert updated_vessel(sketch, {"left.ahead": 60.0}).sketch
    assert not updated_vessel(sketch, {"m11": 17.0}).sketch
    (found,) = compare_logs([ROOT / "recordings" / "otter_piece.tlog"], [sketch])
    assert any(n.startswith("BlueBoat: a sketch, not fitted") for n in found.notices)


def test_names_are_shown_as_they_are_whatever_brackets_they_hold(logs, capsys):
    show_comparisons(compare_logs(["both.tlog"], [replace(WAM_V, name="[b]x")]), None)
    table, _, words = capsys.readouterr().out.partition("nrmse: ")
    assert "[b]x" in table
    assert "[b]x on voyage" in words


def test_runs_that_end_early_are_told_once_where_numbers_are_read(logs, capsys):
    found = compare_logs(["both.tlog"], [WAM_V, replace(WAM_V, name="other")])
    show_comparisons(found, None)
    assert "end early" not in capsys.readouterr().out
    cut = tuple(replace(one, ruler=replace(one.ruler, cut_short=0.66)) for one in found)
    show_comparisons(cut, None)
    assert capsys.readouterr().out.count("66 % of the free runs end early") == 1
    assert TrialComparison(simulated(WAM_V, 8.0), cut).notices == (cut[0].cut_text,)
