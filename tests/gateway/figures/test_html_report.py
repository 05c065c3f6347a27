"""The report: one file that asks for nothing, holds everything, and stays small enough to mail."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.figures.html_report import (
    LARGEST,
    FirstPage,
    ReportFigure,
    ReportPage,
    ReportRecording,
    render,
)
from gateway.offline.compare import TrialComparison
from gateway.offline.first_page import first_page, of_a_guess
from gateway.offline.report import report_of, write_report
from sim.comparison.compare import compare
from sim.diagnosis.answer import Verdict
from sim.effects.catalogue import named
from sim.model import Model
from tests.gateway.figures.test_words import diagnosis
from tests.sim.voyages import WAM_V, trial_of, voyage

LOADS = {"src", "href", "srcset", "data", "poster", "action", "xlink:href"}


class AddressParser(HTMLParser):
    """All addresses that a browser would ask for, and all images."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.images: list[str] = []
        self.scripts = 0

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.addresses += [
            v for k, v in attrs if k in LOADS and v and not v.startswith(("#", "data:"))
        ]
        self.images += [given["alt"]] if tag == "img" else []
        self.scripts += tag == "script"


@pytest.fixture(scope="module")
def page():
    """A boat in a current, a vessel that knows nothing of it and its twin with a hostile name."""
    noise = np.square([0.05, 0.05, 0.005, 0.01, 0.01, 0.005, 0.02, 0.02, 0.01])
    trial = trial_of(*voyage(120.0, current=(0.0, 0.3)), 0.05, np.diag(noise))
    vessels = [WAM_V, replace(WAM_V, name="<script>alert(1)</script>")]
    found = TrialComparison(trial, tuple(compare(trial, [Model.of(v) for v in vessels])))
    return report_of([found], vessels, None), found


def test_it_asks_for_nothing_outside_itself(page):
    text = render(page[0])
    parser = AddressParser()
    parser.feed(text)
    assert parser.addresses == []
    assert parser.scripts == 0
    assert not re.search(r"https?://|//\w+\.\w+|@import|url\(", text)
    assert len(parser.images) == 1 + 1 + 2 * 4  # first page, errors of both, sections of each
    assert all(parser.images)


def test_numbers_words_and_vessel_file_are_in_it(page):
    report, found = page
    text = render(report)
    one = found.comparisons[0]
    assert f"{one.nrmse:.3f}" in text
    assert f"{one.noise_floor_nrmse:.3f}" in text
    assert one.worst(1)[0].sentence.split(";")[0] in text
    assert "X_uu" in text
    assert "shadow-gateway 0." in text
    assert "Something is wrong" in report.headline
    assert "&lt;script&gt;alert" in text


@pytest.fixture
def undrawn(monkeypatch):
    """For words alone: the figures are made, and drawn by another test."""
    for module in ("report", "first_page"):
        monkeypatch.setattr(f"gateway.offline.{module}.svg_text", lambda figure: "<svg/>")


def test_a_model_at_the_floor_is_called_good(page, undrawn):
    _, found = page
    first = found.comparisons[0]
    loud = replace(first, nrmse=first.noise_floor_nrmse)
    said = report_of([TrialComparison(found.trial, (loud,))], [WAM_V], None)
    assert "times in surge" in said.headline  # all channels together are at the floor
    assert "Use the model as it is" not in render(said)
    quiet = dict.fromkeys(first.scores.rmse, 1e-4)
    good = replace(loud, scores=replace(first.scores, rmse=quiet))
    headline = report_of([TrialComparison(found.trial, (good,))], [WAM_V], None).headline
    assert "as good as these recordings can tell" in headline
    hidden = replace(first, nrmse=1.21, noise_floor_nrmse=12.4, measured_noise=3.0)
    said = report_of([TrialComparison(found.trial, (hidden,))], [WAM_V], None)
    assert "cannot judge" in said.headline
    assert "as good as" not in render(said)
    assert "owhere worse than noise" not in render(said)
    ill = replace(hidden, measured_noise=0.1)  # the model, not the recording
    said = report_of([TrialComparison(found.trial, (ill,))], [WAM_V], None)
    assert "runs away from every start" in said.headline
    assert "Check the numbers of the vessel" in render(said)
    assert "noise hides the motion" not in render(said)
    assert "Use the model as it is" not in render(said)


def test_figures_that_would_make_it_too_large_are_left_out_and_it_says_so():
    figure = ReportFigure("big", "", "x" * 1_500_000)
    recordings = tuple(ReportRecording(f"log {k}", 60.0, (), (), (), (figure,)) for k in range(5))
    first = FirstPage((), ("h",), None, ())
    text = render(ReportPage("t", "m", "h", recordings, (("boat", "name"),), (), first))
    assert len(text.encode()) < LARGEST
    assert "3 pictures of further recordings are left out" in text


def test_it_is_written_whole(page, tmp_path):
    done = write_report(page[0], tmp_path / "new" / "report.html")
    assert done.path.stat().st_size == done.size_bytes < 5_000_000
    assert [p.name for p in done.path.parent.iterdir()] == ["report.html"]


def test_a_diagnosis_is_told_whole(page):
    number = {"value": -0.1289, "ci95": [-0.14, -0.12], "unit": "rad"}
    rung = {"effects": ["heading_offset"], "parameters": {"heading_offset": {"angle": number}}}
    answer = {
        "verdict": "confounded", "summary": "two explain it", "ladder": [rung],
        "ranking": [
            {"effect": "heading_offset", "probability": 0.6, "heldout_nrmse": 0.12,
             "confounded_with": ["steady_current"]},
            {"effect": "steady_wind", "probability": 1e-9, "heldout_nrmse": 0.5,
             "confounded_with": []},
        ],
        "depends_on": [{"on": "time", "share": 0.2, "says": "grows with time"}],
        "next_manoeuvre": "full circles at two speeds",
        "refused": [{"effect": "battery_sag", "because": "the voltage hardly changed"},
                    {"effect": "hull_lift", "because": "wins nothing", "doubted": True}],
    }  # fmt: skip
    text = render(
        replace(page[0], diagnosis=answer, ladder=ReportFigure("The ladder", "", "<svg/>"))
    )
    for words in ("What is missing: confounded", "two explain it", "heading offset: angle",
                 "−0.1289", "60.0 %", "&lt; 0.1 %", "steady current", "grows with time",
                 "full circles at two speeds", "battery sag: the voltage hardly changed",
                 "Not judged: these data cannot show it", "hull lift: wins nothing",
                 "Not believed, though it would help here",
                 "The ladder"):  # fmt: skip
        assert words in text, words


def test_the_first_page_says_what_was_tested_what_came_of_it_and_what_to_do(page):
    report, found = page
    first = report.first
    seconds = f"{found.comparisons[0].seconds:.0f} s. "
    assert first.tested[0].startswith(f"{found.trial.name}, {seconds}")  # its clock has no date
    dated = replace(found.trial, start_time_ns=1_777_600_000 * 10**9)
    (tested,) = first_page([TrialComparison(dated, found.comparisons)], None, "").tested
    assert tested.startswith(f"{found.trial.name}, 2026-05-01, {seconds}")
    assert "times what noise alone would show" in first.tested[0]
    assert first.verdict == (report.headline,)
    assert first.actions == ("Find out what is missing: the same command with --diagnose.",)
    assert "before and after" in first.picture.title
    text = render(report)
    assert text.index("What was tested") < text.index("What to do") < text.index('id="numbers"')
    assert "had to be assumed" not in text
    assumed = render(replace(report, first=replace(first, assumed=("mass 30 kg",))))
    assert "<li>mass 30 kg</li>" in assumed


def test_the_picture_of_the_first_page_is_of_the_velocity_that_is_worst(page, undrawn):
    _, found = page
    one = found.comparisons[0]
    for i, name in enumerate(("Surge", "Sway", "Yaw rate")):
        rmse = {axis: (1.0 if k == i else 1e-9) for k, axis in enumerate("uvr")}
        worst = replace(one, scores=replace(one.scores, rmse={**one.scores.rmse, **rmse}))
        report = report_of([TrialComparison(found.trial, (worst,))], [WAM_V], None)
        assert report.first.picture.title.startswith(name)
        assert "measured and predicted" in report.first.picture.title


@pytest.mark.parametrize("after", [0.2, 15.75])
def test_what_does_worse_where_it_is_judged_is_not_to_be_used(page, after):
    """Found on one part of a recording, judged on the rest: an error that rises is said first."""
    _, found = page
    one, other = found.comparisons
    judged = (replace(one, nrmse=0.87), replace(other, nrmse=after))
    answer = SimpleNamespace(
        diagnosis=diagnosis(Verdict.EXPLAINED, "heading_offset"), notices=(), improves=True,
        voyage_effects=[], separations={},
    )  # fmt: skip
    answer.diagnosis.next_manoeuvre = None
    first = first_page([TrialComparison(found.trial, judged)], answer, "")
    failed = after > 0.87
    assert ("rises from 0.87 to 15.75" in first.verdict[0]) == failed
    assert any("The compass reads" in text for text in first.verdict)
    assert any("Do not use" in text for text in first.actions) == failed
    assert any("Use the better vessel" in text for text in first.actions) != failed


def test_a_first_page_begins_with_outputs_that_are_not_the_boats(page):
    """It was a note below the list of where the error is worst."""
    _, found = page
    first = first_page([found], None, "It is wrong.", wiring=["left (channel 5): never driven"])
    assert first.verdict == ("Left (channel 5): never driven.", "It is wrong.")
    assert first.actions[0].startswith("Correct the outputs in the vessel file first")
    assert first_page([found], None, "It is wrong.").verdict == ("It is wrong.",)
    port, starboard = WAM_V.thrusters
    swapped = (replace(port, servo=starboard.servo), replace(starboard, servo=port.servo))
    text = report_of([found], [replace(WAM_V, thrusters=swapped)], None).headline
    assert text.startswith("Port and starboard commands look swapped")


def test_outputs_are_put_right_once(page):
    """What was found exchanges them already: the file at the end is not to be changed once more."""
    _, found = page
    wiring = "port and starboard commands look swapped"
    for effect, says in (("actuator_wiring", False), ("heading_offset", True)):
        answer = SimpleNamespace(
            diagnosis=diagnosis(Verdict.EXPLAINED, "heading_offset"), notices=(wiring,),
            improves=True, voyage_effects=[], separations={},
        )  # fmt: skip
        answer.diagnosis.next_manoeuvre = None
        added = SimpleNamespace(effect=named(effect))
        answer.diagnosis.vessel = SimpleNamespace(effects=(added,))
        first = first_page([found], answer, "", wiring=[wiring])
        assert any(text.startswith("Correct the outputs") for text in first.actions) == says
        assert wiring not in first.actions
        assert sum("look swapped" in text for text in (*first.verdict, *first.actions)) == 1


def test_of_a_vessel_that_was_assumed_nothing_is_said_of_its_file():
    assert of_a_guess("53 % nearer to the centre line than in the file (50–56 %)") == (
        "53 % nearer to the centre line than was assumed (50–56 %)"
    )
    for text in ("weaker than modelled", "Numbers of the vessel file are off: m33 8 → 3 kg m²",
                 "the motors would give 80 % of the thrust in the file throughout",
                 "as if the thrust in the file were in pounds", "actuators 1 and 2 of the file",
                 "the antenna does not sit where the file says"):  # fmt: skip
        assert "file" not in of_a_guess(text), text
        assert "modelled" not in of_a_guess(text), text


@pytest.mark.parametrize("noise", [True, False])
def test_what_no_prediction_needs_is_not_the_first_thing_that_is_said(page, noise):
    """A vessel at the noise floor, and "Something is missing" above it."""
    _, found = page
    one = found.comparisons[0]
    quiet = replace(one.scores, rmse=dict.fromkeys(one.scores.rmse, 0.0))
    judged = replace(one, noise_floor_nrmse=one.nrmse, scores=quiet) if noise else one
    answer = SimpleNamespace(
        diagnosis=diagnosis(Verdict.UNKNOWN), notices=(), improves=False, voyage_effects=[],
        separations={},
    )  # fmt: skip
    answer.diagnosis.next_manoeuvre = None
    first = first_page(
        [TrialComparison(found.trial, (judged,))], answer, "It is as good as can be."
    )
    assert (first.verdict[0] == "It is as good as can be.") == noise
    assert (
        any(text.startswith("From one moment to the next alone") for text in first.verdict) == noise
    )
