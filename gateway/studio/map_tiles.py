"""A map below a chart in metres, north up: which tiles a view needs, and where each of them lies.

    x = (λ + 180°) / 360° · 2^z,    y = (1 − artanh(sin φ) / π) / 2 · 2^z

z the zoom, tile (x, y) counted from 180° W towards east and from the north end towards south.
Valid for: a chart of some kilometres, |φ| < 85.05°. Source: EPSG:3857, OGC 07-057r7 annex E.
No tile is asked for before the map is switched on.

A map from a file needs no network: MBTiles, an SQLite database of pictures, or PMTiles.

    tiles(zoom_level, tile_column, tile_row, tile_data),    tile_row = 2^z − 1 − y      (MBTiles)

y counts from north to south as in addresses on the web and in PMTiles. Source: MBTiles
specification 1.3; PMTiles specification 3, read by its own library.
"""

import math
import re
import sqlite3
import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import closing
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, Div, ImageURL
from pmtiles.reader import MmapSource, Reader
from pmtiles.tile import Compression, MagicNumberNotFound, SpecVersionUnsupported, TileType
from tornado.web import RequestHandler

from gateway.config import StudioSettings
from gateway.errors import BadInput
from gateway.figures import Theme
from gateway.ingest.mapping import A, Origin, to_degrees, to_local
from gateway.studio.page import bokeh_part, boxes, fill_source, html, stack
from sim.state import Floats

PIXELS = 256  # of a tile
MOST = 64  # tiles in one view
FURTHEST_DEG = 85.05
WIDEST_M = 100_000.0  # beyond, the plane of the chart is not the Earth
ADDRESS = re.compile(r"https?://[^\s<>\"]+")
PALE = {"light": 0.75, "dark": 0.4}  # by theme, so that tracks and names stand out
WIDE_PX = 700.0  # of a chart whose width is not known yet
# The browser alone knows whether a picture came: it looks at the one in the middle.
PROBE = """
const urls = cb_obj.data.url;
missing.visible = false;
if (urls.length) {
    const one = new Image();
    one.onerror = () => { missing.visible = cb_obj.data.url === urls; };
    one.src = urls[Math.floor(urls.length / 2)];
}
"""
COLUMNS = ("url", "x", "y", "w", "h")  # of a tile


class View(NamedTuple):
    """What a chart shows [m from the origin], and how many pixels wide it is."""

    west: float
    east: float
    south: float
    north: float
    pixels: float


class Tile(NamedTuple):
    """One tile: its address, its north-west corner [m from the origin], and its size [m]."""

    url: str
    west: float
    north: float
    width: float
    height: float


def tiles_under(view: View, origin: Origin, settings: StudioSettings) -> list[Tile]:
    """All tiles that a view shows, and none where a map makes no sense."""
    wide, high = view.east - view.west, view.north - view.south
    far = max(map(abs, view[:4]))
    sane = math.isfinite(far) and 0.0 < wide and 0.0 < high and far < WIDEST_M
    if not sane or abs(origin.latitude_deg) >= FURTHEST_DEG or not view.pixels > 0.0:
        return []
    zoom = zoom_of(wide / view.pixels, origin.latitude_deg, settings.deepest)
    while zoom > 0 and len(list(_numbers(view, origin, zoom))) > MOST:
        zoom -= 1
    return [_tile(x, y, zoom, origin, settings) for x, y in _numbers(view, origin, zoom)]


def zoom_of(metres_per_pixel: float, latitude_deg: float, deepest: int) -> int:
    """The zoom whose pixels are nearest to those of the chart."""
    whole = 2.0 * math.pi * A * math.cos(math.radians(latitude_deg)) / PIXELS
    return int(np.clip(round(math.log2(whole / metres_per_pixel)), 0, deepest))


def numbered(degrees: Floats, zoom: int) -> Floats:
    """(..., 2) [latitude, longitude, degrees] -> (..., 2) x, y of the tile, with its fraction."""
    latitude, longitude = degrees[..., 0], degrees[..., 1]
    x = (longitude + 180.0) / 360.0
    y = 0.5 * (1.0 - np.arctanh(np.sin(np.radians(latitude))) / np.pi)
    return np.stack([x, y], axis=-1) * 2.0**zoom


def corner(x: float, y: float, zoom: int) -> Floats:
    """The north-west corner of a tile: (2,) latitude, longitude [degrees]."""
    latitude = math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * y / 2.0**zoom))))
    return np.array([latitude, x / 2.0**zoom * 360.0 - 180.0])


def _numbers(view: View, origin: Origin, zoom: int) -> Iterator[tuple[int, int]]:
    corners = np.array([[view.north, view.west], [view.south, view.east]])
    (west, north), (east, south) = np.floor(numbered(to_degrees(corners, origin), zoom)).astype(int)
    for y in range(max(north, 0), min(south, 2**zoom - 1) + 1):
        for x in range(west, east + 1):
            yield x, y


def _tile(x: int, y: int, zoom: int, origin: Origin, settings: StudioSettings) -> Tile:
    north, west = to_local(corner(x, y, zoom), origin)
    south, east = to_local(corner(x + 1, y + 1, zoom), origin)
    url = settings.tile(zoom, x % 2**zoom, y)  # across the date line
    return Tile(url, float(west), float(north), float(east - west), float(north - south))


class TileLayer:
    """The tiles below one figure, which follow what it shows."""

    def __init__(self, figure: Any, settings: StudioSettings, theme: Theme, missing: Any) -> None:
        self._figure, self._settings = figure, settings
        self._source = ColumnDataSource({name: [] for name in COLUMNS})
        self._source.js_on_change("data", CustomJS(args={"missing": missing}, code=PROBE))
        tile = ImageURL(
            **{name: name for name in COLUMNS}, anchor="top_left", global_alpha=PALE[theme.name]
        )
        drawn = figure.add_glyph(self._source, tile)
        drawn.level = "image"  # above the paper, below all lines
        figure.renderers.remove(drawn)
        others = list(figure.renderers)
        figure.renderers.insert(0, drawn)
        for axis in (figure.x_range, figure.y_range):
            if axis.renderers == "auto":
                axis.renderers = others  # the view follows the boats, never the map

    def show(self, origin: Origin | None) -> None:
        """Tiles of what the figure shows now; none without a place on Earth."""
        x, y = self._figure.x_range, self._figure.y_range
        tiles: list[Tile] = []
        if origin is not None and None not in (x.start, x.end, y.start, y.end):
            pixels = self._figure.inner_width or WIDE_PX
            tiles = tiles_under(
                View(x.start, x.end, y.start, y.end, pixels), origin, self._settings
            )
        fill_source(self._source, tiles)


class TileMap:
    """The map below the figures of a page, and the box that switches it on."""

    def __init__(self, settings: StudioSettings, theme: Theme) -> None:
        self._settings, self._theme = settings, theme
        self._figures: list[Any] = []
        self._layers: list[TileLayer] = []
        self.credit = html()
        self.box = boxes(options=[f"Map, {settings.source}"])
        self._missing = Div(
            text=f"No picture of the map could be had of this place, {settings.source}.",
            visible=False, styles={"color": "var(--warn)", "font-size": "15px"},
        )  # fmt: skip
        self.part = stack(self.box, bokeh_part(self._missing), self.credit)

    def show(self, figures: list[Any], origin: Origin | None) -> None:
        """The map below `figures` while the box is ticked, and the credit of its source."""
        on = bool(self.box.value)
        if on and figures and figures != self._figures:
            self._figures = figures
            self._layers = [
                TileLayer(one, self._settings, self._theme, self._missing) for one in figures
            ]
        for layer in self._layers:
            layer.show(origin if on else None)
        text = credit(self._settings.attribution) if on and origin else ""
        if on and origin is None:
            text = "<p class='warn'>no place on Earth is known for it yet</p>"
        if self.credit.object != text:
            self.credit.object = text


def credit(attribution: str) -> str:
    """The credit of a map's source, its addresses as links."""
    link = r'<a href="\g<0>" target="_blank" rel="noopener">\g<0></a>'
    return f"<p class='faint'>{ADDRESS.sub(link, escape(attribution))}</p>"


KINDS = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
PICTURES = {TileType.PNG: "png", TileType.JPEG: "jpeg", TileType.WEBP: "webp"}
DAMAGE = (MagicNumberNotFound, SpecVersionUnsupported, ValueError, KeyError, IndexError, TypeError,
          EOFError, OverflowError, OSError, zlib.error, struct.error)  # fmt: skip


def open_tiles(path: Path) -> "TileFile":
    """The tiles of a file by its ending; BadInput where it is none, or holds no pictures."""
    return PmTiles(path) if path.suffix == ".pmtiles" else MbTiles(path)


class TileFile(ABC):
    """The tiles of a file.

    kind         of its pictures, for the browser
    deepest      zoom beyond which it has none
    attribution  whose map it says it is, without markup
    """

    def __init__(self, path: Path, kind: str, deepest: int | None, attribution: str) -> None:
        if kind not in KINDS:
            raise BadInput(f"{path}: holds tiles of the kind {kind!r}: pictures are needed")
        if deepest is None:
            raise BadInput(f"{path}: holds no tiles")
        self.kind, self.deepest = KINDS[kind], deepest
        self.attribution = re.sub(r"<[^>]*>", "", attribution)

    @abstractmethod
    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A picture; None where the file has none there."""


class MbTiles(TileFile):
    """An SQLite database."""

    def __init__(self, path: Path) -> None:
        self._address = f"{path.resolve().as_uri()}?mode=ro"
        try:
            with closing(self._open()) as file:
                about = dict(file.execute("SELECT name, value FROM metadata").fetchall())
                (deepest,) = file.execute("SELECT max(zoom_level) FROM tiles").fetchone()
        except sqlite3.Error as error:
            raise BadInput(f"{path}: no MBTiles file: {error}") from None
        super().__init__(path, str(about.get("format", "png")), deepest,
                         str(about.get("attribution", "")))  # fmt: skip

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A picture; None where the file has none there."""
        where = (zoom, x, 2**zoom - 1 - y)
        with closing(self._open()) as file:
            row = file.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?",
                where,
            ).fetchone()
        return None if row is None else bytes(row[0])

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(self._address, uri=True)


class PmTiles(TileFile):
    """One archive with an index of its own."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("rb") as file:
                self._reader = Reader(MmapSource(file))
            header, about = self._reader.header(), self._reader.metadata()
            packed = header["tile_compression"] not in (Compression.NONE, Compression.UNKNOWN)
            deepest = int(header["max_zoom"]) if header["addressed_tiles_count"] else None
            kind = PICTURES.get(header["tile_type"], header["tile_type"].name.lower())
        except DAMAGE as error:
            raise BadInput(f"{path}: no PMTiles file: {error}") from None
        super().__init__(path, "packed pictures" if packed else kind, deepest,
                         str(about.get("attribution", "")))  # fmt: skip

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A picture; None where the file has none there."""
        if zoom > self.deepest or not (0 <= x < 2**zoom and 0 <= y < 2**zoom):
            return None
        found: bytes | None = self._reader.get(zoom, x, y)
        return found


class TileHandler(RequestHandler):  # type: ignore[misc]
    """One tile of the file, for those who may see the pages."""

    def initialize(self, file: TileFile, allowed: Callable[[Any], bool]) -> None:
        """As tornado hands it over."""
        self._file, self._allowed = file, allowed

    def get(self, zoom: str, x: str, y: str) -> None:
        """Answer a request; without content where the map has no picture."""
        if not self._allowed(self):
            self.set_status(403)
            return
        found = self._file.tile(int(zoom), int(x), int(y))
        if found is None:
            self.set_status(204)
            return
        self.set_header("Content-Type", self._file.kind)
        self.set_header("Cache-Control", "max-age=3600")
        self.write(found)
