"""Tables over the map and over time: values between the knots, where they act, what they say."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from sim.body import Flow
from sim.effects import (
    learned_drag,
    learned_history,
    learned_map,
    learned_profile,
    learned_spot,
)
from sim.effects.effect import ResidualForce
from sim.effects.tables import EVENLY
from sim.effects.words import FittedValues
from sim.state import Pose
from tests.sim.vessels import RUDDER_BOAT, VALUES, WAMV

rng = np.random.default_rng(5)
MAP = {
    **VALUES["learned_map"],
    **{key: float(rng.normal()) for key in (*learned_map.TO_NORTH, *learned_map.TO_EAST)},
}
MOVED = dict(zip(EVENLY, (0.1, 0.12, 0.3, 0.5, 0.52, 0.7, 0.9), strict=True))
KNOTS = np.array([0.0, *MOVED.values(), 1.0])
HISTORY = {
    **VALUES["learned_history"],
    **{key: float(rng.normal()) for key in (*learned_history.FIRST, *learned_history.SECOND)},
}


PROFILE = {
    **VALUES["learned_profile"],
    **MOVED,
    **{key: float(rng.normal()) for key in (*learned_profile.TO_NORTH, *learned_profile.TO_EAST)},
}


def flow(**values: Any) -> Flow:
    return Flow(**{**dict.fromkeys(Flow._fields, 0.0), **values})


def test_a_map_is_bilinear_between_its_knots_and_constant_beyond_them() -> None:
    north, east = rng.uniform(-6.0, 9.0, 200), rng.uniform(-9.0, 8.0, 200)
    now = learned_map.water(0.0, Pose(north, east, 0.0), SimpleNamespace(**MAP))
    knots = np.linspace(-3.0, 6.0, 4), np.linspace(-5.0, 4.0, 4)
    inside = np.stack([np.clip(north, -3.0, 6.0), np.clip(east, -5.0, 4.0)], axis=1)
    for keys, part in ((learned_map.TO_NORTH, now.north), (learned_map.TO_EAST, now.east)):
        table = np.array([MAP[key] for key in keys]).reshape(4, 4)
        np.testing.assert_allclose(part, RegularGridInterpolator(knots, table)(inside), atol=1e-12)


def test_a_history_is_linear_between_its_knots_and_constant_beyond_them() -> None:
    time, knots = np.linspace(-3.0, 20.0, 200), np.linspace(0.0, 12.0, 9)
    now = learned_history.water(time, Pose(0.0, 0.0, 0.0), SimpleNamespace(**HISTORY))
    for keys, part in ((learned_history.FIRST, now.north), (learned_history.SECOND, now.east)):
        np.testing.assert_allclose(part, np.interp(time, knots, [HISTORY[k] for k in keys]))


@pytest.mark.parametrize("direction", [0.0, 0.25 * np.pi, 0.75 * np.pi])
def test_a_profile_is_linear_on_its_way_across_and_constant_beyond(direction: float) -> None:
    north, east = rng.uniform(-9.0, 9.0, 200), rng.uniform(-9.0, 9.0, 200)
    values = {**PROFILE, "direction": direction}
    now = learned_profile.water(0.0, Pose(north, east, 0.0), SimpleNamespace(**values))
    across, knots = north * np.cos(direction) + east * np.sin(direction), 9.0 * KNOTS - 5.0
    for keys, part in (
        (learned_profile.TO_NORTH, now.north), (learned_profile.TO_EAST, now.east)
    ):  # fmt: skip
        np.testing.assert_allclose(part, np.interp(across, knots, [values[k] for k in keys]))


@pytest.mark.parametrize(
    ("effect", "values"),
    [(learned_map, MAP), (learned_history, HISTORY), (learned_profile, PROFILE)],
)
def test_a_push_is_that_of_the_world_on_a_hull_that_turned(effect: Any, values: Any) -> None:
    place = {"north": 1.0, "east": 2.0, "time": 5.0}
    water = effect.water(5.0, Pose(1.0, 2.0, 0.0), SimpleNamespace(**values))
    p = SimpleNamespace(**{**values, "acts": 2.0, "x": 0.5})
    still = effect.water(5.0, Pose(1.0, 2.0, 0.0), p)
    assert (still.north, still.east) == (0.0, 0.0)
    ahead, turned = (effect.force(flow(yaw=yaw, **place), p) for yaw in (0.0, 0.5 * np.pi))
    assert (ahead.X, ahead.Y) == pytest.approx((100.0 * water.north, 100.0 * water.east))
    assert (turned.X, turned.Y) == pytest.approx((100.0 * water.east, -100.0 * water.north))
    assert ahead.N == pytest.approx(0.5 * ahead.Y)
    none = effect.force(flow(**place), SimpleNamespace(**values))
    assert (none.X, none.Y, none.N) == (0.0, 0.0, 0.0)


def test_a_history_of_the_thrust_changes_thrust_alone() -> None:
    p = SimpleNamespace(**{**HISTORY, "acts": 3.0})
    share = HISTORY["f4"]  # its knot stands in the middle
    drive: Any = None
    assert learned_history.thrust(50.0, drive, flow(time=6.0), p) == pytest.approx(
        50.0 * (1.0 + share)
    )
    water = learned_history.water(6.0, Pose(0.0, 0.0, 0.0), p)
    assert (water.north, water.east) == (0.0, 0.0)
    assert learned_history.thrust(50.0, drive, flow(time=6.0), SimpleNamespace(**HISTORY)) == 50.0


def test_empty_tables_span_what_was_sailed() -> None:
    extent = {"north": (-4.0, 9.0), "east": (1.0, 7.0), "time": (0.0, 300.0)}
    maps = learned_map.tables(WAMV, extent)
    assert {m["acts"] for m in maps} == {1.0, 2.0}
    corners = ("south", "north", "west", "east")
    assert all([m[key] for key in corners] == [-4.0, 9.0, 1.0, 7.0] for m in maps)
    assert all(m[key] == 0.0 for m in maps for key in learned_map.TO_EAST)
    histories = learned_history.tables(RUDDER_BOAT, extent)
    assert {h["acts"] for h in histories} == {1.0, 2.0, 3.0}
    assert all(h["until"] == 300.0 and h["f8"] == 0.0 for h in histories)
    full = sum(t.thrust[1] for t in RUDDER_BOAT.thrusters)
    assert histories[0]["full"] == pytest.approx(0.4 * full)


def test_a_map_says_where_it_is_strongest_and_where_it_differs_most() -> None:
    none = dict.fromkeys((*learned_map.TO_NORTH, *learned_map.TO_EAST), 0.0)
    values = {**MAP, **none, "e30": 0.42, "e03": -0.1}
    said = learned_map.in_words(FittedValues(values))
    assert said == (
        "water that flows differently from place to place: 0.42 m/s towards 90° (east) around "
        "N 6 m, E -5 m, 0.1 m/s towards 270° (west) around N -3 m, E 4 m"
    )
    push = learned_map.in_words(FittedValues({**values, "acts": 2.0}))
    assert push.startswith("a push over the ground that acts differently from place to place: 42 N")
    field = learned_map.over_map(FittedValues({**values, "acts": 2.0}))
    assert (field.unit, field.to_east.max()) == ("N", pytest.approx(42.0))
    assert (field.north[12], field.east[12]) == (6.0, -5.0)  # e30


def test_a_corner_where_the_boat_hardly_was_is_not_told() -> None:
    none = dict.fromkeys((*learned_map.TO_NORTH, *learned_map.TO_EAST), 0.0)
    values = {**MAP, **none, "e33": 2.3, "e11": 0.5, "n22": -0.3}
    ci95 = dict.fromkeys(none, (-0.05, 0.05)) | {
        "e33": (0.1, 4.5), "e11": (0.45, 0.55), "n22": (-0.35, -0.25), "e03": (-2.0, 2.0),
    }  # fmt: skip
    said = learned_map.in_words(FittedValues(values, ci95))
    assert "place to place: 0.5 m/s towards 90° (east) around N 0 m, E -2 m, 0.3 m/s" in said
    field = learned_map.over_map(FittedValues(values, ci95))
    assert field.half[15] == pytest.approx(2.2)
    assert field.least[5] == pytest.approx(0.45)
    assert field.least[0] == 0.0


def test_a_map_that_is_alike_everywhere_or_known_nowhere_says_so() -> None:
    alike = {**MAP, **dict.fromkeys(learned_map.TO_NORTH, 0.3),
             **dict.fromkeys(learned_map.TO_EAST, 0.0)}  # fmt: skip
    said = learned_map.in_words(FittedValues(alike))
    assert said.count("m/s") == 1
    wide = dict.fromkeys((*learned_map.TO_NORTH, *learned_map.TO_EAST), (-5.0, 5.0))
    assert learned_map.in_words(FittedValues(alike, wide)).endswith("to place: nowhere surely")


def test_a_history_is_told_at_the_knots_that_hold_its_shape() -> None:
    none = dict.fromkeys((*learned_history.FIRST, *learned_history.SECOND), 0.0)
    values = {**HISTORY, **none, "until": 400.0, "f0": -0.4, "f2": -0.2, "g8": 0.3}
    thrust = learned_history.in_words(FittedValues({**values, "acts": 3.0}))
    assert thrust == (
        "a share of the thrust that changes with the time: -40 % at 0 s, +0 % at 50 s, "
        "-20 % at 100 s, +0 % at 150 s, +0 % at 400 s"
    )
    water = learned_history.in_words(FittedValues(values))
    assert water.startswith("water that flows differently as time goes by: 0.4 m/s towards 180°")
    assert water.endswith("0.3 m/s towards 90° (east) at 400 s")


def weed(seconds: float = 600.0, seed: int = 3) -> ResidualForce:
    """What a model without it leaves of a boat that winds through a bed of weed (12, −8), 9 m wide,
    in which the hull is dragged twice as much again.
    """
    t = np.arange(0.0, seconds, 0.2)
    place = np.stack([25.0 * np.sin(0.05 * t), 20.0 * np.sin(0.037 * t + 1.0)], axis=1)
    velocity = np.gradient(place, t, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    away = np.hypot(*(place - [12.0, -8.0]).T)
    own = WAMV.dynamics
    drag = (own.X_u + own.X_uu * speed) * speed * 2.0 * (away < 9.0)
    force = drag[:, None] * velocity / speed[:, None]
    return ResidualForce(
        t, place, force + np.random.default_rng(seed).normal(0.0, 5.0, (len(t), 2))
    )


def test_a_place_is_looked_for_where_the_hull_was_held_back() -> None:
    first, *others = learned_drag.search(WAMV, weed)
    assert np.hypot(first["north"] - 12.0, first["east"] + 8.0) < 4.0
    assert 5.0 < first["radius"] < 14.0
    assert 1.0 < first["more"] < 3.0
    for other in others:  # each somewhere else
        assert np.hypot(other["north"] - first["north"], other["east"] - first["east"]) > 5.0


def test_where_nothing_moved_a_place_is_looked_for_where_the_boat_was() -> None:
    still = ResidualForce(np.arange(5.0), np.full((5, 2), 7.0), np.ones((5, 2)))
    (start,) = learned_drag.search(WAMV, lambda: still)
    assert (start["north"], start["east"]) == (7.0, 7.0)
    leaps = np.where(np.arange(600)[:, None] % 2, 1e3, np.zeros((600, 2)))
    jumps = ResidualForce(np.arange(600.0), leaps, np.ones((600, 2)))  # a receiver's, no motion
    assert len(learned_drag.search(WAMV, lambda: jumps)) == 1


def test_a_place_drags_as_much_more_as_it_says_and_only_there() -> None:
    p = SimpleNamespace(north=10.0, east=5.0, radius=8.0, edge=20.0, more=1.5)
    body: Any = SimpleNamespace(X_u=-10.0, X_uu=-20.0)
    inside, outside = (
        learned_drag.force(flow(u=2.0, north=north, east=5.0, body=body), p)
        for north in (12.0, 20.0)
    )
    assert inside.X == pytest.approx(1.5 * (-10.0 - 40.0) * 2.0, rel=1e-6)
    assert (inside.Y, inside.N) == (0.0, 0.0)
    assert abs(outside.X) < 1e-3 * abs(inside.X)
    back = learned_drag.force(flow(u=-2.0, north=12.0, east=5.0, body=body), p)
    assert back.X == -inside.X
    said = learned_drag.in_words(FittedValues({**vars(p), "more": 1.532}, {"more": (1.29, 1.77)}))
    assert said == (
        "drag that differs from place to place: 153 % (129–177 %) more within 8 m of N 10 m, E 5 m"
    )


@pytest.mark.parametrize("direction", [0.0, 0.35, 1.7, 2.9])
def test_a_profile_is_looked_for_across_the_line_along_which_a_force_is_alike(
    direction: float,
) -> None:
    def jet(n: Any, e: Any) -> Any:
        size = 30.0 * np.exp(-(((n * np.cos(direction) + e * np.sin(direction) - 4.0) / 6.0) ** 2))
        return size * np.cos(0.7), size * np.sin(0.7)

    left = around(jet)
    first, *others = learned_profile.search(WAMV, lambda: left)
    assert abs(np.remainder(first["direction"] - direction + 1.0, np.pi) - 1.0) < 0.12
    across = left.place @ [np.cos(first["direction"]), np.sin(first["direction"])]
    assert (first["low"], first["high"]) == pytest.approx((across.min(), across.max()), abs=0.5)
    assert {start["acts"] for start in (first, *others)} == {1.0, 2.0}
    assert all(start[key] == 0.0 for start in others for key in learned_profile.TO_EAST)
    still = ResidualForce(np.arange(5.0), np.full((5, 2), 7.0), np.ones((5, 2)))
    for start in learned_profile.search(WAMV, lambda: still):
        assert np.isfinite(list(start.values())).all()


def test_a_profile_says_where_it_is_strongest_and_where_it_differs_most() -> None:
    none = dict.fromkeys((*learned_profile.TO_NORTH, *learned_profile.TO_EAST), 0.0)
    values = {**PROFILE, **EVENLY, **none, "low": -20.0, "high": 60.0}
    values |= {"direction": 0.75 * np.pi, "e2": 0.4}
    said = learned_profile.in_words(FittedValues({**values, "n8": -0.1}))
    assert said == (
        "water that flows differently on the way south-east: 0.4 m/s towards 90° (east) at 0 m, "
        "0.1 m/s towards 180° (south) at 60 m"
    )
    turned = learned_profile.in_words(FittedValues({**values, "direction": 0.3}))  # by hand
    assert "differently on the way towards 17° (north)" in turned
    wide = dict.fromkeys(none, (-5.0, 5.0))
    assert learned_profile.in_words(FittedValues(values, wide)).endswith("nowhere surely")
    push = learned_profile.over_map(FittedValues({**values, "acts": 2.0}))
    strong = push.to_east > 1.0
    moved = learned_profile.in_words(FittedValues({**values, **MOVED}))
    assert "at -10 m" in moved  # its knot stands at 0.12 of the way
    np.testing.assert_allclose(push.to_east[strong], 40.0)
    corner = np.sqrt(0.5)  # all of these at 0 m on the way south-east
    np.testing.assert_allclose((push.east - push.north)[strong] * corner, 0.0, atol=1e-9)


SPOT = {
    **VALUES["learned_spot"],
    **MOVED,
    **{key: float(rng.normal()) for key in learned_spot.VALUES_AT},
}


@pytest.mark.parametrize("acts", [1.0, 2.0, 3.0, 4.0, 5.0])
def test_a_spot_is_linear_over_the_distance_and_acts_in_its_own_direction(acts: float) -> None:
    p = SimpleNamespace(**{**SPOT, "acts": acts, "x": 0.5})
    north, east = rng.uniform(-9.0, 9.0, 200), rng.uniform(-9.0, 9.0, 200)
    n, e = north - 2.0, east + 1.0
    d = np.hypot(n, e)
    size = np.interp(d, 6.0 * KNOTS, [SPOT[key] for key in learned_spot.VALUES_AT])
    way = {
        1.0: (np.cos(1.1), np.sin(1.1)), 2.0: (-e / d, n / d),
        3.0: (np.cos(1.1), np.sin(1.1)), 4.0: (-n / d, -e / d), 5.0: (n / d, e / d),
    }[acts]  # fmt: skip
    now = learned_spot.water(0.0, Pose(north, east, 0.0), p)
    pushed = learned_spot.force(flow(north=north, east=east), p)
    turned = learned_spot.force(flow(north=north, east=east, yaw=0.5 * np.pi), p)
    flows, pushes = (0.0, 100.0 * size) if acts in {3.0, 4.0} else (size, 0.0)
    np.testing.assert_allclose(now.north, flows * way[0], atol=1e-12)
    np.testing.assert_allclose(now.east, flows * way[1], atol=1e-12)
    np.testing.assert_allclose(pushed.X, pushes * way[0], atol=1e-9)
    np.testing.assert_allclose(pushed.Y, pushes * way[1], atol=1e-9)
    np.testing.assert_allclose(turned.X, pushed.Y, atol=1e-9)
    np.testing.assert_allclose(turned.N, 0.5 * turned.Y, atol=1e-9)


def test_at_its_own_middle_a_spot_is_no_hole() -> None:
    p = SimpleNamespace(**{**SPOT, "acts": 2.0})
    now = learned_spot.water(0.0, Pose(2.0, -1.0, 0.0), p)
    assert np.isfinite([now.north, now.east]).all()


def around(law: Any, seconds: float = 600.0, seed: int = 3) -> ResidualForce:
    """What a model leaves of a boat that winds about where a force [N] acts: (n, e) -> (X, Y)."""
    t = np.arange(0.0, seconds, 0.2)
    place = np.stack([25.0 * np.sin(0.05 * t), 20.0 * np.sin(0.037 * t + 1.0)], axis=1)
    force = np.stack(law(*place.T), axis=1)
    noise = np.random.default_rng(seed).normal(0.0, 3.0, force.shape)
    return ResidualForce(t, place, force - force.mean(axis=0) + noise)


def eddy(n: Any, e: Any) -> Any:
    size = -20.0 * np.exp(-0.5 * ((n - 6.0) ** 2 + (e + 4.0) ** 2) / 9.0**2) / 9.0
    return -size * (e + 4.0), size * (n - 6.0)


def spring(n: Any, e: Any) -> Any:
    around_n, around_e = eddy(n, e)
    return around_e, -around_n


def gust(n: Any, e: Any) -> Any:
    size = 30.0 * np.exp(-0.5 * ((n - 6.0) ** 2 + (e + 4.0) ** 2) / 8.0**2)
    return size * np.cos(2.0), size * np.sin(2.0)


def line(n: Any, e: Any) -> Any:
    away = np.hypot(n - 6.0, e + 4.0)
    pull = 4.0 * np.maximum(away - 9.0, 0.0) / away
    return -pull * (n - 6.0), -pull * (e + 4.0)


@pytest.mark.parametrize(
    ("law", "acts", "near"),
    [(eddy, 2.0, 4.0), (gust, 3.0, 4.0), (line, 4.0, 5.0), (spring, 5.0, 4.0)],
)
def test_a_spot_is_looked_for_where_the_missing_force_is_alike_around_it(
    law: Any, acts: float, near: float
) -> None:
    starts = learned_spot.search(WAMV, lambda: around(law))
    assert {start["acts"] for start in starts} == {1.0, 2.0, 3.0, 4.0, 5.0}
    first = next(start for start in starts if start["acts"] == acts)
    assert np.hypot(first["north"] - 6.0, first["east"] + 4.0) < near
    n, e = rng.uniform(-20.0, 20.0, 100), rng.uniform(-20.0, 20.0, 100)
    to_north, to_east = learned_spot.vector(
        n - first["north"], e - first["east"], acts, first["direction"]
    )
    d = np.hypot(n - first["north"], e - first["east"])
    size = np.interp(d, np.linspace(0.0, first["reach"], 9), [first[f"f{k}"] for k in range(9)])
    scored = sum((size * part) @ true for part, true in zip((to_north, to_east), law(n, e),
                                                           strict=True))  # fmt: skip
    whole = np.linalg.norm(size) * np.linalg.norm(law(n, e))
    assert scored > 0.7 * whole  # its sense and shape, too


def test_a_boat_that_lay_still_has_a_spot_where_it_lay() -> None:
    still = ResidualForce(np.arange(5.0), np.full((5, 2), 7.0), np.ones((5, 2)))
    starts = learned_spot.search(WAMV, lambda: still)
    assert all((start["north"], start["east"]) == (7.0, 7.0) for start in starts)
    assert all(np.isfinite(list(start.values())).all() for start in starts)


def test_a_spot_says_what_it_is_and_how_far_it_reaches() -> None:
    none = dict.fromkeys(learned_spot.VALUES_AT, 0.0)
    values = {**SPOT, **EVENLY, **none, "north": 4.2, "east": -7.0, "reach": 40.0, "f2": 0.42}
    said = learned_spot.in_words(FittedValues({**values, "acts": 2.0}))
    assert said == (
        "water that turns clockwise around N 4 m, E -7 m: +0 m/s 0 m away, +0 m/s 5 m away, "
        "+0.42 m/s 10 m away, +0 m/s 15 m away, +0 m/s 40 m away"
    )
    stream = learned_spot.in_words(FittedValues(values))
    assert stream.startswith("water that flows towards 63° (north-east) near N 4 m, E -7 m: ")
    pull = learned_spot.in_words(FittedValues({**values, "acts": 4.0}))
    assert pull.startswith("a pull towards N 4 m, E -7 m: ")
    assert "+42 N 10 m away" in pull
    field = learned_spot.over_map(FittedValues({**values, "acts": 4.0}))
    assert field.unit == "N"
    assert field.size.max() == pytest.approx(42.0, rel=0.2)
    away = np.hypot(field.north - 4.2, field.east + 7.0)
    assert away.max() <= 40.0
    inwards = field.to_north * (4.2 - field.north) + field.to_east * (-7.0 - field.east)
    assert (inwards >= 0.0).all()
    assert field.half.max() == 0.0


def test_a_spot_is_told_the_way_in_which_it_is_strongest() -> None:
    none = dict.fromkeys(learned_spot.VALUES_AT, 0.0)
    values = {**SPOT, **EVENLY, **none, "north": 4.2, "east": -7.0, "reach": 40.0}
    values |= {"f1": 0.1, "f2": -0.42}
    eddy = learned_spot.in_words(FittedValues({**values, "acts": 2.0}))
    assert eddy.startswith("water that turns anticlockwise around N 4 m, E -7 m: ")
    assert "-0.1 m/s 5 m away, +0.42 m/s 10 m away" in eddy
    stream = learned_spot.in_words(FittedValues(values))
    assert stream.startswith("water that flows towards 243° (south-west) near ")
    pushed = learned_spot.in_words(FittedValues({**values, "acts": 4.0}))
    assert pushed.startswith("a push away from N 4 m, E -7 m: ")
    spring = learned_spot.in_words(FittedValues({**values, "acts": 5.0}))
    assert spring.startswith("water that flows towards N 4 m, E -7 m: ")


def test_of_a_spot_only_what_is_known_is_told() -> None:
    """Nobody was within 10 m of the place, nor further off than 35 m."""
    none = dict.fromkeys(learned_spot.VALUES_AT, 0.0)
    values = {**SPOT, **EVENLY, **none, "acts": 4.0, "reach": 40.0, "f4": 0.2, "f6": 0.4, "f7": 0.5}
    ci95 = {key: (values[key] - 0.05, values[key] + 0.05) for key in none}
    ci95 |= dict.fromkeys(("f0", "f1", "f8"), (-0.9, 0.9))
    said = learned_spot.in_words(FittedValues(values, ci95))
    assert said.startswith("a pull towards N 2 m, E -1 m: +0 N 10 m away, ")
    assert said.endswith("+50 N 35 m away")
    wide = dict.fromkeys(none, (-5.0, 5.0))
    assert learned_spot.in_words(FittedValues(values, wide)).endswith(": nowhere surely")
    assert learned_spot.in_words(FittedValues({**values, **none})).endswith(": nowhere surely")
