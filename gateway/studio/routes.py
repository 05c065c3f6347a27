"""Addresses of the server beside its pages: is it there, where does `/` lead, a map's tiles.

An open page asks `alive` about once a second. The answer is the name of this run of the server, so
that a page knows when another one has taken its place, whose sessions it does not share.
"""

from collections.abc import Callable
from typing import Any

from tornado.routing import PathMatches, Rule
from tornado.web import RedirectHandler, RequestHandler

from gateway.studio.tile_file import TileFile, TileHandler

ALIVE = "alive"


class AliveHandler(RequestHandler):  # type: ignore[misc]
    """The name of this run of the server; nothing that a stranger could use."""

    def initialize(self, run: str) -> None:
        """As tornado hands it over."""
        self._run = run

    def get(self) -> None:
        """Answer a request; never from a cache."""
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(self._run)


def routes(
    run: str, first_page: str, tiles: TileFile | None = None,
    allowed: Callable[[Any], bool] = lambda handler: True,
) -> list[Any]:  # fmt: skip
    """Rules that go before those of the pages; a token in the address is kept on the way.

    tiles    a map's file; `allowed`: may the sender of a request see it?
    """
    more = {"file": tiles, "allowed": allowed}
    place = PathMatches(r"/tiles/(\d{1,2})/(\d{1,8})/(\d{1,8})")
    return [
        *([Rule(place, TileHandler, more)] if tiles is not None else []),
        Rule(PathMatches(f"/{ALIVE}"), AliveHandler, {"run": run}),
        Rule(PathMatches("/"), RedirectHandler, {"url": f"/{first_page}", "permanent": False}),
    ]
