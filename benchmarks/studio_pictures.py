"""Pictures of each page of the studio, to look at: `python -m benchmarks.studio_pictures [PAGE…]`.

Each page in four sizes and both themes, whole, into out/screenshots, with boats on the page Live;
names of pages choose some.
Beside each it prints what axe-core finds wrong for people who do not see, or do not use a mouse.
"""

import math
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from socket import SOCK_STREAM
from threading import Event, Thread
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, sync_playwright

from benchmarks.live_latency import free_port
from benchmarks.studio import BOATS, CHROMIUM, FLAGS, PATIENCE_MS, stream, studio
from gateway.bus import Bus, BusSettings, open_session
from gateway.studio.pages import known_pages

FOLDER = Path(__file__).resolve().parents[1] / "out/screenshots"
SIZES = {"phone": (390, 844), "tablet": (820, 1180), "laptop": (1280, 800), "desk": (1920, 1080)}
THEMES = ("light", "dark")
SETTLE_MS = 2500
# Laid out, of a server that answers, in the theme of the system.
THERE = """() => !document.documentElement.dataset.lost && Bokeh.documents.length
    && Bokeh.documents.every(d => d.is_idle) && document.documentElement.dataset.theme
    === (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")"""
COMPARED = "times what noise alone would show"


def violations(page: Any) -> list[str]:
    """What axe-core finds wrong on a page: rule, how often, and where it is first."""
    found = Axe().run(page).response["violations"]
    return [
        f"{each['id']} ({len(each['nodes'])}): {each['nodes'][0]['html'][:160]}" for each in found
    ]


def photograph(browser: Browser, at: str, name: str) -> list[str]:
    """A page in all sizes and themes; what is wrong with it on a laptop."""
    wrong: list[str] = []
    for theme in THEMES:
        for size, (width, height) in SIZES.items():
            context = browser.new_context(
                viewport={"width": width, "height": height}, color_scheme=theme
            )
            page = context.new_page()
            page.set_default_timeout(PATIENCE_MS)
            page.goto(f"{at}/{name}")
            page.wait_for_function(THERE)
            page.wait_for_timeout(SETTLE_MS)
            page.screenshot(path=FOLDER / f"{name}-{theme}-{size}.png", full_page=True)
            if size == "laptop":
                wrong += [f"{theme}: {text}" for text in violations(page)]
            context.close()
    return wrong


def main() -> None:
    """All pages, or those that are named."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    names = sys.argv[1:] or [entry.path for entry in known_pages()]
    endpoint = f"tcp/127.0.0.1:{free_port(SOCK_STREAM)}"
    with ExitStack() as scope:
        out = scope.enter_context(tempfile.TemporaryDirectory())
        session = scope.enter_context(open_session(BusSettings(endpoint)))
        buses = [scope.enter_context(Bus(f"boat-{k}", session=session)) for k in range(BOATS)]
        stop = Event()
        streaming = Thread(target=stream, args=(buses, math.inf, stop))
        streaming.start()
        scope.callback(streaming.join)
        scope.callback(stop.set)
        one = scope.enter_context(studio("--out", out, "--connect", endpoint))
        playwright = scope.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        first = browser.new_page()
        first.goto(f"{one.at}/compare")
        first.get_by_text(COMPARED).first.wait_for(timeout=PATIENCE_MS)
        for name in names:
            wrong = photograph(browser, one.at, name)
            print(f"{name}: {FOLDER / name}-*.png", *wrong, sep="\n  ", flush=True)
        browser.close()


if __name__ == "__main__":
    main()
