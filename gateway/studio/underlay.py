"""A map below a chart in metres, north up: nothing is asked of anybody before it is switched on."""

import re
from html import escape
from typing import Any

from bokeh.models import ColumnDataSource, ImageURL

from gateway.ingest.earth import Origin
from gateway.pictures.look import Look
from gateway.studio.settings import StudioSettings
from gateway.studio.tiles import View, tiles_under
from gateway.studio.widgets import boxes, html

ADDRESS = re.compile(r"https?://[^\s<>\"]+")
PALE = {"light": 0.75, "dark": 0.4}  # so that tracks and names stand out
WIDE_PX = 700.0  # of a chart that has not told its width yet


class Underlay:
    """The tiles below one figure, that follow what it shows."""

    def __init__(self, figure: Any, settings: StudioSettings, look: Look) -> None:
        self._figure, self._settings = figure, settings
        self._source = ColumnDataSource({name: [] for name in ("url", "x", "y", "w", "h")})
        self._shown: list[str] = []
        drawn = figure.add_glyph(
            self._source,
            ImageURL(
                url="url",
                x="x",
                y="y",
                w="w",
                h="h",
                anchor="top_left",
                global_alpha=PALE[look.name],
            ),
        )
        drawn.level = "image"  # above the paper, below all lines
        figure.renderers.remove(drawn)
        others = list(figure.renderers)
        figure.renderers.insert(0, drawn)
        for axis in (figure.x_range, figure.y_range):
            axis.renderers = others  # the view follows the boats, never the map

    def show(self, origin: Origin | None) -> None:
        """Tiles of what the figure shows now; none without a place on Earth."""
        x, y = self._figure.x_range, self._figure.y_range
        if origin is None or None in (x.start, x.end, y.start, y.end):
            return self.clear()
        pixels = self._figure.inner_width or WIDE_PX
        view = View(x.start, x.end, y.start, y.end, pixels)
        tiles = tiles_under(view, origin, self._settings)
        urls = [tile.url for tile in tiles]
        if urls != self._shown:
            self._shown = urls
            self._source.data = {
                "url": urls, "x": [t.west for t in tiles], "y": [t.north for t in tiles],
                "w": [t.width for t in tiles], "h": [t.height for t in tiles],
            }  # fmt: skip
        return None

    def clear(self) -> None:
        """No map."""
        if self._shown:
            self._shown = []
            self._source.data = {name: [] for name in ("url", "x", "y", "w", "h")}


class MapSwitch:
    """The box that switches maps on, and whose map it is once they are."""

    def __init__(self, settings: StudioSettings) -> None:
        self._settings = settings
        self.credit = html()
        self.box = boxes(options=[f"Map, asked of {settings.host}"])

    @property
    def on(self) -> bool:
        """Has somebody asked for a map?"""
        return bool(self.box.value)

    def tell(self, known: bool) -> None:
        """Whose map it is; or that it cannot be drawn."""
        text = credit(self._settings.attribution) if self.on and known else ""
        if self.on and not known:
            text = "<p class='warn'>no place on Earth is known for it yet</p>"
        if self.credit.object != text:
            self.credit.object = text


def credit(attribution: str) -> str:
    """Whose map it is, its addresses as links."""

    def link(found: re.Match[str]) -> str:
        return f'<a href="{found[0]}" target="_blank" rel="noopener">{found[0]}</a>'

    return f"<p class='faint'>{ADDRESS.sub(link, escape(attribution))}</p>"
