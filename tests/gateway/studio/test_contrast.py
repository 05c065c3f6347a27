"""WCAG 2.1 AA by computation: text 4.5 : 1, edges of controls and the focus ring 3 : 1."""

import re

import pytest

from gateway.figures import THEMES
from gateway.studio import page
from tests.gateway.figures.test_bokeh_draw import ratio
from tests.gateway.studio.browser import FLAGS, chromium

TEXT = [
    *((ink, ground) for ink in ("ink", "faint", "good", "warn") for ground in ("paper", "ground")),
    ("ink", "field"), ("ink", "soft"), ("accent", "paper"), ("on-accent", "accent"),
    ("paper", "ink"),  # the tooltip
]  # fmt: skip
EDGES = [(one, ground) for one in ("edge", "accent") for ground in ("paper", "ground", "field")]


def themes() -> dict[str, dict[str, str]]:
    """Name of a theme -> name of a colour -> its value, as the page has them."""
    found = re.findall(r":root(?:\[data-theme=\"(\w+)\"\])? \{([^}]*)\}", page.TEMPLATE)
    plain = dict(found)
    colours = {name: dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", css)) for name, css in found}
    assert set(plain) == {"", "dark"}
    return {"light": colours[""], "dark": colours[""] | colours["dark"]}


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_is_read_and_controls_are_seen(theme):
    colours = themes()[theme]
    for ink, ground in TEXT:
        assert ratio(colours[ink], colours[ground]) >= 4.5, (ink, ground)
    for edge, ground in EDGES:
        assert ratio(colours[edge], colours[ground]) >= 3.0, (edge, ground)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_figures_lie_on_the_paper_of_the_page(theme):
    colours, drawn = themes()[theme], THEMES[theme]
    assert (drawn.paper.lower(), drawn.ink.lower()) == (colours["paper"], colours["ink"])
    assert drawn.faint.lower() == colours["faint"]


def test_no_colour_is_used_that_is_not_in_the_palette():
    """Whatever stands outside it would escape the test above."""
    rules = re.sub(r":root.*?\}", "", page.TEMPLATE, flags=re.DOTALL)
    assert re.findall(r"#[0-9a-fA-F]{6}\b|#[0-9a-fA-F]{3}\b", rules + page.STYLE) == []
    used = set(re.findall(r"var\(--([\w-]+)\)", rules + page.STYLE)) - {"font"}
    assert used <= set(themes()["light"])


HUES = """element => ["color", "backgroundColor"].map(name => "#" + getComputedStyle(element)[name]
    .match(/\\d+/g).slice(0, 3).map(part => (+part).toString(16).padStart(2, "0")).join(""))"""


@pytest.mark.slow
def test_a_button_under_the_pointer_is_read():
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        shown = browser.new_page()
        for colours in themes().values():
            rules = "".join(f"--{name}: {colour};" for name, colour in colours.items())
            for kind in ("default", "primary"):
                style = f"<style>:root {{ {rules} }} {page.STYLE}</style>"
                shown.set_content(f"{style}<button class='bk-btn bk-btn-{kind}'>Find</button>")
                button = shown.get_by_role("button")
                button.hover()
                assert ratio(*button.evaluate(HUES)) >= 4.5, kind
        browser.close()
