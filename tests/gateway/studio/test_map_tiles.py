"""Map tiles: they cover what a chart shows, each lies where its numbers say, and not too many."""

import numpy as np
import pytest

from gateway.config import StudioSettings
from gateway.ingest.earth import Origin, to_local
from gateway.studio.map_tiles import MOST, View, corner, credit, numbered, tiles_under, zoom_of

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
