"""A map from a file, without a network: MBTiles, an SQLite database of pictures.

    tiles(zoom_level, tile_column, tile_row, tile_data),    tile_row = 2^z − 1 − y

y counts from north to south as in addresses on the web. Source: MBTiles specification 1.3.
"""

import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from tornado.web import RequestHandler

from gateway.errors import BadInput

KINDS = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}


class TileFile:
    """The tiles of a file; BadInput where it is none.

    deepest       zoom beyond which it has none
    attribution   whose map it says it is, without markup
    """

    def __init__(self, path: Path) -> None:
        self._address = f"{path.resolve().as_uri()}?mode=ro"
        try:
            with closing(self._open()) as file:
                about = dict(file.execute("SELECT name, value FROM metadata").fetchall())
                (deepest,) = file.execute("SELECT max(zoom_level) FROM tiles").fetchone()
        except sqlite3.Error as error:
            raise BadInput(f"{path}: no MBTiles file: {error}") from None
        kind = str(about.get("format", "png"))
        if kind not in KINDS:
            raise BadInput(f"{path}: holds tiles of the kind {kind!r}: pictures are needed")
        if deepest is None:
            raise BadInput(f"{path}: holds no tiles")
        self.kind, self.deepest = KINDS[kind], int(deepest)
        self.attribution = re.sub(r"<[^>]*>", "", str(about.get("attribution", "")))

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
