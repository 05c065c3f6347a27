"""A map from a file, without a network: MBTiles, an SQLite database of pictures, or PMTiles.

    tiles(zoom_level, tile_column, tile_row, tile_data),    tile_row = 2^z − 1 − y      (MBTiles)

y counts from north to south as in addresses on the web and in PMTiles. Source: MBTiles
specification 1.3; PMTiles specification 3, read by its own library.
"""

import re
import sqlite3
import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from pmtiles.reader import MmapSource, Reader
from pmtiles.tile import Compression, MagicNumberNotFound, SpecVersionUnsupported, TileType
from tornado.web import RequestHandler

from gateway.errors import BadInput

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
