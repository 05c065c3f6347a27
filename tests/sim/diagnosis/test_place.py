"""The worst place on the map, in words."""

import numpy as np

from sim.comparison.regimes import at_place
from sim.comparison.where import Track, worst_place


def grid(share: np.ndarray) -> Track:
    cells = np.array([(n, e) for n in range(10) for e in range(10)], float)
    return Track(5.0, 5.0 * cells - 20.0, share, np.full(100, 0.01), np.zeros((100, 3)))


def test_a_spot_with_the_error_is_the_place() -> None:
    share = np.full(100, 0.005)
    share[72] = 0.505
    place = worst_place(grid(share))
    assert place is not None
    assert abs(place.north - (5.0 * 7 - 17.5)) <= 5.0
    assert abs(place.east - (5.0 * 2 - 17.5)) <= 5.0
    assert place.share > 0.5
    assert place.time_share <= 0.09 + 1e-9


def test_an_even_error_has_no_place() -> None:
    assert worst_place(grid(np.full(100, 0.01))) is None


def test_a_track_of_one_cell_has_no_place() -> None:
    one = Track(5.0, np.zeros((1, 2)), np.ones(1), np.ones(1), np.zeros((1, 3)))
    assert worst_place(one) is None


def test_it_is_told_from_the_origin() -> None:
    says = at_place(-42.4, 10.0, 15.0, 0.5, 0.09)
    assert says == (
        "around 42 m south, 10 m east of the origin (15 m square): "
        "50 % of the squared error in 9 % of the time"
    )
