"""The table that takes any shape: its values between the knots, and what it is told as."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim.effects.learned import (
    AFT,
    AHEAD,
    ANGLE,
    BATTERY,
    EFFECT,
    EVENLY,
    HEADING,
    KNOTS,
    MOTOR,
    OUTWARD,
    RUDDER,
    SIDEWAYS,
    SURGE,
    SWAY,
    THRUST,
    TURNING,
    YAW,
    angle,
    force,
    in_words,
    mismatch,
    reaction,
    table,
    tables,
    thrust,
)
from tests.sim.vessels import RUDDER_BOAT, WAMV

SHARES = {f"f{k}": 0.1 * (-1) ** k * k for k in range(KNOTS)}
BASE = {**EFFECT.example, **SHARES}


def at(x: np.ndarray, **values: float) -> np.ndarray:
    return np.asarray(table(x, SimpleNamespace(**{**BASE, **values})))


def test_between_the_knots_it_is_linear_and_beyond_them_constant() -> None:
    x = np.linspace(-1.0, 3.0, 101)
    knots = np.linspace(0.0, 2.0, KNOTS)
    np.testing.assert_allclose(at(x), np.interp(x, knots, list(SHARES.values())), atol=1e-12)


MOVED = dict(zip(EVENLY, (0.1, 0.12, 0.3, 0.5, 0.52, 0.7, 0.9), strict=True))


def test_knots_that_were_moved_are_where_they_are_said_to_be() -> None:
    x = np.linspace(-1.0, 3.0, 401)
    knots = 2.0 * np.array([0.0, *MOVED.values(), 1.0])
    expected = np.interp(x, knots, list(SHARES.values()))
    np.testing.assert_allclose(at(x, **MOVED), expected, atol=1e-12)


def test_a_file_that_says_nothing_of_them_has_them_at_even_places() -> None:
    old = {key: value for key, value in BASE.items() if key not in EVENLY}
    defaults = {p.name: p.default for p in EFFECT.parameters if p.default is not None}
    assert defaults == EVENLY
    x = np.linspace(0.0, 2.0, 50)
    np.testing.assert_array_equal(table(x, SimpleNamespace(**old, **defaults)), at(x))


@pytest.mark.parametrize("wrong", [{"at3": 0.2}, {"at1": 0.0}, {"at7": 1.0}])
def test_knots_that_do_not_rise_are_refused(wrong) -> None:
    assert mismatch(WAMV, {**BASE, **wrong}) == "at1 … at7 must rise, between 0 and 1"
    assert not mismatch(WAMV, {**BASE, **MOVED})


def test_a_step_is_told_by_its_two_edges() -> None:
    """Five of nine knots, wherever they are: those between which the curve bends."""
    step = {f"f{k}": -0.4 if k >= 5 else 0.0 for k in range(KNOTS)}
    said = in_words({**BASE, **step, **MOVED})
    assert "+0 N at 1 m/s, -40 N at 1.04 m/s" in said
    assert said.count(" N at ") == 5


def test_a_heading_has_no_end() -> None:
    around = {"by": HEADING, "high": 2.0 * np.pi}
    x = np.linspace(0.0, 2.0 * np.pi, 50)
    for turns in (-2, 1):
        np.testing.assert_allclose(
            at(x + turns * 2.0 * np.pi, **around), at(x, **around), atol=1e-9
        )
    assert at(np.array(-1e-9), **around) == pytest.approx(SHARES["f0"], abs=1e-6)
    assert at(np.array(-1e-9)) == SHARES["f0"]


def test_a_heading_may_begin_anywhere_on_the_circle() -> None:
    around = {"by": HEADING, "low": -np.pi, "high": np.pi}
    knots, x = np.linspace(-np.pi, np.pi, KNOTS), np.linspace(-9.0, 9.0, 60)
    shares = [*list(SHARES.values())[:-1], SHARES["f0"]]
    expected = np.interp((x + np.pi) % (2.0 * np.pi) - np.pi, knots, shares)
    np.testing.assert_allclose(at(x, **around), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "parts", "never"),
    [
        ({}, ("force ahead with the speed ahead", "-30 N at 1 m/s"), "origin"),
        ({"acts": SWAY, "x": -0.44}, ("force to starboard -0.44 m from the origin",), "moment"),
        ({"acts": YAW}, ("moment", "half the hull's length", "-30 N at 1 m/s"), "origin"),
        ({"acts": THRUST}, ("share of the thrust", "-30 % at 1 m/s"), " N "),
        (
            {"by": TURNING, "acts": THRUST, "high": np.pi / 3},
            ("share of the thrust that changes with the yaw rate", "-30 % at 30 °/s"),
            " N ",
        ),
        ({"by": HEADING, "high": 2.0 * np.pi}, ("with the heading", "-30 N at 180 °"), "m/s"),
        ({"by": MOTOR, "high": 1.0}, ("thrust of each motor", "-30 N at 50 %"), "m/s"),
        (
            {"by": MOTOR, "acts": OUTWARD, "high": 1.0, "x": -0.8},
            ("share of the thrust as a force outward -0.80 m from the origin", "-30 % at 50 %"),
            " N ",
        ),
        (
            {"by": BATTERY, "acts": THRUST, "low": 12.0, "high": 16.0},
            ("share of the thrust that changes with the battery's voltage", "-30 % at 14 V"),
            " N ",
        ),
        (
            {"by": RUDDER, "acts": ANGLE, "low": -np.pi / 3, "high": np.pi / 3},
            ("angle of the steering that differs with the angle", "-17.2° at 0 °"),
            " N ",
        ),
    ],
)
def test_it_is_told_in_the_units_of_its_variable(values, parts, never) -> None:
    said = in_words({**EFFECT.example, **values})
    for part in parts:
        assert part in said
    assert never not in said


def test_a_share_that_is_the_same_everywhere_does_not_change() -> None:
    level = {f"f{k}": -0.31 - 0.01 * (k % 2) for k in range(KNOTS)}
    turning = {**EFFECT.example, "by": TURNING, "acts": THRUST, "high": np.pi / 3}
    said = in_words({**turning, **level})
    assert "a share of the thrust, nearly the same whatever the yaw rate: -31 %" in said
    assert "changes" not in said
    assert "changes" in in_words({**turning, **level, "f8": -0.41})


def test_the_first_knot_is_where_the_table_begins() -> None:
    x = np.linspace(-2.0, 3.0, 101)
    knots = np.linspace(-0.8, 1.6, KNOTS)
    np.testing.assert_allclose(
        at(x, low=-0.8, high=1.6), np.interp(x, knots, list(SHARES.values())), atol=1e-12
    )


FLOW = SimpleNamespace(
    u=0.25, v=0.5, r=0.75, yaw=1.0, voltage=np.nan, body=SimpleNamespace(length=5.0)
)
LINE = {f"f{k}": 0.125 * k for k in range(KNOTS)} | {"low": 0.0, "high": 2.0}  # y = x / 2
DRIVE = SimpleNamespace(ahead=80.0, y=-0.3)


@pytest.mark.parametrize(
    ("by", "y"), [(AHEAD, 0.125), (SIDEWAYS, 0.25), (TURNING, 0.375), (HEADING, 0.5), (MOTOR, 0.0)]
)
def test_a_table_reads_one_variable_of_the_motion_and_pushes_along_one_axis(by, y) -> None:
    """A hundred newtons for a value of one, a moment at half the hull's length."""
    pushes = {SURGE: (1, 0, 0), SWAY: (0, 1, -0.4), YAW: (0, 0, 2.5), THRUST: (0, 0, 0)}
    for acts, push in pushes.items():
        p = SimpleNamespace(**{**EFFECT.example, **LINE, "by": by, "acts": acts, "x": -0.4})
        np.testing.assert_allclose(force(FLOW, p), 100.0 * y * np.array(push), atol=1e-12)
        motor = 0.25 if by == MOTOR else 0.0  # 40 of 80 N
        np.testing.assert_allclose(
            reaction(40.0, DRIVE, FLOW, p), 100.0 * motor * np.array(push), atol=1e-12
        )
        share = (y or 0.25) if acts == THRUST else 0.0
        assert thrust(40.0, DRIVE, FLOW, p) == pytest.approx(40.0 * (1.0 + share))


def test_an_angle_of_the_steering_is_another_than_commanded_and_nothing_else() -> None:
    p = SimpleNamespace(**{**EFFECT.example, **LINE, "by": RUDDER, "acts": ANGLE})
    assert [angle(δ, DRIVE, p) for δ in (-1.0, 0.0, 0.5)] == pytest.approx([-1.0, 0.0, 0.75])
    assert force(FLOW, p) == (0.0, 0.0, 0.0)
    assert reaction(40.0, DRIVE, FLOW, p) == (0.0, 0.0, 0.0)
    assert thrust(40.0, DRIVE, FLOW, p) == 40.0
    p.acts = THRUST
    assert angle(0.5, DRIVE, p) == 0.5


def test_a_share_of_the_thrust_goes_outward_on_either_side_and_nowhere_amidships() -> None:
    p = SimpleNamespace(**{**EFFECT.example, **LINE, "by": MOTOR, "acts": OUTWARD, "x": -0.4})
    for y, sign in ((0.3, 1.0), (-0.3, -1.0), (0.0, 0.0)):
        drive = SimpleNamespace(ahead=80.0, y=y)
        # half of the thrust ahead: a quarter of it goes outward
        assert reaction(40.0, drive, FLOW, p) == pytest.approx((0.0, 10.0 * sign, -4.0 * sign))
        assert thrust(40.0, drive, FLOW, p) == 40.0
    assert force(FLOW, p) == (0.0, 0.0, 0.0)


def test_only_motors_on_both_sides_push_outward() -> None:
    extent = {"u": (-0.5, 2.0), "v": (-0.3, 0.4), "r": (-0.2, 0.1)}
    port, starboard = WAMV.thrusters
    outward = [t for t in tables(WAMV, extent) if t["acts"] == OUTWARD]
    assert {t["by"] for t in outward} == {MOTOR}
    assert [t["x"] for t in outward] == [port.position[0], -AFT * WAMV.hull.length]
    one_side = replace(WAMV, thrusters=(port, replace(starboard, position=port.position)))
    assert OUTWARD not in {t["acts"] for t in tables(one_side, extent)}


def test_of_a_motor_that_never_ran_astern_no_knot_says_anything_there() -> None:
    extent = {"u": (-0.5, 2.0), "v": (-0.3, 0.4), "r": (-0.2, 0.1)}

    def lowest(commands: tuple[float, float]) -> set[float]:
        found = tables(WAMV, extent | {"motor": commands})
        return {t["low"] for t in found if t["by"] == MOTOR}

    assert lowest((-0.01, 0.9)) == {0.0}
    assert (
        lowest((-0.3, 0.9))
        == {min(t.thrust[0] / t.thrust[1] for t in WAMV.thrusters)}
        == {t["low"] for t in tables(WAMV, extent) if t["by"] == MOTOR}
    )


def test_a_thrust_over_the_voltage_needs_one_that_was_measured_and_changes() -> None:
    extent = {"u": (-0.5, 2.0), "v": (-0.3, 0.4), "r": (-0.2, 0.1)}
    assert BATTERY not in {t["by"] for t in tables(WAMV, extent)}
    assert BATTERY not in {t["by"] for t in tables(WAMV, extent | {"voltage": (16.0, 16.4)})}
    found = tables(WAMV, extent | {"voltage": (14.0, 16.4)})
    (of_volts,) = (t for t in found if t["by"] == BATTERY)
    assert (of_volts["acts"], of_volts["low"], of_volts["high"]) == (THRUST, 14.0, 16.4)
    p = SimpleNamespace(**{**BASE, "by": BATTERY, "acts": THRUST, "low": 12.0, "high": 16.0})
    drive = SimpleNamespace(ahead=50.0)

    def given(volts: float) -> float:
        still = SimpleNamespace(u=0.3, v=0.1, r=0.2, yaw=1.0, voltage=volts)
        return thrust(20.0, drive, still, p)  # type: ignore[arg-type]

    assert given(14.0) == pytest.approx(20.0 * (1.0 + SHARES["f4"]))
    assert given(np.nan) == 20.0
    of_speed = SimpleNamespace(**{**BASE, "acts": THRUST})
    unknown = SimpleNamespace(u=1.0, v=0.0, r=0.0, yaw=0.0, voltage=np.nan)
    assert thrust(20.0, drive, unknown, of_speed) == pytest.approx(20.0 * (1.0 + SHARES["f4"]))  # type: ignore[arg-type]
    assert "goes with acts = 4 (thrust) alone" in mismatch(WAMV, {**BASE, "by": BATTERY})


def test_only_what_steers_has_an_angle_to_fill() -> None:
    extent = {"u": (-0.5, 2.0), "v": (-0.3, 0.4), "r": (-0.2, 0.1)}
    (of_angle,) = (t for t in tables(RUDDER_BOAT, extent) if t["acts"] == ANGLE)
    most = max(rudder.angle[1] for rudder in RUDDER_BOAT.rudders)
    assert (of_angle["by"], of_angle["high"]) == (RUDDER, most)
    assert of_angle["low"] < 0.0


def test_what_could_be_filled_is_every_pair_over_the_range_that_was_sailed() -> None:
    extent = {"u": (-0.5, 2.0), "v": (-0.3, 0.4), "r": (-0.2, 0.1)}
    found = list(tables(WAMV, extent))
    pairs = [(t["by"], t["acts"]) for t in found]
    hull, motions = (SURGE, SWAY, YAW), (AHEAD, SIDEWAYS, TURNING)
    expected = {(by, acts) for by in (*motions, HEADING, MOTOR) for acts in hull}
    assert set(pairs) == expected | {(by, THRUST) for by in (*motions, MOTOR)} | {(MOTOR, OUTWARD)}
    places = [(t["by"], t["acts"], t["x"]) for t in found]
    assert len(places) == len(set(places))
    aft = -AFT * WAMV.hull.length
    pushes = [t["by"] for t in found if t["acts"] == SWAY and t["x"] == aft]
    assert set(pushes) == {*motions, HEADING, MOTOR}  # from the origin and from the stern
    ranges = {t["by"]: (t["low"], t["high"]) for t in found}
    assert ranges == {
        AHEAD: (-0.5, 2.0), SIDEWAYS: (-0.3, 0.4), TURNING: (-0.2, 0.1),
        HEADING: (0.0, 2.0 * np.pi), MOTOR: (-85.0 / 90.0, 1.0),
    }  # fmt: skip
    for t in found:
        assert (t["full"], {t[f"f{k}"] for k in range(KNOTS)}) == (180.0, {0.0})
        assert t["acts"] in {SWAY, OUTWARD} or t["x"] == 0.0
    drifting = list(tables(replace(WAMV, thrusters=()), extent))
    assert MOTOR not in {t["by"] for t in drifting}
    assert {t["full"] for t in drifting} == {1.0}
