"""A server that ends, two windows, reloads: in a real browser nothing goes on looking well."""

import re
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from urllib.parse import urlparse

import pytest

from tests.gateway.studio.browser import FLAGS, PATIENCE_MS, Watched, chromium, running
from tests.gateway.studio.test_serve import free_port

pytestmark = pytest.mark.alone

sync_api = pytest.importorskip("playwright.sync_api")
NOTICED_S = 3.0
# What the browser and Bokeh say on the console of a page whose server has ended; at no other time.
# A request that is under way when the server is killed is reset or stays without an answer.
GONE = re.compile("ERR_CONNECTION_(REFUSED|RESET)|ERR_EMPTY_RESPONSE|not connected so cannot send")
COMPARED = re.compile("no more than noise|times what noise alone would show")
# What is marked on the page, asked of Bokeh itself.
MARKS = """() => Bokeh.documents.flatMap(d => [...d._all_models.values()])
    .filter(m => m.type === "ColumnDataSource" && m.data.x0 && m.data.x1 && !m.data.y0)
    .map(m => [Array.from(m.data.x0), Array.from(m.data.x1)])"""
# Ends of the time axes of lines that hold points.
AXES = """() => Bokeh.documents.flatMap(d => [...d._all_models.values()])
    .filter(m => m.type === "Range1d" && m.bounds && m.min_interval).map(m => m.bounds)"""

# Each time at which the page begins to say that its server is lost [s, Unix], and what it says;
# installed with each load, for a page may begin anew.
STAMPED = """addEventListener("DOMContentLoaded", () => {
    window.shown = []; const bar = document.getElementById("lost");
    if (!bar) return;  // the blank page before the first
    new MutationObserver(() => { if (!bar.hidden) shown.push([Date.now() / 1000, bar.innerText]); })
        .observe(bar, {attributes: true, childList: true, characterData: true, subtree: true});
})"""

OPACITY = "getComputedStyle(document.querySelector('main')).opacity"


@pytest.fixture(scope="module")
def browser():
    where = chromium()
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=where, args=list(FLAGS))
        yield opened
        opened.close()


@contextmanager
def studio(port: int, folder, name: str) -> Iterator:
    command = ("studio", "--no-browser", "--port", str(port), "--out", str(folder), "--connect",
               "tcp/127.0.0.1:1")  # fmt: skip
    with running(*command, until="studio:", log=folder / f"{name}.log") as process:
        yield process


@contextmanager
def window(browser, port: int, path: str = "") -> Iterator[Watched]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="light")
    one = Watched(context.new_page(), f"127.0.0.1:{port}")
    one.page.add_init_script(STAMPED)
    one.page.goto(f"http://127.0.0.1:{port}/{path}")
    yield one
    context.close()


def compared(one: Watched) -> None:
    one.page.get_by_text(COMPARED).nth(1).wait_for(timeout=PATIENCE_MS)


PAGES = ("compare", "diagnose", "vessel", "live", "recordings")


def test_every_page_notices_a_server_that_stands_still_or_is_gone(browser, tmp_path):
    port = free_port()
    with studio(port, tmp_path, "first") as server, ExitStack() as scope:
        every = [scope.enter_context(window(browser, port, name)) for name in PAGES]
        for one in every:
            one.page.locator("main h1, main h2").first.wait_for()
        every[0].page.wait_for_timeout(3000)
        for one in every:
            one.page.locator("#lost").wait_for(state="hidden")
            one.is_clean()
        server.send_signal(signal.SIGSTOP)
        noticed(every, "does not answer")
        server.send_signal(signal.SIGCONT)
        for one in every:
            one.page.locator("#lost").wait_for(state="hidden")
            one.is_clean()
        server.kill()
        noticed(every, "has ended")
        every[0].page.wait_for_timeout(400)
        assert all(float(one.page.evaluate(OPACITY)) < 0.5 for one in every)
        every[0].shot("server-gone")
        with studio(port, tmp_path, "second"):
            for one in every:
                one.page.locator("#lost").wait_for(state="hidden")
                one.wrong = [text for text in one.wrong if not GONE.search(text)]
            every[3].page.get_by_text("Nobody publishes").wait_for()
            for one in every:
                one.is_clean()


def noticed(every: list[Watched], text: str) -> None:
    """Every page says it within the time that was promised, by the clock of the page.

    To look at five pages one after the other takes a browser seconds of its own.
    """
    began = time.time()
    for one in every:
        one.page.locator("#lost", has_text=text).wait_for(state="visible")
        shown = one.page.evaluate(
            "text => window.shown.find(([_, says]) => says.includes(text))", text
        )
        assert shown[0] - began < NOTICED_S


def test_two_windows_hold_their_own_views_and_share_the_work(browser, tmp_path):
    port = free_port()
    second = "compare?recording=voyage_2&range=40.0:70.0"
    with studio(port, tmp_path, "two"), window(browser, port) as one, \
            window(browser, port, second) as two:  # fmt: skip
        assert urlparse(one.page.url).path == "/compare"
        assert one.page.title() == "Compare – Shadow studio"
        for each in (one, two):
            compared(each)
        two.page.wait_for_function(f"() => ({MARKS})().some(m => m[0][0] === 40)")
        assert one.page.get_by_label("Recording").input_value() == "voyage_1"
        assert two.page.get_by_label("Recording").input_value() == "voyage_2"
        assert one.page.evaluate(AXES)[0][1] > two.page.evaluate(AXES)[0][1] > 200.0
        assert one.page.evaluate(MARKS)[0][0] == []
        moved(one, port)
        two.page.get_by_text("as given)").first.wait_for(timeout=PATIENCE_MS)
        one.page.get_by_role("link", name="Compare").click()
        one.page.get_by_text("as given)").first.wait_for(timeout=PATIENCE_MS)
        two.page.reload()
        two.page.get_by_text("as given)").first.wait_for(timeout=PATIENCE_MS)
        two.page.wait_for_function(f"() => ({MARKS})().some(m => m[0][0] === 40)")
        assert two.page.get_by_label("Recording").input_value() == "voyage_2"
        two.page.get_by_role("button", name="Clear the mark").click()
        two.page.wait_for_function("() => !location.search.includes('range')")
        two.page.get_by_label("Recording").select_option("voyage_1")
        two.page.wait_for_function("() => location.search.includes('voyage_1')")
        two.page.go_back()
        two.page.wait_for_function(f"() => ({MARKS})().length > 0")
        two.page.wait_for_timeout(2000)
        assert two.page.get_by_label("Recording").input_value() == "voyage_2"
        for each, name in ((one, "one"), (two, "two")):
            each.shot(f"window-{name}")
            each.is_clean()


PULL = 3  # frames of a page that asks for its document


def test_what_changes_before_a_page_says_that_it_is_there_is_shown(browser, tmp_path):
    """A busy server hears of it late; the comparison was done in between, and its figures lost."""
    port, held = free_port(), []

    def late(socket):
        server, sent = socket.connect_to_server(), []

        def from_page(frame):
            sent.append(frame)
            if len(sent) > PULL and held is not None:
                held.append((server, frame))
            else:
                server.send(frame)

        socket.on_message(from_page)

    with studio(port, tmp_path, "late"):
        page = browser.new_page()
        page.route_web_socket(re.compile("/ws"), late)
        page.goto(f"http://127.0.0.1:{port}/compare?recording=voyage_2&range=40.0:70.0")
        with window(browser, port) as one:
            compared(one)
            one.page.wait_for_timeout(3000)
            page.wait_for_timeout(100)
        waiting, held = held, None
        assert waiting
        for server, frame in waiting:
            server.send(frame)
        page.get_by_text(COMPARED).nth(1).wait_for(timeout=PATIENCE_MS)
        page.wait_for_function(f"() => ({MARKS})().some(m => m[0][0] === 40)")
        page.close()


def test_a_page_whose_first_connection_failed_begins_anew(browser, tmp_path):
    """It stayed empty for ever beside a server that answered."""
    port, refused = free_port(), []

    def refuse_the_first(socket):
        if refused:
            socket.connect_to_server()
        else:
            refused.append(socket.url)
            socket.close()

    with studio(port, tmp_path, "refused"):
        page = browser.new_page()
        page.route_web_socket(re.compile("/ws"), refuse_the_first)
        page.goto(f"http://127.0.0.1:{port}/compare")
        page.get_by_text(COMPARED).first.wait_for(timeout=PATIENCE_MS)
        page.close()
    assert refused


def moved(one: Watched, port: int) -> None:
    """An edit; choosing the same files again keeps it."""
    page = one.page
    page.get_by_role("link", name="Vessel").click()
    page.get_by_text("error now").wait_for(timeout=PATIENCE_MS)
    page.wait_for_timeout(1500)
    handle = page.locator(".noUi-handle").first
    handle.focus()
    for _ in range(8):
        handle.press("PageUp")
    page.get_by_text("m11 changed").wait_for(timeout=PATIENCE_MS)
    page.get_by_role("link", name="Recordings").click()
    page.get_by_role("button", name="Work on these").click()
    page.get_by_text("working on").wait_for()
    page.get_by_role("link", name="Vessel").click()
    page.get_by_text("m11 changed").wait_for(timeout=PATIENCE_MS)


def test_what_cannot_be_read_is_said_where_it_is_looked_for(browser, tmp_path):
    port = free_port()
    (tmp_path / "no-log.tlog").write_bytes(b"this is no recording")
    (tmp_path / "no-vessel.toml").write_text("[hull]\nlength = -1.0\n")
    log = tmp_path / "folder.log"
    command = ("studio", str(tmp_path / "no-log.tlog"), "--vessel", "configs/vessels/otter.toml",
               "--folder", str(tmp_path), "--no-browser", "--port", str(port), "--out",
               str(tmp_path / "out"))  # fmt: skip
    with running(*command, until="studio:", log=log), window(browser, port) as one:
        one.page.get_by_text("Not compared: ").wait_for(timeout=PATIENCE_MS)
        assert one.page.get_by_text("Comparing").count() == 0
        one.page.get_by_role("link", name="Recordings").click()
        one.page.get_by_text("no-vessel.toml: ").wait_for()
        one.page.get_by_text("no-log.tlog is a text file").first.wait_for()
        report = one.page.get_by_role("button", name="Report from no-log.tlog alone")
        report.scroll_into_view_if_needed()
        report.click()
        bar = one.page.locator("#messages")
        bar.get_by_text("report from no-log.tlog alone: ").wait_for(timeout=PATIENCE_MS)
        box = bar.bounding_box()
        assert box["y"] + box["height"] <= 901.0
        one.shot("unreadable")
        bar.get_by_role("button", name="Close").click()
        bar.get_by_text("report from no-log.tlog alone: ").wait_for(state="detached")
        one.is_clean()


def test_a_recording_is_played_and_every_picture_shows_the_same_moment(browser, tmp_path):
    port = free_port()
    with studio(port, tmp_path, "play") as _, window(browser, port, "compare?at=60.0") as one:
        page = one.page
        compared(one)
        page.wait_for_function(f"() => ({MOMENT})().boats === 2")
        there = page.evaluate(MOMENT)
        assert there["time"] == there["cursor"] == 60.0
        assert there["text"].startswith("60.0 s")
        page.locator("h1").first.click()
        page.keyboard.press("Space")
        page.wait_for_function(f"() => ({MOMENT})().time > 61")
        page.keyboard.press("Space")
        page.wait_for_function("() => !location.search.includes('at=60.0')")
        later = page.evaluate(MOMENT)
        page.wait_for_timeout(1000)
        assert page.evaluate(MOMENT) == later  # it stands
        assert later["cursor"] == pytest.approx(later["time"], abs=0.01)
        assert later["place"] != there["place"]
        one.shot("moment")
        figure = page.locator(".bk-Figure").first
        figure.scroll_into_view_if_needed()
        page.wait_for_timeout(500)
        box = figure.bounding_box()
        page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + box["height"] / 2)
        page.wait_for_function(f"() => ({MOMENT})().time > 200")
        one.is_clean()


# The moment that is shown, asked of Bokeh itself: slider, line on the time axes, boats, numbers.
MOMENT = """() => { const every = Bokeh.documents.flatMap(d => [...d._all_models.values()]);
    const sources = every.filter(m => m.type === "ColumnDataSource").map(m => m.data);
    const boats = sources.find(d => "colour" in d);
    const text = every.find(m => m.type === "Div" && m.text.includes("model"));
    return {time: every.find(m => m.type === "Slider").value, boats: boats.xs.length,
        place: boats.xs.length ? [boats.xs[0][0], boats.ys[0][0]] : null,
        cursor: sources.filter(d => Object.keys(d).join() === "x").map(d => d.x[0])[0],
        text: text ? text.text.replace(/<[^>]*>/g, "") : ""}; }"""
