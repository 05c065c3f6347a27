"""Map tiles: they cover what a chart shows, each lies where its numbers say, and not too many."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from gateway.config import StudioSettings
from gateway.errors import BadInput
from gateway.ingest.mapping import Origin, to_local
from gateway.studio.map_tiles import (
    MOST,
    View,
    corner,
    credit,
    numbered,
    open_tiles,
    tiles_under,
    zoom_of,
)
from gateway.studio.serve import settings_of_file

PLAIN = StudioSettings("https://maps.local/{Z}/{X}/{Y}.png", "us", 19)
PLACES = [Origin(59.3, 18.1), Origin(-33.9, -70.6), Origin(0.0, 0.0), Origin(65.0, 179.9999)]
VIEW = View(-150.0, 250.0, -100.0, 130.0, 800.0)


def numbers(url: str) -> tuple[int, int, int]:
    z, x, y = url.removesuffix(".png").split("/")[-3:]
    return int(z), int(x), int(y)


@pytest.mark.parametrize("origin", PLACES)
def test_tiles_cover_the_view_without_gap_or_overlap(origin):
    tiles = tiles_under(VIEW, origin, PLAIN)
    for east in np.linspace(VIEW.west, VIEW.east, 9):
        for north in np.linspace(VIEW.south, VIEW.north, 7):
            over = [
                t for t in tiles
                if t.west <= east < t.west + t.width and t.north - t.height < north <= t.north
            ]  # fmt: skip
            assert len(over) == 1
    assert len({t.url for t in tiles}) == len(tiles) <= MOST


def test_a_tile_lies_where_its_numbers_say():
    """The definition of OSM's wiki: tile of a place, worked out by another formula."""
    origin = PLACES[0]
    for tile in tiles_under(VIEW, origin, PLAIN):
        z, x, y = numbers(tile.url)
        place = corner(x + 0.5, y + 0.5, z)
        north, east = to_local(place, origin)
        assert abs(east - tile.west - tile.width / 2.0) < 0.01
        assert abs(north - tile.north + tile.height / 2.0) < 0.01
        turned = np.log(np.tan(np.radians(place[0])) + 1.0 / np.cos(np.radians(place[0])))
        assert int((1.0 - turned / np.pi) / 2.0 * 2**z) == y
        assert tile.width == pytest.approx(tile.height, rel=0.01)


def test_numbers_and_corners_are_each_others_inverse():
    for x, y in ((3.0, 5.25), (70.5, 44.0)):
        np.testing.assert_allclose(numbered(corner(x, y, 7), 7), [x, y], atol=1e-9)


def test_a_pixel_of_the_tile_is_about_one_of_the_chart_and_never_deeper_than_there_is():
    tile = tiles_under(VIEW, PLACES[0], PLAIN)[0]
    chart = (VIEW.east - VIEW.west) / VIEW.pixels
    assert 2.0**-0.51 < tile.width / 256 / chart < 2.0**0.51
    assert zoom_of(0.001, 0.0, 19) == 19
    assert zoom_of(1e9, 0.0, 19) == 0


@pytest.mark.parametrize(
    "view",
    [
        View(np.nan, 1.0, 0.0, 1.0, 800.0), View(0.0, 0.0, 0.0, 1.0, 800.0),
        View(-1e9, 1e9, -1e9, 1e9, 800.0), View(0.0, 1.0, 0.0, 1.0, 0.0),
    ],
)  # fmt: skip
def test_a_view_without_sense_has_no_map(view):
    assert tiles_under(view, PLACES[0], PLAIN) == []
    assert tiles_under(VIEW, Origin(89.0, 0.0), PLAIN) == []


def test_a_view_high_and_narrow_asks_for_fewer_instead_of_many():
    high = View(0.0, 10.0, 0.0, 5000.0, 800.0)
    assert 1 <= len(tiles_under(high, PLACES[0], PLAIN)) <= MOST


def test_whose_map_it_is_cannot_carry_a_script():
    shown = credit("© us <script>x</script> https://us.example/copyright")
    assert "<script>" not in shown
    assert '<a href="https://us.example/copyright"' in shown


def mbtiles(path: Path, kind: str = "png") -> Path:
    """A map of two zooms with one picture each, at the north-west corner of the world."""
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("CREATE TABLE metadata (name text, value text)")
        file.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data blob)")
        about = [("format", kind), ("attribution", "<a href='x'>© a harbour</a>")]
        file.executemany("INSERT INTO metadata VALUES (?, ?)", about)
        rows = [(0, 0, 0, b"world"), (2, 0, 3, b"north-west")]
        file.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    return path


def pmtiles(path: Path, kind: TileType = TileType.PNG) -> Path:
    """The same map as PMTiles."""
    with path.open("wb") as file:
        out = Writer(file)
        out.write_tile(zxy_to_tileid(0, 0, 0), b"world")
        out.write_tile(zxy_to_tileid(2, 0, 0), b"north-west")
        header = {"tile_type": kind, "tile_compression": Compression.NONE, "center_zoom": 0,
                  "min_lon_e7": 0, "min_lat_e7": 0, "max_lon_e7": 0, "max_lat_e7": 0,
                  "center_lon_e7": 0, "center_lat_e7": 0}  # fmt: skip
        out.finalize(header, {"attribution": "<a href='x'>© a harbour</a>"})
    return path


@pytest.mark.parametrize("write", [mbtiles, pmtiles])
def test_a_map_from_a_file_counts_from_the_north_and_asks_nobody(tmp_path, write):
    path = write(tmp_path / f"coast.{write.__name__}")
    file = open_tiles(path)
    assert file.kind == "image/png"
    assert file.tile(2, 0, 0) == b"north-west"
    for zoom, x, y in ((2, 0, 3), (1, 0, 0), (2, 9, 0), (40, 0, 0)):
        assert file.tile(zoom, x, y) is None
    settings = settings_of_file(StudioSettings(tiles=str(path)))
    assert (settings.deepest, settings.attribution) == (2, "© a harbour")
    assert settings.source == f"from coast.{write.__name__}"
    assert settings.tile(2, 0, 0) == "tiles/2/0/0"


def vector(path: Path) -> Path:
    return mbtiles(path, "pbf") if path.suffix == ".mbtiles" else pmtiles(path, TileType.MVT)


@pytest.mark.parametrize("ending", ["mbtiles", "pmtiles"])
@pytest.mark.parametrize("content", [b"", b"no database", b"PMTiles\x03" + 200 * b"\xff", None])
def test_a_file_that_is_no_map_is_one_line(tmp_path, content, ending):
    path = tmp_path / f"coast.{ending}"
    if content is None:
        vector(path)
    else:
        path.write_bytes(content)
    with pytest.raises(BadInput, match=rf"coast\.{ending}"):
        open_tiles(path)
    with pytest.raises(BadInput, match="no such file"):
        StudioSettings(tiles=str(tmp_path / f"gone.{ending}"))
