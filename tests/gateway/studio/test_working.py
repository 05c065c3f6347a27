"""Ranges, typed numbers, dropped recordings, signals and names, by mouse in a real browser."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.gateway.studio.browser import FLAGS, PATIENCE_MS, ROOT, Watched, chromium, running
from tests.gateway.studio.test_serve import free_port

pytestmark = pytest.mark.alone

sync_api = pytest.importorskip("playwright.sync_api")
axe_api = pytest.importorskip("axe_playwright_python.sync_playwright")
COMPARED = re.compile("no more than noise|times what noise alone would show")
SETTLE_MS = 2500
MANY_PAGES = ("compare", "diagnose", "vessel", "live", "signals", "fleet", "recordings")


@pytest.fixture(scope="module")
def browser():
    where = chromium()
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=where, args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def at(tmp_path_factory) -> Iterator[str]:
    """The studio on one demo recording; its address."""
    port, out = free_port(), tmp_path_factory.mktemp("out")
    log = "recordings/voyage_1.tlog"
    command = ("studio", log, "--vessel", "configs/vessels/demo_boat.toml", "--no-browser",
               "--port", str(port), "--out", str(out), "--connect", "tcp/127.0.0.1:1")  # fmt: skip
    with running(*command, until="studio:", log=out / "studio.log"):
        yield f"127.0.0.1:{port}"
    assert "Traceback" not in (out / "studio.log").read_text()


@pytest.fixture
def watched(browser, at) -> Iterator[Watched]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    one = Watched(context.new_page(), at)
    yield one
    context.close()
    one.is_clean()


def test_a_marked_range_is_worked_on_alone_kept_and_said_on_other_pages(watched, at):
    page = watched.page
    page.goto(f"http://{at}/compare?range=60.0:160.0")
    page.get_by_text(COMPARED).first.wait_for(timeout=PATIENCE_MS)
    page.get_by_text("Marked: 100 s").wait_for()
    page.get_by_label("Compare, diagnose and fit on").select_option("only what is marked")
    page.get_by_text("Worked on of voyage_1 only 60.0–160.0 s").wait_for()
    page.get_by_text("voyage_1, 100 s").wait_for(timeout=PATIENCE_MS)
    page.get_by_label("Name of the marked range").fill("turns")
    page.get_by_label("Name of the marked range").press("Tab")
    page.get_by_role("button", name="Keep").click()
    page.get_by_text("range turns kept").wait_for()
    watched.shot("range")
    page.get_by_role("link", name="Diagnose").click()
    page.get_by_text("Worked on of voyage_1 only 60.0–160.0 s").wait_for()
    page.goto(f"http://{at}/compare")
    page.get_by_label("Kept ranges").select_option("turns")
    page.wait_for_function("() => location.search.includes('range=60.0')")
    page.get_by_label("Compare, diagnose and fit on").select_option("all of the time")
    page.get_by_text("voyage_1, 300 s").wait_for(timeout=PATIENCE_MS)


def test_a_number_is_typed_undone_done_again_and_reset(watched, at):
    page = watched.page
    page.goto(f"http://{at}/vessel")
    mass = page.get_by_role("textbox", name="m11 [kg]")
    mass.wait_for(timeout=PATIENCE_MS)
    page.wait_for_timeout(SETTLE_MS)
    mass.fill("55")
    mass.press("Enter")
    page.get_by_text("as given → m11 changed").wait_for()
    page.get_by_role("button", name="Undo").click()
    watched.until_none(lambda: mass.input_value() != "42")
    page.get_by_role("button", name="Redo").click()
    page.get_by_role("button", name="Reset m11").click()
    page.get_by_text("m11 changed → m11 as given").wait_for()
    watched.shot("vessel-typed")


def test_a_recording_is_dropped_and_listed(watched, at, tmp_path):
    dropped = tmp_path / "my trip.tlog"
    dropped.write_bytes((ROOT / "recordings/otter_piece.tlog").read_bytes())
    page = watched.page
    page.goto(f"http://{at}/recordings")
    page.locator("input[type=file]").first.set_input_files(dropped)
    page.get_by_text("my trip.tlog is here").wait_for()
    page.get_by_role("button", name="Report from my trip.tlog alone").wait_for()
    watched.shot("dropped")


def test_signals_are_searched_plotted_and_derived(watched, at):
    page = watched.page
    page.goto(f"http://{at}/signals")
    page.get_by_label("Search for a field").wait_for(timeout=PATIENCE_MS)
    page.get_by_text(re.compile(r"^\d+ of \d+ fields")).wait_for(timeout=PATIENCE_MS)
    page.get_by_label("Search for a field").press_sequentially("att yaw")
    page.get_by_text(re.compile(r"^2 of \d+ fields")).wait_for()
    page.get_by_role("button", name="ATTITUDE.yaw", exact=True).click()
    page.get_by_role("button", name="Onto the plot").click()
    page.get_by_role("heading", name="Plot 1").wait_for(timeout=PATIENCE_MS)
    watched.until_none(lambda: page.evaluate(LINES) != [["ATTITUDE.yaw"]])
    drag_onto(page, "ATTITUDE.yawspeed", ".drop-0")
    watched.until_none(lambda: page.evaluate(LINES) != [["ATTITUDE.yaw", "ATTITUDE.yawspeed"]])
    drag_onto(page, "ATTITUDE.yawspeed", ".drop-new")
    page.get_by_role("heading", name="Plot 2").wait_for(timeout=PATIENCE_MS)
    watched.until_none(
        lambda: (
            page.evaluate(LINES) != [["ATTITUDE.yaw", "ATTITUDE.yawspeed"], ["ATTITUDE.yawspeed"]]
        )
    )
    page.get_by_label("Name of a derived signal").fill("yaw_deg")
    page.get_by_label("Expression").fill("deg(ATTITUDE.yaw)")
    page.get_by_label("Expression").press("Tab")
    page.get_by_role("button", name="Derive").click()
    page.get_by_text("yaw_deg = deg(ATTITUDE.yaw)").wait_for(timeout=PATIENCE_MS)
    watched.shot("signals")


def drag_onto(page, field: str, target: str) -> None:
    """A field onto a part of the page: the drag begins before the page is scrolled to the part."""
    page.get_by_role("button", name=field).hover()
    page.mouse.down()
    page.mouse.move(5, 5, steps=3)
    page.locator(target).hover()
    page.locator(target).hover()
    page.mouse.up()


# Names of the lines of each plot that has data, from top to bottom, asked of Bokeh itself.
LINES = """() => Bokeh.documents.flatMap(d => d.roots()).flatMap(r => [...r.references()])
    .filter(m => m.type === "Figure").map(f => f.renderers.filter(
        r => r.glyph && r.glyph.type === "Line" && r.name && (r.data_source.data.x || []).length)
        .map(r => r.name)).filter(names => names.length).sort((a, b) => b.length - a.length)"""


@pytest.mark.parametrize("name", MANY_PAGES)
def test_axe_finds_nothing_wrong_on_a_page(browser, at, name):
    for scheme in ("light", "dark"):
        context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme=scheme)
        page = context.new_page()
        page.goto(f"http://{at}/{name}", timeout=PATIENCE_MS)
        page.locator("main h1").first.wait_for(timeout=PATIENCE_MS)
        page.locator("html:not([data-lost])").wait_for(timeout=PATIENCE_MS)
        page.wait_for_timeout(SETTLE_MS)
        found: list[dict[str, Any]] = axe_api.Axe().run(page).response["violations"]
        wrong = [f"{v['id']}: {v['nodes'][0]['html'][:200]}" for v in found]
        context.close()
        assert wrong == [], (scheme, wrong)
