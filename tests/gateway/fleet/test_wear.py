"""From the table of a fleet to sentences, and what does not belong into them."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
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
    assert step.endswith(" since 13 May 2026, between 11 May 2026 and 16 May 2026")
    assert drift.startswith("heron: X_u has gained ")
    _, latest = drift.split(" steadily, since the first recording (1 Apr 2026) or before")
    assert latest in (", since 6 Apr 2026 at the latest", ", since 11 Apr 2026 at the latest")
    assert {(w.boat, w.name) for w in found.numbers} == {
        ("heron", "left.ahead"), ("heron", "right.ahead"), ("heron", "X_u"), ("otter", "left.ahead")
    }  # fmt: skip
    assert found.too_few == {"swan": 1}


def test_a_drift_that_begins_later_has_its_dates(tmp_path):
    worn = 90.0 - 2.0 * np.maximum(np.arange(20) - 9, 0)
    noise = np.random.default_rng(4).normal(0.0, 0.2, 20)
    write_table(tmp_path, [], numbers("heron", "left.ahead", worn + noise))
    (text,) = (w.text for w in wear_of(tmp_path).changes)
    since, range_ = text.split(" steadily since about ")[1].split(", between ")
    first, last = (datetime.strptime(day, "%d %b %Y") for day in range_.split(" and "))
    assert first <= datetime.strptime(since, "%d %b %Y") <= last
    assert first <= datetime(2026, 5, 16) <= last  # the tenth recording


@pytest.mark.parametrize("never", ["1970-01-01T00:00:10+00:00", None])
def test_what_has_no_real_date_is_left_out_and_told(tmp_path, never):
    steady = 90.0 + np.random.default_rng(5).normal(0.0, 0.5, 12)
    rows = numbers("heron", "left.ahead", steady)
    rows[0]["started"] = never
    rows[1]["started"] = (datetime.now(UTC) + timedelta(days=400)).isoformat()
    write_table(tmp_path, [], rows)
    found = wear_of(tmp_path)
    (one,) = found.numbers
    assert one.recordings == tuple(f"heron-{i}" for i in range(2, 12))
    assert found.sentences == [
        "no change is clear: 1 number followed",
        "heron: 2 recordings left out: no real date (a clock that was not set)",
    ]


def test_two_recordings_of_one_voyage_are_one_day(tmp_path):
    steady = 90.0 + np.random.default_rng(5).normal(0.0, 0.5, 8)
    rows = numbers("heron", "left.ahead", [*steady, *steady])
    for row in rows[8:]:
        row["started"] = rows[int(row["recording"].split("-")[1]) - 8]["started"]
    voyages = [
        {"recording": row["recording"], "boat": "heron", "state": "done", "seconds": 600.0,
         "started": row["started"], "usable_s": 400.0 + i}
        for i, row in enumerate(rows)
    ]  # fmt: skip
    voyages[8]["started"] = (START + timedelta(seconds=601)).isoformat()  # it began when 0 ended
    rows[8]["started"] = voyages[8]["started"]
    write_table(tmp_path, voyages, rows)
    found = wear_of(tmp_path)
    assert found.numbers[0].recordings == ("heron-0", *(f"heron-{i}" for i in range(8, 16)))
    assert found.sentences[1:] == ["heron: 7 recordings left out: of the same time as another"]


def test_which_way_numbers_wear(folder):
    wears = {w.name: w.series.wears for w in wear_of(folder, ["heron"]).numbers}
    assert wears == {"left.ahead": -1, "right.ahead": -1, "X_u": 1}


def test_one_boat_alone(folder):
    found = wear_of(folder, ["otter"])
    assert {w.boat for w in found.numbers} == {"otter"}
    assert found.too_few == {}
    (one,) = found.numbers
    assert (
        0.05 / 2.0 < one.p_value < 0.05
    )  # alone it would be believed; beside the others it is not
    assert one.change is None
    with pytest.raises(BadInput, match=r"^bear: .* \(boats: heron, otter, swan\)$"):
        wear_of(folder, ["bear"])


def test_the_command_tells_it_in_words_and_as_json(run, folder):
    done = run("wear", folder)
    assert done.status == 0
    assert "has lost 18 %" in " ".join(done.out.split())
    assert "swan: 1 number in fewer than 6 recordings" in " ".join(done.out.split())
    told = json.loads(run("wear", folder, "--json").out)
    assert len(told["changes"]) == 2
    change = next(n["change"] for n in told["numbers"] if n["name"] == "left.ahead")
    assert (change["kind"], change["moment"]) == ("step", "2026-05-13")
    steady = json.loads(run("wear", folder, "--json", "--boat", "otter").out)
    assert steady["changes"] == []
    assert "no change is clear: 1 number followed" in run("wear", folder, "--boat", "otter").out


@pytest.mark.slow
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
