"""`shadow identify` from a recording that ships."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gateway.cli import app
from gateway.errors import BadInput
from gateway.offline.identify import (
    TimeSpan,
    identify_logs,
    identify_settings,
    provenance,
    voyage_notices,
)
from gateway.offline.trials import TrialOptions
from gateway.offline.usable_time import parse_exclusions
from gateway.terminal.identification import show_identification
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file
from sim.effects.catalogue import EFFECTS
from sim.identification import updated_vessel
from sim.identification.identify import Identification
from sim.identification.intervals import Estimate
from sim.prediction.free_runs import DivergedError
from sim.vessel import AddedEffect
from tests.conftest import ROOT
from tests.gateway.ingest.made_table import Traps, boat_toml
from tests.gateway.ingest.made_table import written as written_table
from tests.sim.voyages import WAM_V, simulated

LOG = ROOT / "recordings" / "voyage_1.tlog"
VESSEL = ROOT / "configs" / "vessels" / "demo_boat.toml"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("identified") / "boat.toml"
    return identify_logs([LOG], VESSEL, out, identify_settings([], ["Y_vv"], [], "shooting")), out


def test_the_new_file_holds_what_was_found(written):
    found, out = written
    assert load_vessel(out) == found.vessel
    assert load_vessel(out).dynamics.Y_vv == load_vessel(VESSEL).dynamics.Y_vv
    assert load_vessel(out).dynamics.m11 != load_vessel(VESSEL).dynamics.m11


def test_each_number_keeps_where_it_came_from(written):
    found, out = written
    origin = read_vessel_file(out).provenance["dynamics.m11"]
    m11 = next(e for e in found.estimates if e.name == "m11")
    assert (origin.recording, origin.ci95) == ("voyage_1", m11.ci95)
    assert origin.date
    assert origin.version
    assert "dynamics.Y_vv" not in read_vessel_file(out).provenance


def test_json_is_strict(written):
    told = json.loads(json.dumps(written[0].to_dict(), allow_nan=False))
    assert set(told["parameters"]["m11"]) >= {"value", "ci95", "unit", "before"}
    surge = told["step_responses"]["surge"]
    assert 0.0 < surge["rise"] < surge["settling_2"]


def test_a_fit_that_is_worse_on_unseen_time_says_so_where_people_look(written, capsys):
    found, _ = written
    show_identification(found, None)
    gained = " ".join(capsys.readouterr().out.split())
    assert found.to_dict()["worse"] == []
    assert "did not see the vessel" not in gained
    turned = [replace(v, before=v.after, after=v.before) for v in found.validation]
    lost = replace(found, validation=tuple(turned))
    show_identification(lost, None)
    assert "! on time that the fit did not see (voyage_1" in " ".join(
        capsys.readouterr().out.split()
    )
    assert len(lost.to_dict()["worse"]) >= 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"settings": identify_settings(["nonsense"], [], [], "shooting")},
            "no parameter 'nonsense'",
        ),
        ({"span": TimeSpan(50.0, 20.0)}, "expected a span of time"),
        ({"span": TimeSpan(1e6, None)}, "usable time"),
        ({"out": "/proc/folder/boat.toml"}, "nothing can be written there"),
    ],
)
def test_bad_input_is_one_line(change, says):
    with pytest.raises(BadInput, match=says) as problem:
        identify_logs([LOG], VESSEL, **change)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("arguments", [([], [], ["m11"], "shooting"), ([], [], [], "guess")])
def test_bad_options_are_one_line(arguments):
    with pytest.raises(BadInput):
        identify_settings(*arguments)


def test_the_command_is_there():
    assert "identify" in {command.callback.__name__ for command in app.registered_commands}


def test_of_a_number_that_each_recording_has_the_first_is_kept_and_that_is_said():
    day = 86_400 * 10**9
    trials = [replace(simulated(WAM_V, 20.0), name=f"day {i}", start_time_ns=i * day)
              for i in (1, 2)]  # fmt: skip
    speeds = [
        Estimate("steady_current.speed", "m/s", 0.1, 0.1 * i, (0.0, 1.0), True, f"day {i}")
        for i in (1, 2)
    ]
    mass = Estimate("m11", "kg", 120.0, 126.0, (125.0, 127.0), True)
    told = provenance((mass, *speeds), trials, "shooting, 60 s")
    assert told["dynamics.m11"].recording == "day 1, day 2"
    assert told["steady_current.speed"].recording == "day 1"
    assert "0.2 m/s on day 2" in told["steady_current.speed"].says
    found = Identification(WAM_V, "shooting", 40.0, (mass, *speeds), (), (), ())
    (warning,) = voyage_notices(found)
    assert "steady_current.speed" in warning
    assert "day 1" in warning
    assert voyage_notices(replace(found, estimates=(mass, speeds[0]))) == []


@pytest.mark.parametrize("name", ["area_front", "area_side"])
def test_areas_that_were_fitted_are_not_said_to_be_assumed(tmp_path, name):
    wind = next(e for e in EFFECTS if e.name == "steady_wind")
    known = {p.name: p.default for p in wind.parameters if p.default is not None}
    bare = replace(WAM_V, hull=replace(WAM_V.hull, wind_area=(0.0, 0.0)))
    bare = bare.with_effects(AddedEffect(wind, {"speed": 5.0, "direction": 1.0, **known}))
    file = tmp_path / "boat.toml"
    file.write_text(dump_vessel(bare), encoding="utf-8")
    old, boat = read_vessel_file(file), load_vessel(file)
    assert old.provenance["hull.wind_area"].says.startswith("assumed")
    found = Estimate(name, "m²", 0.5, 0.12, (0.1, 0.15), True, doubt="a guess")
    told = provenance((found,), [simulated(WAM_V, 20.0)], "shooting, 60 s")
    better = updated_vessel(boat, {name: 0.12})
    file.write_text(dump_vessel(better, old.provenance | told), encoding="utf-8")
    (key,) = told
    assert key == "hull.wind_area"
    assert read_vessel_file(file).provenance[key].says == (
        f"{name} fitted to the measured wind, 95 % interval 0.1 … 0.15 m²; a guess"
    )
    assert load_vessel(file).hull.wind_area == better.hull.wind_area


def test_pictures_and_exclusions(tmp_path):
    found = identify_logs(
        [LOG], VESSEL, settings=identify_settings([], [], [], "instrumental"), pictures=tmp_path,
        exclude=parse_exclusions(["0:100"]), span=TimeSpan(None, 250.0),
    )  # fmt: skip
    assert found.seconds < 151.0
    names = {file.name for file in tmp_path.glob("*.png")}
    assert names == {"voyage_1-velocities.png", "voyage_1-track.png", "grebe-parameters.png"}


def test_a_model_that_no_prediction_can_be_made_with_is_bad_input(monkeypatch):
    def lost(*_):
        raise DivergedError("plain diverges at once from every start")

    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: [simulated(WAM_V, 30.0)])
    monkeypatch.setattr("gateway.offline.identify.identify", lost)
    with pytest.raises(BadInput, match=r"demo_boat\.toml: plain diverges"):
        identify_logs([LOG], VESSEL)


def test_motors_that_are_wired_otherwise_are_put_right_before_anything_is_fitted(tmp_path):
    """Numbers that make up for the wrong side are the boat's no more."""
    table, _ = written_table(tmp_path, Traps(swapped=True))
    out, settings = tmp_path / "out.toml", identify_settings([], [], [], "shooting")
    for channels in ((1, 3), (3, 1)):
        (tmp_path / f"boat{channels[0]}.toml").write_text(boat_toml(*channels), encoding="utf-8")
    with pytest.raises(BadInput, match=r"boat1.toml: port and starboard.* Set that first") as told:
        identify_logs([table], tmp_path / "boat1.toml", out, settings)
    assert "\n" not in str(told.value)
    assert not out.exists()
    anyway = TrialOptions(anyway=True)
    found = identify_logs([table], tmp_path / "boat1.toml", out, settings, options=anyway)
    assert any("look swapped" in notice for notice in found.notices)
    assert out.exists()
    found = identify_logs([table], tmp_path / "boat3.toml", None, settings)
    assert not any("swapped" in notice for notice in found.notices)


def without_thrust(trial):
    return replace(trial, pwm=np.full_like(trial.pwm, 1500.0))


def test_motors_that_never_ran_tell_no_force_from_a_mass(tmp_path):
    """A boat that was towed: "throttle 0.5 from rest to 694 m/s" was written."""
    out = tmp_path / "boat.toml"
    with pytest.raises(BadInput, match=r"no thruster .* was commanded .*--fix m11"):
        identify_logs([LOG], VESSEL, out, chosen=without_thrust)
    assert not out.exists()


def test_a_boat_that_coasts_tells_its_drag_where_its_mass_is_held():
    settings = identify_settings([], ["m11", "m22", "m33"], [], "shooting")
    assert not settings.sizes_are_free
    assert not identify_settings([], [], ["m11=0.1"], "shooting").sizes_are_free
    found = identify_logs([LOG], VESSEL, None, settings, chosen=without_thrust)
    assert found.vessel.dynamics.m11 == load_vessel(VESSEL).dynamics.m11
