"""The desk: what pages change and share, without any page."""

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.figures.diagnosis import LadderBar
from gateway.studio.access import Folders
from gateway.studio.session import Session, as_text
from gateway.studio.tasks import compare, report
from gateway.studio.views import Found, LadderView, Other, TrialView
from gateway.vessel_file import load_vessel

ROOT = Path(__file__).resolve().parents[3]
LOG, BOAT = ROOT / "recordings/voyage_1.tlog", ROOT / "configs/vessels/demo_boat.toml"


@pytest.fixture
def desk(tmp_path):
    shutil.copy(BOAT, tmp_path)
    return Session(Folders.of([], [tmp_path], tmp_path / "out"), (), tmp_path / BOAT.name)


def found_on(desk: Session) -> Found:
    """A made-up answer with two effects, one after the other."""
    text = desk.versions[-1].text
    steps = [LadderBar(name, error, None) for name, error in
             (("as given", 0.6), ("base re-fitted", 0.5), ("+ a", 0.3), ("+ b", 0.1))]  # fmt: skip
    effects: list[tuple[str, ...]] = [(), (), ("a",), ("a", "b")]
    rungs = tuple(
        LadderView(e, step, f"{text}\n# {k}")
        for k, (e, step) in enumerate(zip(effects, steps, strict=True))
    )
    return Found({"ranking": []}, ("one.tlog",), 0.1, rungs, None, {})


def test_sliding_is_one_step_however_long_and_undo_takes_it_back(desk):
    first = desk.version
    for value in (41.0, 42.0, 43.0):
        desk.slide(as_text(desk.version, {"m11": value}), "m11 moved by hand")
    assert len(desk.versions) == 2
    assert tomllib.loads(desk.version.text)["dynamics"]["m11"] == 43.0
    assert [name for name, _ in desk.vessels()] == ["as given", "now"]
    desk.undo()
    assert desk.version == first
    desk.undo()
    assert desk.version == first


def test_the_ladder_is_climbed_rung_by_rung_and_down_again(desk):
    desk.found = found_on(desk)
    _, _, a, b = desk.found.rungs
    desk.climb(a)
    assert [s.error for s in desk.version.steps] == [0.6, 0.5, 0.3]
    desk.climb(b)
    assert desk.version.effects == ("a", "b")
    assert [s.error for s in desk.version.steps] == [0.6, 0.5, 0.3, 0.1]
    desk.undo()
    assert desk.version.effects == ("a",)


def test_a_rival_takes_the_place_of_what_was_chosen_with_its_own_error_and_undo_gives_it_back(desk):
    found = found_on(desk)
    rival = LadderView(("a", "c"), LadderBar("+ c", 0.12, None), "c beside a")
    alone = LadderView(("c",), LadderBar("+ c", 0.4, None), "c alone")
    desk.found = replace(found, others=(Other(alone, False), Other(rival, True)))
    for rung in found.rungs[2:]:
        desk.climb(rung)
    chosen = desk.version
    desk.climb(rival)
    assert (desk.version.text, desk.version.effects) == ("c beside a", ("a", "c"))
    assert [s.error for s in desk.version.steps] == [0.6, 0.5, 0.3, 0.12]
    desk.undo()
    assert desk.version == chosen
    desk.climb(alone)
    assert [s.error for s in desk.version.steps] == [0.6, 0.5, 0.4]


def test_a_second_diagnosis_goes_on_from_the_first(desk):
    desk.found = found_on(desk)
    desk.climb(desk.found.rungs[2])
    again = found_on(desk)
    desk.found = replace(again, before=("a",), rungs=(
        *(replace(r, step=LadderBar(r.step.name, 0.3, None)) for r in again.rungs[:2]),
        LadderView(("d",), LadderBar("+ d", 0.2, None), "text"),
    ))  # fmt: skip
    desk.climb(desk.found.rungs[2])
    assert desk.version.effects == ("a", "d")
    assert [s.error for s in desk.version.steps] == [0.6, 0.5, 0.3, 0.3, 0.2]


def test_what_cannot_begin_yet_loses_no_answer(desk):
    desk.logs, desk.found = (desk.folders.read[0] / "a.tlog",), found_on(desk)
    desk.report, desk.slow.job = "report.html", "look"
    for work in (desk.diagnose, desk.make_report):
        with pytest.raises(RuntimeError, match="busy with look"):
            work()
    assert desk.found == found_on(desk)
    assert desk.report == "report.html"


def test_what_is_saved_loads_again_and_nothing_is_written_over(desk):
    desk.slide(as_text(desk.version, {"X_u": -7.5}), "X_u moved by hand")
    file = desk.save("mine.toml")
    assert load_vessel(file).dynamics.X_u == -7.5
    with pytest.raises(BadInput, match="there already"):
        desk.save("mine.toml")


def test_a_number_moved_by_hand_loses_its_origin(desk):
    text = desk.version.text + '\n[provenance."dynamics.m11"]\nrecording = "one"\n'
    desk.slide(text, "told")
    tables = tomllib.loads(as_text(desk.version, {"m11": 40.0}))
    assert "dynamics.m11" not in tables["provenance"]


def test_files_elsewhere_are_not_taken(desk):
    with pytest.raises(BadInput, match="not in a folder"):
        desk.take_logs([LOG])
    with pytest.raises(BadInput, match="not in a folder"):
        desk.take_vessel(BOAT)


def test_a_vessel_file_with_a_mistake_changes_nothing(desk):
    bad = desk.folders.read[0] / "bad.toml"
    bad.write_text(BOAT.read_text().replace("m11 = 42.0", 'm11 = "heavy"'))
    before = desk.version
    with pytest.raises(BadInput, match="m11"):
        desk.take_vessel(bad)
    assert desk.version == before


def test_measured_motion_is_told_before_anything_is_compared_and_regimes_have_their_times():
    told: list[object] = []
    (view,) = compare(told.append, [str(LOG)], [("as given", BOAT.read_text())], ())
    parts = [one for one in told if isinstance(one, TrialView)]
    assert [one.vessels for one in parts] == [()]
    (vessel,) = view.vessels
    assert vessel.nrmse > 2.0 * vessel.floor
    assert set(vessel.pictures) == {"velocities", "residuals", "track", "strips", "forces"}
    speed = next(w for w in vessel.worst if w.says.startswith("speed"))
    inside = np.zeros(len(view.time), bool)
    for start, end in speed.spans:
        inside |= (view.time >= start) & (view.time < end)
    east, north = np.gradient(view.east, view.time), np.gradient(view.north, view.time)
    median = np.median(np.hypot(east, north)[inside])
    low, high = (float(word) for word in speed.says.split(":")[0].split()[1:4:2])
    assert low <= median <= high


def test_the_error_over_time_is_what_the_scores_are_made_of():
    (view,) = compare(lambda _: None, [str(LOG)], [("as given", BOAT.read_text())], ())
    line = view.vessels[0].pictures["residuals"].panels[1].marks[1]
    rms = float(np.sqrt(np.nanmean(line.y**2)))
    assert rms == pytest.approx(view.vessels[0].rmse["v"], rel=0.15)


def test_a_report_without_the_answer_that_the_page_shows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="diagnose again"):  # a cancelled job took it along
        report(lambda _: None, [], [], [], str(tmp_path / "report.html"), told=True)
    assert not list(tmp_path.iterdir())
