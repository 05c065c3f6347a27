"""Tables over two variables: values between the knots, what they act on, what they say."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from sim.body import Flow
from sim.effects import learned_pair
from sim.effects.learned_formula import HEADING, MOTOR, THRUST
from sim.effects.words import FittedValues
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.vessels import RUDDER_BOAT, VALUES, WAMV

rng = np.random.default_rng(7)
PAIR = {**VALUES["learned_pair"], **{key: float(rng.normal()) for key in learned_pair.KEYS}}
KNOTS = np.array([PAIR[key] for key in learned_pair.KEYS]).reshape(4, 4)
EMPTY = {**PAIR, **dict.fromkeys(learned_pair.KEYS, 0.0)}
DRIVE: Any = SimpleNamespace(ahead=80.0)


def flow(**values: Any) -> Flow:
    body = SimpleNamespace(length=3.0)
    return Flow(**{**dict.fromkeys(Flow._fields, 0.0), "body": body, **values})


def of(**values: float) -> Any:
    return SimpleNamespace(**{**PAIR, **values})


def test_a_pair_is_bilinear_between_its_knots_and_constant_beyond_them() -> None:
    a, b = rng.uniform(-1.0, 3.0, 200), rng.uniform(-2.0, 2.0, 200)
    inside = np.stack([np.clip(a, 0.0, 2.0), np.clip(b, -1.0, 1.0)], axis=1)
    between = RegularGridInterpolator((np.linspace(0.0, 2.0, 4), np.linspace(-1.0, 1.0, 4)), KNOTS)
    np.testing.assert_allclose(learned_pair.table(a, b, of()), between(inside), atol=1e-12)


def test_a_heading_has_no_end() -> None:
    p = of(by=learned_pair.WITH_HEADING, b_low=0.0, b_high=2.0 * np.pi)
    b = rng.uniform(-10.0, 10.0, 300)
    a = np.full_like(b, 1.1)
    around = np.column_stack([KNOTS, KNOTS[:, 0]])
    grid = np.linspace(0.0, 2.0, 4), np.linspace(0.0, 2.0 * np.pi, 5)
    wanted = RegularGridInterpolator(grid, around)(np.stack([a, b % (2.0 * np.pi)], axis=1))
    np.testing.assert_allclose(learned_pair.table(a, b, p), wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("by", "motion"),
    [
        (learned_pair.WITH_HEADING, {"u": 0.5, "yaw": 0.3}),
        (learned_pair.WITH_SWAY, {"u": 0.5, "v": 0.3}),
        (learned_pair.WITH_TURN, {"u": 0.5, "r": 0.3}),
        (learned_pair.SWAY_AND_TURN, {"v": 0.5, "r": 0.3}),
    ],
)
def test_a_push_depends_on_its_two_variables_alone(by: float, motion: dict[str, float]) -> None:
    p = of(by=by, acts=learned_pair.SWAY, x=0.4)
    now = learned_pair.force(flow(**motion), p)
    assert now.Y == pytest.approx(100.0 * learned_pair.table(0.5, 0.3, p))
    assert (now.X, now.N) == (0.0, pytest.approx(0.4 * now.Y))
    others = dict.fromkeys({"u", "v", "r", "yaw", "time"} - motion.keys(), 0.7)
    if by == learned_pair.SWAY_AND_TURN:
        others.pop("yaw", None)
    assert learned_pair.force(flow(**motion, **others), p) == now
    assert learned_pair.reaction(40.0, DRIVE, flow(**motion), p).Y == 0.0
    assert learned_pair.thrust(40.0, DRIVE, flow(**motion), p) == 40.0


def test_each_motor_has_a_share_and_a_push_of_its_own() -> None:
    moving, y = flow(u=0.5), learned_pair.table(0.5, 0.5, of())
    assert learned_pair.thrust(40.0, DRIVE, moving, of(acts=THRUST)) == pytest.approx(
        40.0 * (1.0 + y)
    )
    turn = learned_pair.reaction(40.0, DRIVE, moving, of(acts=learned_pair.YAW))
    assert turn.N == pytest.approx(150.0 * y)
    side = learned_pair.reaction(40.0, DRIVE, moving, of(acts=learned_pair.SWAY))
    assert side.Y == pytest.approx(100.0 * y)
    assert learned_pair.force(moving, of(acts=learned_pair.SWAY)).Y == 0.0


def test_empty_tables_span_what_was_sailed() -> None:
    extent = {"u": (-0.4, 2.1), "v": (-0.3, 0.2), "r": (-0.5, 0.6)}
    empty = learned_pair.tables(RUDDER_BOAT, extent)
    for one in empty:
        a, b = learned_pair.PAIRS[one["by"]]
        assert (one["a_low"], one["a_high"]) == ((-0.3, 0.2) if a != 1.0 else (-0.4, 2.1))
        assert b != HEADING or (one["b_low"], one["b_high"]) == (0.0, 2.0 * np.pi)
        assert b != MOTOR or one["b_low"] < 0.0 < one["b_high"] == 1.0
    assert {(one["by"], one["acts"]) for one in empty} == {
        (by, acts) for by, every in learned_pair.ACTS.items() for acts in every
    }
    for motor, astern in (((-0.5, 1.0), True), ((0.0, 1.0), False)):  # none ran astern
        ran = learned_pair.tables(RUDDER_BOAT, extent | {"motor": motor})
        assert {one["b_low"] < 0.0 for one in ran if one["by"] == 1.0} == {astern}
    drifting = SimpleNamespace(thrusters=())
    left = learned_pair.tables(drifting, extent)
    assert left
    assert not [one for one in left if one["acts"] == THRUST or one["by"] == 1.0]


def test_an_empty_pair_is_nothing() -> None:
    states = [
        Model.of(vessel).simulate([[0.6, 0.2]] * 100, 0.1)[0]
        for vessel in (WAMV, WAMV.with_effects(AddedEffect(learned_pair.EFFECT, EMPTY)))
    ]
    np.testing.assert_allclose(*states, atol=1e-12)


def test_a_pair_says_where_it_is_strongest_and_where_it_differs_most() -> None:
    thrust = {**EMPTY, "acts": THRUST, "b_low": -0.5, "h33": -0.6, "h02": 0.05}
    assert learned_pair.in_words(FittedValues(thrust)) == (
        "a share of the thrust that changes with the speed ahead and the thrust of each motor: "
        "-60 % at 2 m/s and 100 %, +5 % at 0 m/s and 50 %"
    )
    heading = {**EMPTY, "by": learned_pair.WITH_HEADING, "acts": learned_pair.SURGE,
               "b_low": 0.0, "b_high": 2.0 * np.pi, "h23": -0.08}  # fmt: skip
    said = learned_pair.in_words(FittedValues(heading))
    assert said.startswith("a force ahead with the speed ahead and the heading: -8 N at 1.33 m/s")
    assert "and 270 °" in said


def test_what_is_not_known_is_not_told() -> None:
    wide = dict.fromkeys(learned_pair.KEYS, (-3.0, 3.0))
    few = {**EMPTY, "h22": -1.1, "h11": 0.4}
    said = learned_pair.in_words(FittedValues(few, wide))
    assert said.endswith(": -110 % at 1.33 m/s and 33.3 %, though no single knot is sure")
    one = {**EMPTY, "h11": -0.4, "h33": 1.9}
    ends = {"h11": (-0.45, -0.35), "h33": (-2.0, 5.8)}
    said = learned_pair.in_words(FittedValues(one, ends))
    assert "-40 %" in said
    assert "+190 %" not in said
