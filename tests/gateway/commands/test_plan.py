"""`shadow plan` as a user types it."""

from pathlib import Path

import pytest

from sim.excitation.catalogue import MANOEUVRES
from tests.gateway.command_line import Run, one_line, strictly


def test_the_list_is_json_where_that_is_asked_for(run: Run) -> None:
    told = strictly(run("plan", "--list", "--json").out)["manoeuvres"]
    assert [one["name"] for one in told] == [one.name for one in MANOEUVRES]
    assert all(one["seconds"] > 0.0 and one["reveals"] for one in told)


def test_the_list_names_every_manoeuvre(run: Run) -> None:
    done = run("plan", "--list")
    assert done.status == 0
    assert all(manoeuvre.name in done.out for manoeuvre in MANOEUVRES)


def test_it_tells_what_will_happen_and_where_the_files_are(
    run: Run,
    boat: Path,
    tmp_path: Path,
) -> None:
    done = run("plan", "-v", boat, "--excitation", "spin", "--out", tmp_path / "plans")
    assert done.status == 0
    says = " ".join(done.out.split())
    for part in ("in the circle of 100 m", "rise 10–90 %", "settles to", "BATT_LOW_VOLT"):
        assert part in says
    written = {file.name for file in (tmp_path / "plans").iterdir()}
    assert len(written) == 5
    assert all(name in says for name in written)


def test_json_is_json_alone(run: Run, boat: Path, tmp_path: Path) -> None:
    done = run("plan", "-v", boat, "--excitation", "still", "--out", tmp_path, "--json")
    told = strictly(done.out)
    assert told["excitation"] == "still"
    assert told["reach_m"] == 0.0
    assert told["step_responses"]["yaw"]["settling_2"] > 0.0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "--vessel"),
        (("-v", "BOAT", "--excitation", "jump"), "zigzag"),
        (("-v", "BOAT", "--throttle-limit", "2"), "--throttle-limit 2"),
        (("old.tlog", "-v", "BOAT"), "old.tlog"),
        (("-v", "absent.toml"), "absent.toml"),
    ],
)
def test_what_cannot_be_is_one_line(
    run: Run,
    boat: Path,
    words: tuple[str, ...],
    says: str,
) -> None:
    one_line(run("plan", *(boat if w == "BOAT" else w for w in words)), 2, says)
