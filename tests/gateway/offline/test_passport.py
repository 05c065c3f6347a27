"""The passport: where numbers come from, what differs, what changed; contradicting edits."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

from gateway.errors import BadInput
from gateway.offline.identify import identify_logs, identify_settings
from gateway.offline.vessel import differences, passport
from gateway.toml_file import read_toml
from gateway.vessel_file import dump_vessel, load_vessel, revised
from gateway.vessel_tables import ASSUMED_AREAS, Provenance
from sim.effects.catalogue import named
from sim.model import parameters_of
from sim.vessel import Hull
from tests.conftest import ROOT
from tests.sim.vessels import SHAPES, WAMV, added, every_effect

LOG = ROOT / "recordings" / "voyage_1.tlog"
BOAT = ROOT / "configs" / "vessels" / "demo_boat.toml"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's boat, its numbers from a recording."""
    out = tmp_path_factory.mktemp("fitted") / "fitted.toml"
    identify_logs([LOG], BOAT, out, identify_settings([], [], [], "instrumental"))
    return out


def edited(fitted: Path, folder: Path, key: str, value: float, forget: bool = False) -> Path:
    """The fitted file with one number of its dynamics edited by hand."""
    tables = read_toml(fitted, "the vessel file")
    tables["dynamics"][key] = value
    if forget:
        del tables["provenance"][f"dynamics.{key}"]
    file = folder / "edited.toml"
    file.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return file


def test_a_fitted_number_tells_recording_fit_date_and_interval(fitted):
    read = passport(fitted)
    number = read.number("X_u")
    low, high = number.origin.ci95
    assert low < number.value < high
    assert number.origin.value == number.value
    assert number.source.startswith("shadow identify, instrumental, ")
    assert ", voyage_1, 2025-" in number.source
    assert (number.unit, number.edited) == ("N s/m", False)
    assert read.number("left.ahead").source == "given"
    assert not any(one.edited for one in read.numbers)


def test_what_nobody_gave_is_not_told_as_given(tmp_path):
    text = dump_vessel(
        load_vessel("steered").with_effects(added(named("cubic_drag"))),
        {"thrusters.main.position": Provenance(says="assumed from its function: measure it"),
         "rudders.blade.angle": Provenance(says="read off the linkage")},
    )  # fmt: skip
    file = tmp_path / "boat.toml"
    file.write_text(text, encoding="utf-8")
    source = {one.name: one.source for one in passport(file).numbers}
    assert source["main.x"] == source["main.y"] == "assumed from its function: measure it"
    assert source["blade.angle_low"] == source["blade.angle_high"] == "read off the linkage"
    assert source["area_front"] == source["area_side"] == ASSUMED_AREAS
    for name in ("length", "m11", "main.ahead", "cubic_drag.X_uuu"):
        assert source[name] == "given", name
    for name in ("x_g", "Y_r", "antenna_x", "main.azimuth", "outboard.exponent", "blade.aspect"):
        assert source[name] == "default", name


def test_areas_that_no_file_holds_are_assumed(tmp_path):
    bare = tmp_path / "bare.toml"
    bare.write_text(dump_vessel(replace(WAMV, hull=Hull(1.6, 0.9, 40.0))), encoding="utf-8")
    assert passport(bare).number("area_side").source == ASSUMED_AREAS
    assert passport(BOAT).number("area_side").source == "given"


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda vessel: vessel.name)
def test_every_number_of_every_vessel_has_a_key_of_its_file(vessel, tmp_path):
    file = tmp_path / "boat.toml"
    file.write_text(dump_vessel(vessel.with_effects(*every_effect(vessel))), encoding="utf-8")
    read = passport(file)
    assert {one.name for one in read.numbers} == set(parameters_of(read.vessel))


def test_an_edit_beyond_the_interval_is_refused_by_whatever_reads_the_file(fitted, tmp_path):
    low, _ = passport(fitted).number("X_u").origin.ci95
    file = edited(fitted, tmp_path, "X_u", 3.0 * low)
    with pytest.raises(BadInput) as error:
        load_vessel(file)
    text = str(error.value)
    assert text.startswith(f"{file}: dynamics.X_u = {3.0 * low:g}: voyage_1 gave ")
    assert '[provenance."dynamics.X_u"]' in text


def test_an_edit_within_the_interval_is_used_and_told(fitted, tmp_path):
    low, _ = passport(fitted).number("X_u").origin.ci95
    within = 0.5 * (low + passport(fitted).number("X_u").value)
    number = passport(edited(fitted, tmp_path, "X_u", within)).number("X_u")
    assert (number.value, number.edited) == (within, True)
    assert number.source.startswith("edited by hand, within its interval; ")


def test_an_edit_that_is_meant_says_so_by_taking_the_provenance_out(fitted, tmp_path):
    number = passport(edited(fitted, tmp_path, "X_u", -99.0, forget=True)).number("X_u")
    assert (number.value, number.source) == (-99.0, "given")


def test_provenance_of_another_number_is_not_written():
    stale = {"dynamics.X_u": Provenance(value=2.0 * WAMV.dynamics.X_u, ci95=(-100.0, 0.0))}
    assert "provenance" not in dump_vessel(WAMV, stale)
    true = {"dynamics.X_u": Provenance(value=WAMV.dynamics.X_u, ci95=(-100.0, 0.0))}
    assert "provenance" in dump_vessel(WAMV, true)


def test_two_files_differ_in_what_was_fitted_alone(fitted):
    found = {one.name: one for one in differences(passport(BOAT), passport(fitted))}
    assert found.keys() == {"m11", "m22", "m33", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr"}
    one = found["m11"]
    assert one.share == pytest.approx(one.second / one.first - 1.0)
    low, high = passport(fitted).number("m11").origin.ci95
    assert one.beyond is not (low <= one.first <= high)
    assert differences(passport(fitted), passport(fitted)) == []


def test_history_holds_every_command_that_changed_numbers(fitted, tmp_path):
    (first,) = passport(fitted).tables.history
    assert (first.by, first.recording) == ("shadow identify", "voyage_1")
    assert first.before["m11"] == load_vessel(BOAT).dynamics.m11
    assert first.now["m11"] == load_vessel(fitted).dynamics.m11
    again = tmp_path / "again.toml"
    settings = identify_settings([], ["m11", "m22", "m33"], [], "instrumental")
    identify_logs([ROOT / "recordings" / "voyage_2.tlog"], fitted, again, settings)
    assert [one.recording for one in passport(again).tables.history] == ["voyage_1", "voyage_2"]
    boat = load_vessel(fitted)
    assert revised(passport(fitted).tables, boat, boat, "nothing", "") == (first,)


def test_the_commands_tell_it(run, fitted, tmp_path):
    told = json.loads(run("vessel", "show", fitted, "--json").out)
    assert {n["name"] for n in told["numbers"]} >= {"m11", "left.ahead"}
    assert "voyage_1" in run("vessel", "show", fitted).out
    differ = json.loads(run("vessel", "diff", BOAT, fitted, "--json").out)
    assert len(differ["numbers"]) == 9
    assert "m11" in run("vessel", "diff", BOAT, fitted).out
    assert "the two are the same vessel" in run("vessel", "diff", "otter", "otter").out
    assert "right: only in the first" in run("vessel", "diff", "otter", "steered").out
    assert "shadow identify on voyage_1: m11 42 → " in " ".join(
        run("vessel", "history", fitted).out.split()
    )
    assert "no history" in run("vessel", "history", "otter").out
    assert len(json.loads(run("vessel", "history", fitted, "--json").out)["history"]) == 1
    done = run("vessel", "show", edited(fitted, tmp_path, "X_u", -1e6))
    assert (done.status, done.out) == (2, "")
