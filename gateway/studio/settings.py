"""Table `[studio]` of gateway.toml: where map tiles come from, once somebody asks for them.

tiles        address of a tile, with {Z}, {X} and {Y} where its numbers go (Web Mercator)
attribution  whose map it is, in words; addresses in it become links
deepest      zoom beyond which the source has no tiles
"""

from dataclasses import dataclass
from urllib.parse import urlparse

from gateway.errors import BadInput

OPENSTREETMAP = "https://tile.openstreetmap.org/{Z}/{X}/{Y}.png"
CREDIT = "© OpenStreetMap contributors, https://www.openstreetmap.org/copyright"
DEEPEST = 24


@dataclass(frozen=True)
class StudioSettings:
    """Where a map comes from."""

    tiles: str = OPENSTREETMAP
    attribution: str = CREDIT
    deepest: int = 19

    def __post_init__(self) -> None:
        where = urlparse(self.tiles)
        whole = where.scheme in ("http", "https") and where.netloc
        if not whole or any(self.tiles.count(part) != 1 for part in ("{Z}", "{X}", "{Y}")):
            raise BadInput(
                f"[studio] tiles = {self.tiles!r}: expected an address like {OPENSTREETMAP}"
            )
        if not 0 <= self.deepest <= DEEPEST:
            raise BadInput(f"[studio] deepest = {self.deepest}: expected a zoom, 0 to {DEEPEST}")

    @property
    def host(self) -> str:
        """Who is asked."""
        return urlparse(self.tiles).netloc

    def tile(self, zoom: int, x: int, y: int) -> str:
        """Address of one tile."""
        named = {"{Z}": zoom, "{X}": x, "{Y}": y}
        address = self.tiles
        for part, number in named.items():
            address = address.replace(part, str(number))
        return address
