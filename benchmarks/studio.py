"""What the studio costs, in a real browser: `python -m benchmarks.studio [read] [live] [beside]`.

    read    recordings of ten minutes and of an hour at 50 Hz: seconds from the click on "Work on
            these" to the first picture of the motion on the page Compare (aims: 5 s and 10 s), to
            the whole comparison, and to the picture on a page that is opened later; seconds from
            the command to the server's first line (aim: 3 s)
    live    CPU of the studio's process over wall time while three boats stream at 20 Hz and a
            browser shows them ten times a second; aim: below 40 % of one core
    beside  a live shadow while the studio diagnoses on the same machine: rows per second and how
            late they are, beside a bare relay, and the same without a studio

Without a word all three, written to benchmarks/results/studio.md. CPU is what a process used, so
that a busy machine does not count; what a user sees is wall time: the load is written beside it.
"""

import math
import os
import platform
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import date
from pathlib import Path
from socket import SOCK_STREAM
from typing import Any, NamedTuple

import orjson

from benchmarks.live_latency import Percentiles, cpu_s, free_port, one_run, program
from benchmarks.replay import VESSEL, voyage
from gateway.bus import Bus, BusSettings, open_session
from gateway.topics import TOPICS, FieldType

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/studio.md"
CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
PATIENCE_MS = 600_000
BOATS, RATE_HZ, SETTLE_S, SECONDS = 3, 20.0, 8.0, 30.0
BESIDE_S = 25.0
AIM_SHARE = 0.40
LENGTHS = {"ten minutes": (1.0 / 6.0, 5.0), "an hour": (1.0, 10.0)}  # hours, and the aim [s]

STUDIO = "from gateway.cli import run; run()"
COMPARED = re.compile("no more than noise|times what noise alone would show|cannot judge")
DRAWN = """() => Bokeh.documents.some(d => d.is_idle && [...d._all_models.values()]
    .some(m => m.type === "ColumnDataSource" && m.data.x && m.data.x.length > 1000))"""
SHOWN = """() => Math.max(...Bokeh.documents.flatMap(d => [...d._all_models.values()])
    .filter(m => m.type === "ColumnDataSource" && m.data.t).map(m => m.data.t.length))"""


class Studio:
    """A studio that runs."""

    def __init__(self, process: Any, port: int) -> None:
        self._process = process
        self.at = f"http://127.0.0.1:{port}"

    def cpu_s(self) -> float:
        """CPU that its process has used so far [s], without that of its workers."""
        return cpu_s(self._process.pid)


@contextmanager
def studio(*words: str) -> Iterator[Studio]:
    """`shadow studio WORDS` while inside."""
    port = free_port(SOCK_STREAM)
    with tempfile.TemporaryDirectory() as out:
        command = ["studio", *words, "--no-browser", "--port", str(port), "--out", out]
        heard: list[str] = []
        with program([STUDIO, *command], "studio:", heard) as process:
            yield Studio(process, port)


@contextmanager
def page() -> Iterator[Any]:
    """A page of a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        opened = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
        opened.set_default_timeout(PATIENCE_MS)
        yield opened
        browser.close()


class Reading(NamedTuple):
    """Seconds: to start; from the click to the first picture and to the comparison; on a page
    opened later; of the server's own CPU until the comparison."""

    start: float
    first: float
    whole: float
    again: float
    cpu: float


def reading(hours: float) -> Reading:
    """A recording that is chosen on one page while another shows Compare."""
    with ExitStack() as scope:
        folder = Path(scope.enter_context(tempfile.TemporaryDirectory()))
        log = voyage(folder, hours)
        seen = scope.enter_context(page())
        begun = time.time()
        words = ("--folder", str(folder), "--vessel", str(VESSEL))
        one = scope.enter_context(studio(*words))
        start = time.time() - begun
        seen.goto(f"{one.at}/compare")
        seen.get_by_text("Choose a recording").wait_for()
        choice = seen.context.new_page()
        choice.goto(f"{one.at}/recordings")
        choice.get_by_label(log.name).check(timeout=PATIENCE_MS)
        choice.wait_for_timeout(SETTLE_S * 1000.0)  # its card is being read, as it would be
        before, clicked = one.cpu_s(), time.time()
        choice.get_by_role("button", name="Work on these").click()
        seen.wait_for_function(DRAWN)
        first = time.time() - clicked
        seen.get_by_text(COMPARED).first.wait_for()
        whole, cpu = time.time() - clicked, one.cpu_s() - before
        seen.goto("about:blank")
        opened = time.time()
        seen.goto(f"{one.at}/compare")
        seen.wait_for_function(DRAWN)
        return Reading(start, first, whole, time.time() - opened, cpu)


def message(topic: str, t: float, boat: int) -> dict[str, object]:
    """A boat on a circle of its own."""
    kinds = {FieldType.NUMBER: 0.1, FieldType.INTEGER: 0, FieldType.STRING: "measured"}
    values: dict[str, object] = {f.name: kinds[f.type] for f in TOPICS[topic].all_fields}
    now = time.time_ns()
    values |= {"vehicle_time_ns": now, "receive_time_ns": now}
    if "unfit" in values:
        values["unfit"] = ""
    if "east_m" in values:
        east, north = 20.0 * math.cos(0.1 * t) + 60.0 * boat, 20.0 * math.sin(0.1 * t)
        values |= {"east_m": east, "north_m": north, "yaw_rad": 0.1 * t,
                   "surge_mps": 2.0 + 0.1 * math.sin(t)}  # fmt: skip
    return values


def stream(buses: list[Bus], seconds: float, stop: threading.Event | None = None) -> None:
    """All boats at the rate, for so long, or until `stop`."""
    begun, stop = time.monotonic(), stop or threading.Event()
    while (t := time.monotonic() - begun) < seconds and not stop.is_set():
        for boat, bus in enumerate(buses):
            for topic in ("measured", "reference", "shadow", "residual", "health", "position"):
                bus.publish(topic, orjson.dumps(message(topic, t, boat)))
        time.sleep(1.0 / RATE_HZ)


def live() -> float:
    """CPU of the studio over wall time while it shows three boats."""
    endpoint = f"tcp/127.0.0.1:{free_port(SOCK_STREAM)}"
    with ExitStack() as scope:
        session = scope.enter_context(open_session(BusSettings(endpoint)))
        buses = [scope.enter_context(Bus(f"boat-{k}", session=session)) for k in range(BOATS)]
        folder = scope.enter_context(tempfile.TemporaryDirectory())
        one = scope.enter_context(studio("--folder", folder, "--connect", endpoint))
        seen = scope.enter_context(page())
        seen.goto(f"{one.at}/live")
        stream(buses, SETTLE_S)
        before, begun = one.cpu_s(), time.monotonic()
        stream(buses, SECONDS)
        share = (one.cpu_s() - before) / (time.monotonic() - begun)
        if seen.evaluate(SHOWN) < 8.0 * SECONDS:
            raise RuntimeError("the page did not show the boats ten times a second")
        return share


class Beside(NamedTuple):
    """The relay and the shadow, alone and while the studio diagnoses."""

    alone: tuple[Percentiles, Percentiles]
    diagnosing: tuple[Percentiles, Percentiles]


def beside() -> Beside:
    """A live shadow alone, then beside a diagnosis that never ends before it."""
    alone = one_run(1, BESIDE_S)
    stop = threading.Event()
    ready = threading.Event()
    thread = threading.Thread(target=diagnose_until, args=(stop, ready))
    thread.start()
    try:
        if not ready.wait(PATIENCE_MS / 1000.0):
            raise RuntimeError("the studio did not begin to diagnose")
        return Beside(alone, one_run(1, BESIDE_S))
    finally:
        stop.set()
        thread.join()


def diagnose_until(stop: threading.Event, ready: threading.Event) -> None:
    """The studio in a browser: find what is missing, again and again."""
    with studio() as one, page() as seen:
        seen.goto(f"{one.at}/diagnose")
        button = seen.get_by_role("button", name="Find what is missing")
        cancel = seen.get_by_role("button", name="Cancel")
        seen.get_by_text("Press “Find").wait_for()
        while not stop.is_set():
            if not cancel.is_visible() and button.is_enabled():
                button.click()
                cancel.wait_for()
            ready.set()
            seen.wait_for_timeout(500)


def told_read() -> str:
    """The first figures as a table."""
    heads = ("a recording of", "first picture s", "aim", "compared s", "opened anew s",
             "server's CPU s", "server started s (aim 3)")  # fmt: skip
    rows = [f"| {' | '.join(heads)} |", "|---|---|---|---|---|---|---|"]
    for name, (hours, aim) in LENGTHS.items():
        r = reading(hours)
        rows.append(f"| {name} at 50 Hz | **{r.first:.1f}** | {aim:g} | {r.whole:.1f} "
                    f"| {r.again:.1f} | {r.cpu:.1f} | {r.start:.1f} |")  # fmt: skip
    return "From the click on *Work on these*, in the browser:\n\n" + "\n".join(rows)


def told_live() -> str:
    """The second."""
    return (
        f"{BOATS} boats at {RATE_HZ:g} Hz on the Live page, shown ten times a second: "
        f"**{100.0 * live():.0f} %** of one core. Aim: below {100.0 * AIM_SHARE:.0f} %."
    )


def told_beside() -> str:
    """The third, as a table."""
    found = beside()
    rows = ["| | rows per s | p50 ms | p99 ms | worst ms | never came |",
            "|---|---|---|---|---|---|"]  # fmt: skip
    for when, (relay, shadow) in (("alone", found.alone), ("diagnosing", found.diagnosing)):
        for who, p in (("bare relay", relay), ("live shadow", shadow)):
            rows.append(f"| {who}, {when} | {p.rate:.1f} | {p.p50:.1f} | {p.p99:.1f} | "
                        f"{p.worst:.0f} | {p.lost} |")  # fmt: skip
    return "A live shadow of a boat at 50 Hz beside a studio that diagnoses:\n\n" + "\n".join(rows)


PARTS: dict[str, Callable[[], str]] = {"read": told_read, "live": told_live, "beside": told_beside}


def main() -> None:
    """Those that were asked for; all of them go into the results."""
    names = sys.argv[1:] or list(PARTS)
    told = []
    for name in names:
        before = os.getloadavg()[0]
        says = PARTS[name]()
        told.append(f"{says}\n\n(Load of the machine before and after: {before:.1f}, "
                    f"{os.getloadavg()[0]:.1f}.)")  # fmt: skip
        print(f"{told[-1]}\n", flush=True)
    if names == list(PARTS):
        where = f"{os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}"
        head = f"# What the studio costs\n\n`python -m benchmarks.studio`; {where}.\n\n"
        RESULTS.write_text(head + "\n\n".join(told) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
