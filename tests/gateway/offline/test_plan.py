"""`shadow plan`: what is written is what was predicted, and the circle is kept or named."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from gateway.errors import BadInput
from gateway.offline.plan import (
    CLEAR,
    PlanOptions,
    choose_manoeuvre,
    make_plan,
    rank_manoeuvres,
)
from gateway.offline.simulate import simulate
from gateway.terminal.identification import show_plan
from gateway.vessel_file import load_vessel
from sim.excitation import TOLERANCE, StickLimits, corner_rows, manoeuvre_sticks, plan_of, polyline
from sim.excitation.catalogue import Chirp
from sim.model import Model
from sim.prediction.free_runs import DivergedError
from tests.gateway.ingest.ulog_writer import as_ulog
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV
from tests.sim.voyages import WAM_V, simulated

ROOT = Path(__file__).resolve().parents[3]
SHIPPED = sorted((ROOT / "configs/vessels").glob("*.toml"))
VOYAGES = ROOT / "recordings"


def planned(tmp_path, vessel=WAMV, **options):
    return make_plan(vessel, PlanOptions(**options), tmp_path / "out")


def rows_of(file):
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_it_writes_script_tables_and_pictures(tmp_path):
    done = planned(tmp_path, excitation="zigzag")
    assert [file.name for file in done.files] == [
        "zigzag.lua", "zigzag.csv", "zigzag-commands.csv", "zigzag-motion.png", "zigzag-track.png",
    ]  # fmt: skip
    for file in done.files[3:]:
        with Image.open(file) as image:
            assert image.width > 1000


def ulog(folder):
    """A boat that PX4 steers."""
    path = folder / "px4.ulg"
    path.write_bytes(as_ulog(VOYAGES / "otter_piece.tlog").bytes())
    return path


@pytest.mark.parametrize("radius_m", [1e3, 2.0])
def test_a_boat_that_another_autopilot_steers_gets_no_lua_script(tmp_path, capsys, radius_m):
    log, options = ulog(tmp_path), PlanOptions(excitation="zigzag", radius_m=radius_m)
    done = make_plan(WAMV, options, tmp_path / "out", log)
    assert [file.suffix for file in done.files] == [".csv", ".csv", ".png", ".png"]
    assert not (tmp_path / "out" / "zigzag.lua").exists()
    (notice,) = done.to_dict()["notices"]
    assert notice.startswith(f"{log}: PX4 steers her, which runs no Lua script")
    show_plan(done)
    said = " ".join(capsys.readouterr().out.split())
    assert "PX4 steers her" in said
    assert "the script" not in said


def test_a_boat_that_ardupilot_steers_gets_one(tmp_path):
    options = PlanOptions(excitation="zigzag")
    done = make_plan(WAMV, options, tmp_path / "out", VOYAGES / "otter_piece.tlog")
    assert done.files[0].suffix == ".lua"
    assert "notices" not in done.to_dict()


@pytest.mark.parametrize(
    "vessel", [WAMV, pytest.param(RUDDER_BOAT, marks=pytest.mark.slow)], ids=lambda v: v.name
)
def test_pulses_are_those_of_the_sticks_and_end_in_neutral(tmp_path, vessel):
    done = planned(tmp_path, vessel, excitation="steps")
    rows = rows_of(done.files[1])
    assert list(rows[0])[:3] == ["time", "throttle", "steer"]
    pulses = np.array([[float(v) for k, v in row.items() if k.startswith("pwm")] for row in rows])
    channels = [int(k[4:]) for k in rows[0] if k.startswith("pwm")]
    assert vessel.commands(channels, pulses) == pytest.approx(done.plan.commands, abs=2e-3)
    assert (pulses[0] == 1500).all()
    assert (pulses[-1] == 1500).all()


def test_simulating_the_table_gives_the_predicted_motion(tmp_path):
    done = planned(tmp_path, excitation="zigzag")
    again = simulate(done.files[2], WAMV, None, tmp_path / "sim", rate_hz=10.0)
    count = len(again.motion)
    assert count >= len(done.plan.motion) - 1
    predicted = done.plan.motion[:count]
    assert again.motion[: len(predicted), :6] == pytest.approx(predicted[:, :6], abs=0.01)


def test_less_throttle_where_it_would_come_too_far(tmp_path):
    far = make_plan(WAMV, PlanOptions("steps", radius_m=500.0), None)
    assert far.plan.limits.throttle == 0.7
    assert far.files == ()
    radius = far.plan.reach  # it would just stay inside, with no room at all
    near = make_plan(WAMV, PlanOptions("steps", radius_m=radius), None)
    assert near.plan.limits.throttle < 0.7
    assert near.plan.reach <= CLEAR * radius


def test_a_plan_that_leaves_the_circle_says_when_and_how_long_it_may_be(tmp_path, capsys):
    done = planned(tmp_path, IACQUABOT, excitation="square", radius_m=30.0)
    assert not done.within_radius
    assert done.plan.limits.throttle == 0.7  # less would not have helped
    before = done.plan.distance[done.plan.time < done.leaves_at]
    assert before.max() <= 30.0
    show_plan(done)
    says = " ".join(capsys.readouterr().out.split())
    assert "WARNING" in says
    assert f"--seconds {done.clear_until:.0f} " in says
    options = PlanOptions("square", done.clear_until, radius_m=30.0)
    assert make_plan(IACQUABOT, options, None).within_radius


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.slow if p.stem == "steered" else ()) for p in SHIPPED],
    ids=lambda p: p.stem,
)
def test_every_shipped_vessel_has_a_plan_and_answers_to_steps(path):
    done = make_plan(load_vessel(path), PlanOptions(), None)
    assert done.step_responses.surge.settled
    assert done.step_responses.yaw.settled
    assert done.plan.manoeuvre.name == "mixed"
    told = json.loads(json.dumps(done.to_dict()))
    assert told["step_responses"]["surge"]["rise"] == done.step_responses.surge.rise
    assert told["stays"] == done.within_radius


def test_what_is_predicted_is_what_the_script_plays(tmp_path):
    plan = plan_of(Chirp(), Model.of(WAMV), StickLimits())
    assert polyline(plan.time, plan.corner_time, plan.corner_sticks) == pytest.approx(plan.sticks)
    smooth = manoeuvre_sticks(Chirp(), WAMV, 0.1)
    assert np.abs(plan.sticks[:-1] - smooth).max() <= TOLERANCE + 1e-3
    assert len(plan.corner_time) < 0.5 * len(plan.time)


def test_corners_are_few_where_the_line_is_straight_and_none_is_missed():
    time = np.arange(0.0, 10.0, 0.1)
    values = np.stack([np.minimum(time, 5.0), np.zeros_like(time)], axis=-1)
    assert corner_rows(time, values, 1e-6) == [0, 50, 99]
    wavy = np.sin(time)[:, None]
    kept = corner_rows(time, wavy, 0.02)
    assert np.abs(polyline(time, time[kept], wavy[kept]) - wavy).max() <= 0.02
    assert len(kept) < 30


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"excitation": "zigzak"}, "zigzag"),
        ({"throttle_limit": 0.0}, "throttle-limit"),
        ({"seconds": 1.0}, "seconds"),
        ({"radius_m": float("nan")}, "radius"),
        ({"lowest_voltage_v": -1.0}, "lowest-voltage"),
    ],
)
def test_what_cannot_be_is_one_line(wrong, says, tmp_path):
    with pytest.raises(BadInput, match=says):
        planned(tmp_path, **wrong)


def test_a_vessel_that_blows_up_has_no_plan(tmp_path):
    d = replace(WAMV.dynamics, X_u=500.0, X_uu=0.0)
    with pytest.raises(BadInput, match="leaves all bounds"):
        planned(tmp_path, replace(WAMV, dynamics=d), excitation="steps")


def test_a_model_that_no_prediction_can_be_made_with_is_bad_input(monkeypatch):
    def lost(*_):
        raise DivergedError("plain diverges at once from every start")

    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: [simulated(WAM_V)])
    monkeypatch.setattr("gateway.offline.diagnose.diagnose", lost)
    with pytest.raises(BadInput, match=r"a\.tlog: plain diverges"):
        rank_manoeuvres("a.tlog", WAM_V)


def test_a_fit_that_no_manoeuvre_can_be_simulated_with_is_bad_input(monkeypatch):
    answer = [], SimpleNamespace(ranking=(), effects=(), suggested=())
    monkeypatch.setattr("gateway.offline.plan.diagnose_trials", lambda *_, **__: answer)
    with pytest.raises(BadInput, match="leaves all bounds in every manoeuvre"):
        choose_manoeuvre(WAM_V, None, Path("a.tlog"))


def test_a_recording_too_short_to_ask_for_anything_is_bad_input(monkeypatch):
    short = [simulated(WAM_V, 10.0)]
    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: short)
    with pytest.raises(BadInput, match=r"a\.tlog: .* s of usable time"):
        rank_manoeuvres("a.tlog", WAM_V)
