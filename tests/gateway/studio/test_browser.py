"""The five steps by mouse, in a real browser; the report without a network; a live boat."""

import re
import socket
import time
from base64 import b64decode
from pathlib import Path
from urllib.request import urlopen

import pytest

from gateway.figures.html_report import GLOSSARY
from gateway.vessel_file import load_vessel
from tests.gateway.studio.browser import FLAGS, PATIENCE_MS, ROOT, Watched, chromium, running

pytestmark = pytest.mark.alone

sync_api = pytest.importorskip("playwright.sync_api")
WAM_V = "configs/vessels/wam-v.toml"
LIVE_S = 60.0
A_WHILE = 400_000  # ms, for a diagnosis on a slow machine


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@pytest.fixture(scope="module")
def browser():
    where = chromium()
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=where, args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def zenoh_port():
    return free_port()


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("out")


@pytest.fixture(scope="module")
def studio(out, zenoh_port, tmp_path_factory):
    """The studio on the demo recordings; host:port and its log."""
    port, log = free_port(), tmp_path_factory.mktemp("log") / "studio.log"
    connect = f"tcp/127.0.0.1:{zenoh_port}"
    command = (
        "studio",
        "--no-browser",
        "--port",
        str(port),
        "--out",
        str(out),
        "--connect",
        connect,
    )
    with running(*command, until="studio:", log=log):
        yield f"127.0.0.1:{port}", log


@pytest.fixture
def watched(browser, studio):
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    page = Watched(context.new_page(), studio[0])
    yield page
    context.close()
    page.is_clean()
    assert "Traceback" not in studio[1].read_text()


def go(watched: Watched, studio: tuple[str, Path], name: str) -> None:
    watched.page.goto(f"http://{studio[0]}/{name}")


# What the page says of a vessel, right or wrong: tests share one studio and leave it as they like.
COMPARED = re.compile("no more than noise|times what noise alone would show")


def compare(watched: Watched, studio: tuple[str, Path]) -> None:
    """The page of comparisons, once it has said how right the vessel is."""
    go(watched, studio, "compare")
    watched.page.get_by_text(COMPARED).first.wait_for(timeout=PATIENCE_MS)


def test_compare_says_what_is_wrong_and_a_click_marks_where(watched, studio):
    compare(watched, studio)
    page = watched.page
    page.get_by_role("button", name=re.compile(r"^speed .* squared error")).first.click()
    page.wait_for_function(MARKED, timeout=PATIENCE_MS)
    watched.shot("compare")


# How many bands of time are marked on the page, asked of Bokeh itself.
MARKED = """() => Bokeh.documents.some(d => [...d._all_models.values()].some(
    m => m.type === "ColumnDataSource" && !m.data.y0 && (m.data.x0 || []).length > 0))"""


def test_dragging_along_the_time_axis_marks_the_track(watched, studio):
    compare(watched, studio)
    page = watched.page
    end = time.monotonic() + PATIENCE_MS / 1000.0
    while not page.evaluate(MARKED):  # a picture that is still being laid out moves below the mouse
        assert time.monotonic() < end
        drag(page)
        page.wait_for_timeout(2000)
    watched.shot("compare-brushed")


def drag(page) -> None:
    """Along the time axis of the first picture, wherever it is by now."""
    figure = page.locator(".bk-Figure").first
    figure.scroll_into_view_if_needed()
    box = figure.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 300, y)
    page.mouse.down()
    page.mouse.move(box["x"] + 500, y, steps=5)
    page.mouse.up()


def test_find_add_see_the_ladder_fall_save_and_load_what_was_saved(watched, studio, out):
    go(watched, studio, "diagnose")
    page = watched.page
    page.get_by_role("button", name="Find what is missing").click()
    page.get_by_role("button", name="Cancel").wait_for(timeout=PATIENCE_MS)
    watched.shot("diagnose-under-way")
    says = re.compile(r"The compass reads \d+\.\d° too far to (port|starboard) \(")
    page.get_by_role("heading", name=says).first.wait_for(timeout=A_WHILE)
    assert len(climbed(page, 1)) == 1
    page.get_by_role("button", name="Add", exact=True).first.click()
    page.get_by_text("In the vessel now: heading offset").wait_for()
    page.get_by_text("a recording it never saw").wait_for()
    errors = climbed(page, 3)
    assert errors[-1] < 0.3 * errors[0]
    watched.shot("diagnose")
    rivals(watched, errors)
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("In the vessel now").wait_for(state="detached")
    page.get_by_role("button", name="Add", exact=True).first.click()
    page.get_by_text("In the vessel now").wait_for()
    page.get_by_label("Save the vessel as").fill("found.toml")
    page.get_by_label("Save the vessel as").press("Tab")
    page.get_by_role("button", name="Save vessel file").click()
    page.get_by_text("saved:").wait_for()
    saved = load_vessel(out / "found.toml")
    assert [added.effect.name for added in saved.effects] == ["heading_offset"]
    again(watched, studio)


def rivals(watched: Watched, errors: list[float]) -> None:
    """What was ranked shows its evidence and takes the place of the chosen one; undo, and back."""
    page = watched.page
    page.get_by_role("heading", name="Ranked, but not chosen").wait_for()
    explained(watched)
    page.get_by_role("button", name="Instead", exact=True).first.click()
    page.get_by_text("In the vessel now: heading offset").wait_for(state="detached")
    page.wait_for_function(f"() => ({LADDER})().some(b => b.length === 3 && b[2] !== {errors[2]})")
    found = page.evaluate(LADDER)  # the picture before may not be gone yet
    other = next(bars for bars in found if len(bars) == 3 and bars[2] != errors[2])
    assert other[:2] == errors[:2]
    assert errors[2] < other[2] < errors[0]  # its own fitted numbers, not those of the chosen one
    watched.shot("diagnose-rival")
    page.get_by_role("button", name="Undo").click()
    page.get_by_text("In the vessel now: heading offset").wait_for()


def climbed(page, count: int) -> list[float]:
    """Heights of the ladder's bars once there are so many, asked of Bokeh itself."""
    page.wait_for_function(f"() => ({LADDER})().some(bars => bars.length === {count})")
    return next(bars for bars in page.evaluate(LADDER) if len(bars) == count)


LADDER = """() => Bokeh.documents.flatMap(d => [...d._all_models.values()])
    .filter(m => m.type === "ColumnDataSource" && m.data.left && m.data.y && m.data.y.length < 6)
    .map(m => Array.from(m.data.y))"""


def again(watched: Watched, studio: tuple[str, Path]) -> None:
    """The saved file as the vessel to begin with: on both recordings no more than noise."""
    go(watched, studio, "recordings")
    page = watched.page
    page.get_by_label("Vessel file").select_option("found.toml")
    page.get_by_role("button", name="Work on these").click()
    page.get_by_text("working on").wait_for()
    watched.shot("recordings")
    go(watched, studio, "compare")
    page.get_by_text("no more than noise").nth(1).wait_for(timeout=PATIENCE_MS)


def test_a_slider_moves_and_the_comparison_follows(watched, studio):
    go(watched, studio, "vessel")
    page = watched.page
    page.get_by_text("error now").wait_for(timeout=PATIENCE_MS)
    page.wait_for_timeout(1500)
    before = page.locator("td").all_inner_texts()
    handle = page.locator(".noUi-handle").first
    handle.focus()
    for _ in range(8):
        handle.press("PageUp")
    page.get_by_text("m11 changed").wait_for(timeout=PATIENCE_MS)
    watched.until_none(lambda: page.locator("td").all_inner_texts() == before)
    watched.shot("vessel")


def test_every_control_can_be_reached_by_keyboard(watched, studio):
    go(watched, studio, "diagnose")
    page = watched.page
    page.get_by_role("button", name="Find what is missing").wait_for()
    page.wait_for_timeout(1000)
    seen = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        seen.add(page.evaluate(FOCUSED))
    wanted = {"Skip to the page", "Compare", "Vessel", "Light / dark", "Find what is missing",
              "Save vessel file"}  # fmt: skip
    assert wanted <= seen


# Text of what has the focus, through all shadow roots.
FOCUSED = """() => { let e = document.activeElement;
    while (e && e.shadowRoot && e.shadowRoot.activeElement) e = e.shadowRoot.activeElement;
    return e ? e.innerText.trim() : ""; }"""


@pytest.mark.parametrize("name", ["compare", "diagnose", "vessel", "live", "recordings"])
def test_every_word_that_needs_it_is_explained_on_its_page(watched, studio, name):
    go(watched, studio, name)
    watched.page.wait_for_timeout(4000)
    explained(watched)


def explained(watched: Watched) -> None:
    """Every word is; a page whose parts are still coming gets the time for it."""
    watched.until_none(lambda: unexplained(watched.page.evaluate(TEXT)))


def unexplained(told: dict) -> list[str]:
    """Words that can be read and are not explained."""
    text = told["text"].lower()
    read = [term for term in GLOSSARY if re.search(rf"\b{re.escape(term.lower())}\b", text)]
    return [term for term in read if term not in told["explained"]]


# What can be read on the page, axes of pictures included, and the words that are explained.
TEXT = """() => { const text = [], explained = [];
    const walk = n => {
        if (n.nodeType === 3) { text.push(n.textContent); return; }
        if (n.nodeType !== 1 || ["STYLE", "SCRIPT", "PRE", "CODE"].includes(n.tagName)) return;
        if (n.classList.contains("word")) { explained.push(n.dataset.term); return; }
        [...(n.shadowRoot ? n.shadowRoot.childNodes : []), ...n.childNodes].forEach(walk); };
    walk(document.querySelector("main"));
    for (const d of Bokeh.documents) for (const m of d._all_models.values())
        if (m.axis_label) text.push(m.axis_label);
    return {text: text.join(" "), explained}; }"""


def test_a_tooltip_shows_at_the_keyboards_focus_within_the_page_and_escape_takes_it_away(
    browser, studio
):
    for width in (1280, 390):
        context = browser.new_context(viewport={"width": width, "height": 850})
        watched = Watched(context.new_page(), studio[0])
        compare(watched, studio)
        page, tip = watched.page, watched.page.locator("#tip")
        seen = {}
        for _ in range(30):
            page.keyboard.press("Tab")
            term = page.evaluate(TERM)
            assert tip.is_visible() == (term is not None)
            if term is not None:
                seen[term] = tip.inner_text()
                box = tip.bounding_box()
                assert box["x"] >= 0.0
                assert box["x"] + box["width"] <= width
                assert 0.0 <= box["y"] <= 850.0 - box["height"]
                if term == "noise floor":
                    watched.shot(f"tooltip-{width}")
        assert {"nrmse", "noise floor", "95 % interval", "sway v"} <= set(seen)
        assert seen == {term: GLOSSARY[term] for term in seen}
        page.locator(".word").first.focus()
        assert tip.is_visible()
        page.keyboard.press("Escape")
        assert not tip.is_visible()
        page.locator(".word").first.hover()
        assert tip.is_visible()
        watched.is_clean()
        context.close()


# Which word of the glossary has the focus.
TERM = """() => { let e = document.activeElement;
    while (e && e.shadowRoot && e.shadowRoot.activeElement) e = e.shadowRoot.activeElement;
    return e && e.dataset.term || null; }"""


def test_a_map_is_asked_for_only_when_it_is_switched_on(browser, studio):
    """Tiles are answered here, so that no network is needed; anything else would be noticed."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    watched = Watched(context.new_page(), studio[0])
    page = watched.page
    page.route(lambda url: studio[0] not in url, lambda route: route.fulfill(body=GREY))
    compare(watched, studio)
    page.wait_for_timeout(3000)
    watched.is_clean()
    mapped(watched, "compare-map")
    page.get_by_label(MAP).uncheck()
    page.wait_for_timeout(2000)
    watched.beyond.clear()
    page.wait_for_timeout(2000)
    watched.is_clean()
    context.close()


def test_where_no_picture_of_the_map_can_be_had_it_says_so(browser, studio):
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    page = context.new_page()
    page.route(lambda url: studio[0] not in url, lambda route: route.abort())
    watched = Watched(page, studio[0])
    compare(watched, studio)
    word = page.get_by_text("No picture of the map could be had")
    assert not word.is_visible()
    page.get_by_label(MAP).check()
    word.wait_for()
    page.get_by_label(MAP).uncheck()
    word.wait_for(state="hidden")
    context.close()


MAP = "Map, asked of tile.openstreetmap.org"


def mapped(watched: Watched, shot: str) -> None:
    """The box is ticked: pictures of the map are asked for, and nothing else."""
    page = watched.page
    assert not page.get_by_label(MAP).is_checked()
    page.get_by_label(MAP).check()
    page.get_by_text("OpenStreetMap contributors").wait_for()
    page.wait_for_timeout(3000)
    watched.shot(shot)
    asked, watched.beyond = watched.beyond, []
    assert asked
    for url in asked:
        assert re.fullmatch(r"https://tile\.openstreetmap\.org/\d+/\d+/\d+\.png", url), url


# A grey picture of one pixel.
GREY = b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNYBQAArACrZgvkawAAAABJRU5ErkJggg=="
)


@pytest.mark.parametrize("name", ["compare", "diagnose", "vessel", "live", "recordings"])
def test_dark_pages_and_narrow_pages_fit(browser, studio, name):
    for scheme, width in (("dark", 1280), ("light", 390)):
        context = browser.new_context(viewport={"width": width, "height": 850}, color_scheme=scheme)
        page = Watched(context.new_page(), studio[0])
        go(page, studio, name)
        themed(page, scheme)
        page.page.wait_for_timeout(3000)
        wide = page.page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width + 40
        bar = page.page.locator("header.bar").bounding_box()
        assert bar is not None
        assert bar["height"] < 150.0  # names of pages side by side, not one below the other
        page.shot(f"{name}-{scheme}-{width}")
        page.is_clean()
        context.close()


def test_on_the_first_visit_with_a_dark_system_nothing_light_is_shown(browser, studio):
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="dark")
    context.add_init_script(LIGHTS)
    watched, seen = Watched(context.new_page(), studio[0]), []
    watched.page.on("console", lambda message: seen.append(message.text))
    go(watched, studio, "recordings")
    themed(watched, "dark")
    watched.page.get_by_role("heading", name="What to work on").wait_for()
    assert "dark frame" in seen
    assert "light frame" not in seen
    watched.is_clean()
    context.close()


def themed(watched: Watched, theme: str) -> None:
    """The page stands in this theme."""
    root = sync_api.expect(watched.page.locator("html"))
    root.to_have_attribute("data-theme", theme, timeout=PATIENCE_MS)


@pytest.mark.parametrize(("lost", "theme", "asked"), [(2, "dark", 3), (99, "light", 6)])
def test_a_theme_that_the_server_was_not_told_is_told_again(browser, studio, lost, theme, asked):
    """A first visit in dark whose cookie comes late, or never; the page was light for ever."""
    context, made = browser.new_context(color_scheme="dark"), []
    watched = Watched(context.new_page(), studio[0])

    def page_asked(route) -> None:
        made.append(route.request.url)
        if len(made) > lost:
            route.continue_()
        else:
            with urlopen(route.request.url) as without_cookies:
                route.fulfill(body=without_cookies.read(), content_type="text/html")

    watched.page.route(f"http://{studio[0]}/recordings", page_asked)
    go(watched, studio, "recordings")
    watched.until_none(lambda: len(made) < asked)
    watched.page.wait_for_timeout(3000)
    themed(watched, theme)
    assert len(made) == asked
    watched.page.get_by_role("heading", name="What to work on").wait_for()
    watched.is_clean()
    context.close()


def test_a_browser_that_keeps_no_cookies_is_shown_the_page_once(browser, studio):
    """It was asked for again and again where the system is dark."""
    context, made = browser.new_context(color_scheme="dark"), []
    context.add_init_script(NOTHING_KEPT)
    watched = Watched(context.new_page(), studio[0])
    watched.page.on(
        "request", lambda one: made.append(one.url) if one.is_navigation_request() else None
    )
    go(watched, studio, "recordings")
    watched.page.get_by_role("heading", name="What to work on").wait_for()
    watched.page.wait_for_timeout(1000)
    assert len(made) == 1
    themed(watched, "light")
    watched.is_clean()
    context.close()


NOTHING_KEPT = """
Object.defineProperty(document, "cookie", {get: () => "", set: () => {}});
Object.defineProperty(window, "sessionStorage", {get: () => { throw new Error("denied"); }});
"""


# Says of each frame that is drawn whether something light is to be seen on it.
LIGHTS = """const look = () => {
    if (document.body && getComputedStyle(document.body).visibility === "visible")
        console.log(`${document.documentElement.dataset.theme} frame`);
    requestAnimationFrame(look); };
requestAnimationFrame(look);"""


def test_a_streaming_boat_is_followed(watched, studio, zenoh_port, tmp_path):
    config = tmp_path / "gateway.toml"
    config.write_text(f'[zenoh]\nendpoint = "tcp/127.0.0.1:{zenoh_port}"\n')
    udp = free_port()
    listen = ("live", f"udpin:127.0.0.1:{udp}", "--vessel", WAM_V, "--no-record", "--config",
              str(config))  # fmt: skip
    play = ("simulate", "--vessel", WAM_V, "--live", f"udpout:127.0.0.1:{udp}", "--fast")
    page = watched.page
    with (
        running(*listen, until="listening", log=tmp_path / "live.log"),
        running(*play, until="playing", log=tmp_path / "play.log"),
    ):
        go(watched, studio, "live")
        page.get_by_text("● live").wait_for(timeout=PATIENCE_MS)
        page.wait_for_timeout(1000 * LIVE_S)
        rows = page.evaluate(ROWS)
        assert max(rows) > 5.0 * LIVE_S
        assert page.get_by_text("messages").first.is_visible()
        watched.shot("live")
        assert watched.beyond == []
        page.route("**/tile.openstreetmap.org/**", lambda route: route.fulfill(body=GREY))
        mapped(watched, "live-map")
        page.get_by_label(MAP).uncheck()
        page.wait_for_timeout(2000)
        watched.beyond.clear()
    page.get_by_text("○ gone").wait_for(timeout=PATIENCE_MS)


ROWS = """() => Bokeh.documents.flatMap(d => [...d._all_models.values()])
    .filter(m => m.type === "ColumnDataSource" && m.data.t).map(m => m.data.t.length)"""


def test_the_report_needs_no_network_and_no_script(browser, tmp_path):
    from gateway.offline.report import make_report

    logs = [ROOT / f"recordings/voyage_{k}.tlog" for k in (1, 2)]
    done = make_report(logs, [ROOT / "configs/vessels/demo_boat.toml"], tmp_path / "report.html")
    assert done.size_bytes < 5_000_000
    for name, width in (("wide", 1280), ("phone", 390)):
        context = browser.new_context(
            viewport={"width": width, "height": 850}, java_script_enabled=False, offline=True
        )
        page = Watched(context.new_page(), "")
        page.page.goto(done.path.as_uri())
        page.page.wait_for_timeout(500)
        assert page.page.get_by_text("Something is wrong with Grebe").is_visible()
        page.shot(f"report-{name}")
        page.is_clean()
        context.close()
