"""`shadow identify` from a recording that ships."""

import json

import pytest

from gateway.cli import app
from gateway.errors import BadInput
from gateway.pipelines.identify import Span, identify_logs, settings_of
from gateway.vessel_file import load_vessel, read_vessel_file
from tests.conftest import ROOT

LOG = ROOT / "recordings" / "voyage_1.tlog"
VESSEL = ROOT / "configs" / "vessels" / "demo_boat.toml"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("identified") / "boat.toml"
    return identify_logs([LOG], VESSEL, out, settings_of([], ["Y_vv"], [], "shooting")), out


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
    told = json.loads(json.dumps(written[0].as_dict(), allow_nan=False))
    assert set(told["parameters"]["m11"]) >= {"value", "ci95", "unit", "before"}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"settings": settings_of(["nonsense"], [], [], "shooting")}, "no parameter 'nonsense'"),
        ({"span": Span(50.0, 20.0)}, "expected a span of time"),
        ({"span": Span(1e6, None)}, "usable time"),
        ({"out": "/no/such/folder/boat.toml"}, "no such folder"),
    ],
)
def test_bad_input_is_one_line(change, says):
    with pytest.raises(BadInput, match=says) as problem:
        identify_logs([LOG], VESSEL, **change)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("arguments", [([], [], ["m11"], "shooting"), ([], [], [], "guess")])
def test_bad_options_are_one_line(arguments):
    with pytest.raises(BadInput):
        settings_of(*arguments)


def test_the_command_is_there():
    assert "identify" in {command.callback.__name__ for command in app.registered_commands}
