"""The report of a fleet: one file that asks for nothing, with what the table says."""

import base64
import re
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from gateway.figures.html_report import LARGEST, FleetPage, ReportFigure, render_fleet
from gateway.fleet.report import maps, write_fleet_report
from gateway.fleet.table import read_recordings, write_table
from tests.gateway.fleet.test_wear import START, numbers


def recordings() -> list[dict[str, object]]:
    """Eight good ones of the heron on one water, one of the otter far away, one that failed."""
    good = [
        {
            "recording": f"/logs/heron-{i}.tlog", "boat": "heron", "state": "done",
            "started": (START + timedelta(days=5 * i)).isoformat(), "usable_s": 600.0,
            "nrmse": 0.1, "noise_floor_nrmse": 0.05, "latitude_deg": 63.4 + 1e-3 * i,
            "longitude_deg": 10.3, "good_for": ["compare", "identify <b>"],
        }
        for i in range(8)
    ]  # fmt: skip
    far = good[0] | {"recording": "/logs/otter.BIN", "boat": "otter", "latitude_deg": -12.0}
    bad = {"recording": "/logs/torn.tlog", "boat": None, "state": "failed", "why": "cut off & torn"}
    return [*good, far, bad]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("fleet")
    worn = np.where(np.arange(8) < 4, 90.0, 70.0) * (1.0 + 1e-3 * np.arange(8) % 3)
    write_table(folder, recordings(), numbers("heron", "left.ahead", worn))
    write_fleet_report(folder, folder / "r.html")
    return (folder / "r.html").read_text(encoding="utf-8")


def test_it_asks_for_nothing_outside_itself(page: str) -> None:
    assert "<script" not in page
    assert set(re.findall(r'src="([^,]*),', page)) == {"data:image/svg+xml;base64"}
    assert not re.findall(r'(?:href|src)="(?!#|data:)', page)


def test_boats_recordings_and_reasons_are_in_it(page: str) -> None:
    assert "<h1>Fleet: 2 boats, 10 recordings</h1>" in page
    assert "<td>heron</td><td>8 of 8</td><td>80 min</td><td>0.100</td><td>0.050</td>" in page
    assert "1 of 10 recordings could not be used</p>" in page
    assert "cut off &amp; torn" in page
    assert "identify &lt;b&gt;" in page
    assert page.count("heron-3.tlog") == 1


def test_the_course_of_a_number_is_drawn_and_its_change_told(page: str) -> None:
    assert re.search(r"<p>heron: the left thruster has lost 2\d %", page)
    drawn = [base64.b64decode(s).decode() for s in re.findall(r"base64,([^\"]+)\"", page)]
    assert len(drawn) == 3
    assert "heron left.ahead" in page


def test_each_water_has_its_map_the_one_most_sailed_first(tmp_path: Path) -> None:
    write_table(tmp_path, recordings(), [])
    first, second = maps(read_recordings(tmp_path))
    _, dots = first.panels[0].marks
    assert len(dots.x) == 8
    assert np.ptp(dots.y) == pytest.approx(7 * 111.2, rel=1e-3)
    assert first.title == "around 63.4035° N, 10.3000° E"
    assert second.title == "around 12.0000° S, 10.3000° E"


def test_a_report_stays_small_enough_for_a_mail() -> None:
    figure = ReportFigure("number", "", "x" * 1_000_000)
    text = render_fleet(FleetPage("t", "m", (), (), (), (), (figure,) * 9))
    assert len(text) < LARGEST
    assert text.count("<figure>") == 3
    assert "6 more courses have no room here" in text
