"""Pushes that change once: told from forces that this file makes with rotations of its own."""

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.effects.effect import ResidualForce
from sim.effects.pushes import push_changes
from sim.state import Floats
from tests.sim.vessels import WAMV

T = np.arange(0.0, 400.0, 0.5)
CHANGE = 150.0


def missing(before: complex, after: complex, noise: float = 1.0) -> ResidualForce:
    """What a boat that turns all the time feels of a push, north + i east [N]."""
    chance = np.random.default_rng(3)
    yaw = 0.05 * T + 0.5 * np.sin(0.11 * T)
    on_board = np.where(T < CHANGE, before, after) * np.exp(-1j * yaw)
    body = np.stack([on_board.real, on_board.imag, 0.0 * T], axis=1)
    body[:, :2] += noise * chance.normal(size=(len(T), 2))
    nu = np.stack([np.full(len(T), 1.0), 0.0 * T, 0.05 + 0.0 * T], axis=1)
    still = np.zeros((len(T), 2))
    return ResidualForce(T, still, still, body, nu, yaw=yaw)


def ones() -> Floats:
    return np.ones(len(T))


def test_the_moment_and_both_pushes_are_found() -> None:
    north, south_east = 6.0 + 0.0j, -2.0 + 3.0j
    best, other = push_changes(missing(north, south_east), ones(), ones())
    assert best.time == pytest.approx(CHANGE, abs=4.0)
    assert best.size == pytest.approx(6.0, abs=0.4)
    assert best.direction == pytest.approx(0.0, abs=0.07)
    assert best.later_size == pytest.approx(abs(south_east), abs=0.4)
    assert best.later_direction == pytest.approx(np.angle(south_east), abs=0.1)
    assert other.taken < best.taken
    assert abs(other.time - best.time) > 20.0


def test_what_a_push_does_on_board_may_differ_ahead_and_abeam() -> None:
    """A hull that feels twice as much abeam."""
    found = missing(6.0 + 0.0j, 6.0j)
    found.body[:, 1] *= 2.0
    best = push_changes(found, ones(), 2.0 * ones())[0]
    assert best.size == pytest.approx(6.0, abs=0.4)
    assert push_changes(found, ones(), ones())[0].size != pytest.approx(6.0, abs=0.4)


def test_spikes_do_not_move_it() -> None:
    found = missing(6.0 + 0.0j, -6.0 + 0.0j)
    found.body[100:104] = 1e4
    best = push_changes(found, ones(), ones())[0]
    assert best.time == pytest.approx(CHANGE, abs=4.0)
    assert best.later_direction == pytest.approx(np.pi, abs=0.1) or best.later_direction < -3.0


@pytest.mark.parametrize("rows", [0, 1, 99])
def test_too_little_tells_nothing(rows: int) -> None:
    whole = missing(6.0 + 0.0j, -6.0 + 0.0j)
    few = ResidualForce(*(each[:rows] for each in whole))
    assert push_changes(few, ones()[:rows], ones()[:rows]) == []


def test_a_model_that_lacks_nothing_at_all_or_is_lost_tells_nothing() -> None:
    none = missing(0.0j, 0.0j, noise=0.0)
    assert push_changes(none, ones(), ones()) == []
    lost = missing(6.0 + 0.0j, -6.0 + 0.0j)
    lost.body[5, 0] = np.nan
    assert push_changes(lost, ones(), ones()) == []


@pytest.mark.parametrize("name", ["current_change", "wind_change"])
def test_a_search_begins_where_the_push_changes(name: str) -> None:
    """Towards for water, from for wind: a push to the north is a wind from the south.

    Drag and areas, which are not alike ahead and abeam, turn this push by some degrees.
    """
    search = named(name).search
    assert search is not None
    starts = search(WAMV, lambda: missing(9.0 + 0.0j, 9.0j))
    evenly = search(WAMV, lambda: ResidualForce(T, np.zeros((len(T), 2)), np.zeros((len(T), 2))))
    assert len(starts) == len(evenly) + 2
    times = [one["time"] for one in evenly]  # along the whole recording, not at its ends
    assert len(set(times)) >= 4
    assert T[0] < min(times) < 0.25 * T[-1]
    assert 0.75 * T[-1] < max(times) < T[-1]
    best = starts[len(evenly)]
    sign = 1.0 if name == "current_change" else -1.0
    assert best["time"] == pytest.approx(CHANGE, abs=4.0)
    for key, way in (("direction", 1.0), ("later_direction", 1.0j)):
        assert np.exp(1j * best[key]) == pytest.approx(sign * way, abs=0.25)
