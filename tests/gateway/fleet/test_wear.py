"""From the table of a fleet to sentences, and what does not belong into them."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from gateway.fleet.table import write_table
from gateway.fleet.wear import wear_of, worded
from tests.gateway.command_line import one_line

START = datetime(2026, 4, 1, 9, tzinfo=UTC)


def numbers(boat: str, name: str, values, **more):
    """Rows of a number, one every five days, known to 1 %."""
    return [
        {
            "recording": f"{boat}-{i}", "boat": boat, "name": name, "value": v, "unit": "N",
            "low": v - 0.01 * abs(v), "high": v + 0.01 * abs(v), "identifiable": True,
            "kind": "parameter", "origin": "identify",
            "started": (START + timedelta(days=5 * i)).isoformat(),
        } | more
        for i, v in enumerate(values)
    ]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    noise = np.random.default_rng(4).normal(0.0, 0.01, (6, 20))
    worn = np.where(np.arange(20) < 9, 90.0, 0.82 * 90.0)
    rows = [
        *numbers("heron", "left.ahead", worn * (1.0 + noise[0])),
        *numbers("heron", "right.ahead", 90.0 * (1.0 + noise[1])),
        *numbers("heron", "X_u", -20.0 * (1.0 + 0.02 * np.arange(20)) * (1.0 + noise[2])),
        *numbers("heron", "N_r", worn, identifiable=False),
        *numbers("heron", "steady_current.speed", worn, kind="effect", origin="diagnose",
                 effect="steady_current"),
        *numbers("otter", "left.ahead", 90.0 * (1.0 + noise[3])),
        *numbers("swan", "left.ahead", [90.0] * 3),
    ]  # fmt: skip
    write_table(tmp_path, [], rows)
    return tmp_path


def test_a_change_is_one_sentence_with_size_and_date(folder):
    found = wear_of(folder)
    step, drift = sorted(w.text for w in found.changes)[::-1]
    assert step.startswith("heron: the left thruster has lost 18 % (")
    assert step.endswith(" since 13 May 2026")  # between the recordings of 11 and 16 May
    assert drift.startswith("heron: X_u has gained ")
    assert " steadily since about " in drift
    assert {(w.boat, w.name) for w in found.numbers} == {
        ("heron", "left.ahead"), ("heron", "right.ahead"), ("heron", "X_u"), ("otter", "left.ahead")
    }  # fmt: skip
    assert found.too_few == {"swan": 1}


def test_one_boat_alone(folder):
    assert {w.boat for w in wear_of(folder, ["otter"]).numbers} == {"otter"}


def test_the_command_tells_it_in_words_and_as_json(run, folder):
    done = run("wear", folder)
    assert done.status == 0
    assert "has lost 18 %" in " ".join(done.out.split())
    assert "swan: 1 numbers in fewer than 6 recordings" in " ".join(done.out.split())
    told = json.loads(run("wear", folder, "--json").out)
    assert len(told["changes"]) == 2
    change = next(n["change"] for n in told["numbers"] if n["name"] == "left.ahead")
    assert (change["kind"], change["moment"]) == ("step", "2026-05-13")
    steady = json.loads(run("wear", folder, "--json", "--boat", "otter").out)
    assert steady["changes"] == []
    assert (
        "nothing has changed: 1 numbers were followed" in run("wear", folder, "--boat", "otter").out
    )


def test_pictures_of_every_course(run, folder, tmp_path):
    done = run("wear", folder, "--pictures", tmp_path / "drawn")
    assert done.status == 0
    assert {file.name for file in (tmp_path / "drawn").iterdir()} == {
        "heron-left.ahead.png", "heron-right.ahead.png", "heron-x_u.png", "otter-left.ahead.png"
    }  # fmt: skip
    (one,) = (w for w in wear_of(folder, ["heron"]).numbers if w.name == "left.ahead")
    _, line, dots = one.figure.panels[0].marks
    assert one.figure.caption == one.text
    assert (dots.y == one.series.value).all()
    assert (line.y == one.course.mean).all()


def test_a_picture_that_the_user_made_is_kept(run, folder, tmp_path):
    mine = tmp_path / "drawn" / "heron-x_u.png"
    mine.parent.mkdir()
    mine.write_bytes(b"mine")
    one_line(run("wear", folder, "--pictures", mine.parent), 2, f"{mine}: is there already")
    assert mine.read_bytes() == b"mine"
    assert [file.name for file in mine.parent.iterdir()] == [mine.name]


def test_names_in_words():
    assert worded("left.ahead") == "the left thruster"
    assert worded("X_uu") == "X_uu"
    assert worded("left.astern") == "left.astern"
