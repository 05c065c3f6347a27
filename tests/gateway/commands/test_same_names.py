"""Recordings whose files have one name: each keeps its own in tables, sentences and pictures."""

import json
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.files import picture_name, recording_names
from gateway.offline.identify import identify_logs, identify_settings
from gateway.offline.report import make_report
from gateway.offline.trials import load_trials
from gateway.offline.usable_time import parse_exclusions
from tests.gateway.command_line import Run
from tests.gateway.pipelines.sailing import parameters, tlog, voyage

NAMES = ["d1/log.tlog", "d2/log.tlog"]


@pytest.fixture
def two(tmp_path: Path, sailed: bytes) -> list[Path]:
    """Two voyages of different length, in two folders."""
    files = [tmp_path / name for name in NAMES]
    for file in files:
        file.parent.mkdir()
    files[0].write_bytes(sailed)
    tlog(files[1], [*parameters(), *voyage(52.0)])
    return files


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["a/x.tlog", "b/y.tlog"], ["x", "y"]),
        (["a/x.tlog", "a/x.BIN"], ["x.tlog", "x.BIN"]),
        (["a/x.tlog", "b/x.tlog", "b/y.csv"], ["a/x.tlog", "b/x.tlog", "y"]),
        (["a/x.tlog", "a/x.BIN", "b/x.tlog"], ["a/x.tlog", "x.BIN", "b/x.tlog"]),
        (["1/a/x.tlog", "2/a/x.tlog"], ["1/a/x.tlog", "2/a/x.tlog"]),
        (["a/two words.tlog", "a/two-words.tlog"], ["two words.tlog 1", "two-words.tlog 2"]),
        (["a/Log.tlog", "a/log.BIN"], ["Log.tlog", "log.BIN"]),  # one picture, on some disks
    ],
)
def test_no_two_recordings_have_one_name(files: list[str], names: list[str]) -> None:
    found = recording_names(files)
    assert len({picture_name(name) for name in found}) == len(files)
    assert found == names


def test_trials_of_one_call_have_names_of_their_own(two: list[Path]) -> None:
    assert [trial.name for trial in load_trials(two)] == NAMES
    assert [trial.name for trial in load_trials(two[0])] == ["log"]


def test_compare_holds_no_voyage_beside_another(run: Run, two: list[Path], boat: Path) -> None:
    pictures = two[0].parent / "pictures"
    status, out, err = run("compare", *two, "-v", boat, "--pictures", pictures, "--json")
    assert status == 0, err
    found = json.loads(out)
    assert [one["log"] for one in found["trials"]] == NAMES
    assert "improvements" not in found  # one vessel: nothing is better than anything
    drawn = {file.name for file in pictures.iterdir()}
    assert {"d1-log.tlog-wam-v-track.png", "d2-log.tlog-wam-v-track.png"} <= drawn
    assert all(name.startswith(("d1-log.tlog-", "d2-log.tlog-")) for name in drawn)


def test_a_picture_that_is_there_is_asked_about_under_its_full_name(
    run: Run, two: list[Path], boat: Path
) -> None:
    diary = two[0].parent / "d2-log.tlog-wam-v-strips.png"
    diary.write_bytes(b"mine")
    status, _, err = run("compare", *two, "-v", boat, "--pictures", diary.parent)
    assert status == 2
    assert f"{diary}: is there already" in err
    assert diary.read_bytes() == b"mine"


def test_identify_tells_them_apart(two: list[Path], boat: Path, tmp_path: Path) -> None:
    out = tmp_path / "new.toml"
    settings = identify_settings((), (), (), "regression")
    identify_logs(
        two[:1], boat, out, settings, validate=two[1:],
        exclude=parse_exclusions(["d1/log.tlog:0:12"]), pictures=tmp_path / "pictures",
    )  # fmt: skip
    assert 'recording = "d1/log.tlog"' in out.read_text(encoding="utf-8")
    drawn = {file.name for file in (tmp_path / "pictures").iterdir()}
    assert {"d1-log.tlog-track.png", "d2-log.tlog-track.png"} <= drawn
    with pytest.raises(BadInput, match=r"no recording 'log'.*d1/log\.tlog"):
        identify_logs(two, boat, None, settings, exclude=parse_exclusions(["log:0:12"]))


def test_a_report_has_a_part_for_each(two: list[Path], boat: Path, tmp_path: Path) -> None:
    page = make_report(two, [boat], tmp_path / "report.html").path.read_text(encoding="utf-8")
    assert all(name in page for name in NAMES)
