"""The page Fleet: the table of many recordings, courses of numbers, a row that opens in Compare."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.fleet.table import write_table
from gateway.studio.access import Folders
from gateway.studio.pages.fleet import NO_FOLDER, FleetPage
from gateway.studio.serve import StudioOptions, fleet_folder
from gateway.studio.session import Session
from gateway.studio.worker import FleetReader, fleet_task
from tests.conftest import ROOT
from tests.gateway.fleet.test_report import recordings
from tests.gateway.fleet.test_wear import numbers
from tests.gateway.studio.browser import FLAGS, PATIENCE_MS, Watched, chromium, running
from tests.gateway.studio.pages import context_of, message_of

LOG, VESSEL = ROOT / "recordings/voyage_1.tlog", ROOT / "configs/vessels/demo_boat.toml"
WORN = [100.0, 101.0, 99.0, 100.0, 100.5, 99.5, 80.0, 81.0, 79.5, 80.5, 80.0, 79.0]


def write_fleet(folder: Path) -> Path:
    """A table whose second recording ships."""
    rows = recordings()
    rows[1] |= {"recording": str(LOG), "vessel_file": str(VESSEL)}
    steady = numbers("heron", "X_u", [-20.0, -20.1, -19.9, -20.0, -20.2, -19.8])
    write_table(folder, rows, [*numbers("heron", "left.ahead", WORN), *steady])
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet(tmp_path_factory.mktemp("fleet"))


def page_on(folder: Path | None, tmp_path: Path) -> FleetPage:
    page = FleetPage(context_of(Session(Folders((), tmp_path), (), None)))
    page.context.fleet.folder = folder
    page.body()
    return page


def test_the_table_is_shown_with_courses_what_has_changed_first(folder, tmp_path):
    page = page_on(folder, tmp_path)
    reader = page.context.fleet
    reader.view, reader.revision, reader._looked = fleet_task(lambda _: None, str(folder)), 1, 1e12
    page.tick()
    shown = page._table.value
    assert list(shown.recording[1:4]) == ["otter.BIN", "voyage_1.tlog", "heron-2.tlog"]
    assert shown.state.iloc[-1] == "failed"
    assert shown.about.iloc[-1] == "cut off & torn"
    assert page._number.options == ["heron: left.ahead", "heron: X_u"]
    assert "the left thruster has lost 20 %" in page._headline.object
    assert "1 of 10 recordings could not be used" in page._headline.object
    assert len(page._maps.objects) == 2
    assert page._boat.options == ["all", "heron", "no boat", "otter"]
    page._boat.value, page._state.value = "no boat", "failed"
    assert list(page._table.value.recording) == ["torn.tlog"]
    page._number.value = "heron: X_u"
    assert "no change is clear" in page._course.part[-1].object


def test_rows_of_one_name_can_each_be_chosen(folder, tmp_path):
    page, view = page_on(folder, tmp_path), fleet_task(lambda _: None, str(folder))
    rows = tuple({**view.rows[0], "recording": f"/{name}/log.tlog"} for name in ("a", "b"))
    page.context.fleet.view = replace(view, rows=rows)
    page._filter()
    assert page._which.options == {"log.tlog (/a)": 0, "log.tlog (/b)": 1}


def test_a_row_is_worked_on_with_its_vessel_and_one_that_is_gone_says_so(folder, tmp_path):
    page = page_on(folder, tmp_path)
    page.context.fleet.view = fleet_task(lambda _: None, str(folder))
    page._filter()
    page._search.value_input = "voyage compare"
    assert list(page._table.value.recording) == ["voyage_1.tlog"]
    page.open_row(0)
    assert page.session.logs == (LOG.resolve(),)
    assert page.session.vessel_file == VESSEL.resolve()
    assert page._leave.value == "/compare?log=voyage_1.tlog"
    page._search.value_input = ""
    page.guarded(lambda: page.open_row(3))()
    assert message_of(page) == "/logs/heron-2.tlog: not on this machine now"
    assert page.session.logs == (LOG.resolve(),)


def test_without_a_table_the_page_says_how_to_make_one_and_a_wrong_one_is_refused(tmp_path):
    page = page_on(None, tmp_path)
    page.tick()
    assert page._why.object == NO_FOLDER
    (tmp_path / "recordings.parquet").write_bytes(b"no table")
    with pytest.raises(BadInput, match="not a table of shadow fleet"):
        fleet_task(lambda _: None, str(tmp_path))
    reader = page.context.fleet
    reader.refused, reader.revision = "it is torn", 1
    page.tick()
    assert "it is torn" in page._why.object


def test_the_folder_is_the_one_given_or_where_shadow_fleet_writes(folder, tmp_path):
    assert fleet_folder(StudioOptions(fleet=folder)) == folder
    assert fleet_folder(StudioOptions(out=tmp_path)) is None
    write_fleet(tmp_path / "fleet")
    assert fleet_folder(StudioOptions(out=tmp_path)) == tmp_path / "fleet"
    with pytest.raises(BadInput, match=r"no recordings\.parquet in it"):
        fleet_folder(StudioOptions(fleet=tmp_path))


def test_a_table_that_is_written_again_is_read_again(folder, monkeypatch):
    reader, begun = FleetReader(folder), []
    monkeypatch.setattr(reader.worker, "start", lambda *task: begun.append(task))
    for _ in range(2):
        reader._looked = 0.0
        reader.update()
    assert len(begun) == 1
    write_fleet(folder)
    reader._looked = 0.0
    reader.update()
    assert len(begun) == 2


@pytest.fixture
def at(folder, tmp_path) -> Iterator[str]:
    from tests.gateway.studio.test_serve import free_port

    port = free_port()
    command = ("studio", "--folder", str(tmp_path), "--no-browser", "--port", str(port), "--out",
               str(tmp_path), "--connect", "tcp/127.0.0.1:1", "--fleet", str(folder))  # fmt: skip
    with running(*command, until="studio:", log=tmp_path / "studio.log"):
        yield f"127.0.0.1:{port}"
    assert "Traceback" not in (tmp_path / "studio.log").read_text()


@pytest.mark.alone
def test_filtered_and_pressed_a_recording_opens_in_compare(at):
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        watched = Watched(opened.new_page(), at)
        page = watched.page
        page.goto(f"http://{at}/fleet")
        page.get_by_role("gridcell", name="heron-3.tlog").wait_for(timeout=PATIENCE_MS)
        page.get_by_label("Search in name").fill("voyage")
        page.get_by_role("gridcell", name="heron-3.tlog").wait_for(state="detached")
        watched.shot("fleet")
        page.get_by_role("gridcell", name="voyage_1.tlog").click()
        page.wait_for_url("**/compare**", timeout=PATIENCE_MS)
        page.get_by_text("voyage_1").first.wait_for(timeout=PATIENCE_MS)
        watched.is_clean()
        opened.close()


@pytest.mark.alone
def test_axe_finds_nothing_wrong_with_a_fleet_and_a_row_is_opened_by_keyboard(at):
    sync_api = pytest.importorskip("playwright.sync_api")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        for scheme in ("light", "dark"):
            context = opened.new_context(
                viewport={"width": 1280, "height": 900}, color_scheme=scheme
            )
            watched = Watched(context.new_page(), at)
            page = watched.page
            page.goto(f"http://{at}/fleet")
            row = page.get_by_role("gridcell", name="voyage_1.tlog")
            row.wait_for(timeout=PATIENCE_MS)
            page.wait_for_timeout(2500)
            watched.shot(f"fleet-{scheme}")
            found = axe.run(page).response["violations"]
            wrong = [f"{v['id']}: {v['nodes'][0]['html'][:300]}" for v in found]
            assert wrong == [], (scheme, wrong)
            watched.is_clean()
        page.get_by_label("Search in name").fill("voyage")
        page.get_by_role("gridcell", name="heron-3.tlog").wait_for(state="detached")
        page.get_by_label("Open a recording").press("Tab")
        page.get_by_role("button", name="Open in Compare").press("Enter")
        page.wait_for_url("**/compare**", timeout=PATIENCE_MS)
        opened.close()
