"""What comes and goes: when it acts, on what, how it is looked for, what it says."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.effects import learned_rhythm as rhythm
from sim.effects.effect import ForceAxis, ResidualForce
from sim.effects.words import FittedValues
from tests.sim.effects.test_learned_places import flow
from tests.sim.vessels import VALUES, WAMV

RHYTHM = {**VALUES["learned_rhythm"], "width": 0.05}
PERIOD_S = 15.0 / 3.0


def test_it_is_there_for_as_long_as_it_says_in_every_period() -> None:
    time = np.arange(-20.0, 40.0, 0.01)
    there = rhythm.gate(time, SimpleNamespace(**RHYTHM))
    since = (time - RHYTHM["since"]) % PERIOD_S
    sure = np.minimum(np.abs(since - RHYTHM["lasts"]), np.minimum(since, PERIOD_S - since)) > 0.2
    np.testing.assert_allclose(there[sure], (since < RHYTHM["lasts"])[sure], atol=1e-3)
    assert there.mean() == pytest.approx(RHYTHM["lasts"] / PERIOD_S, rel=0.02)


def test_it_acts_on_what_it_says_alone() -> None:
    body, drive = SimpleNamespace(X_u=-10.0, X_uu=-20.0), SimpleNamespace(number=1.0)
    at = flow(time=2.3, u=2.0, yaw=1.1, body=body)  # in its middle, ahead is where it pushes

    def acting(acts: float, thruster: float = 2.0) -> tuple[float, float, float]:
        p = SimpleNamespace(**{**RHYTHM, "acts": acts, "thruster": thruster})
        pushed, thrust = rhythm.force(at, p), rhythm.thrust(50.0, drive, at, p)  # type: ignore[arg-type]
        return pushed.X, pushed.Y, thrust

    assert acting(rhythm.PUSH) == pytest.approx((30.0, 0.0, 50.0), abs=1e-6)
    assert acting(rhythm.DRAG) == pytest.approx((0.3 * -50.0 * 2.0, 0.0, 50.0), abs=1e-6)
    assert acting(rhythm.THRUST) == pytest.approx((0.0, 0.0, 65.0), abs=1e-6)
    assert acting(rhythm.THRUST, 1.0) == pytest.approx((0.0, 0.0, 50.0), abs=1e-6)


def left_by(law: Any, seconds: float = 600.0, seed: int = 3) -> ResidualForce:
    """What a model leaves of a boat that winds about: (time, u, commands) -> world force, body."""
    rng, t = np.random.default_rng(seed), np.arange(7.0, seconds, 0.1)
    u = 1.2 + 0.5 * np.sin(0.11 * t)
    commands = np.stack([0.5 + 0.4 * np.sin(0.13 * t), 0.5 + 0.4 * np.cos(0.21 * t)], axis=1)
    world, body = law(t, u, commands)
    noisy = [part + rng.normal(0.0, 5.0, part.shape) for part in (world, body)]
    nu = np.stack([u, np.zeros_like(u), np.zeros_like(u)], axis=1)
    world = noisy[0] - noisy[0].mean(axis=0)
    return ResidualForce(t, np.zeros((len(t), 2)), world, noisy[1], nu, commands)


def squalls(t: Any, u: Any, commands: Any) -> Any:
    on = 40.0 * (t % 75.0 < 20.0)
    return np.stack([on * np.cos(2.0), on * np.sin(2.0)], axis=1), np.zeros((len(t), 3))


def stutter(t: Any, u: Any, commands: Any) -> Any:
    """The second motor stops for 3 s in each 11."""
    drive = WAMV.thrusters[1]
    lost = -drive.thrust[1] * commands[:, 1] * (t % 11.0 < 3.0)
    body = np.stack([lost, np.zeros_like(t), -drive.position[1] * lost], axis=1)
    return np.zeros((len(t), 2)), body


def weed(t: Any, u: Any, commands: Any) -> Any:
    own = WAMV.dynamics
    drag = 1.5 * (own.X_u + own.X_uu * np.abs(u)) * u * (t % 40.0 < 12.0)
    zero = np.zeros_like(t)
    return np.zeros((len(t), 2)), np.stack([drag, zero, zero], axis=1)


@pytest.mark.parametrize(
    ("law", "acts", "motor", "period", "lasts", "size"),
    [
        (squalls, rhythm.PUSH, 1.0, 75.0, 20.0, None),
        (stutter, rhythm.THRUST, 2.0, 11.0, 3.0, -1.0),
        (weed, rhythm.DRAG, 1.0, 40.0, 12.0, 1.5),
    ],
)
def test_it_is_looked_for_in_what_is_left_folded_with_every_period(
    law: Any, acts: float, motor: float, period: float, lasts: float, size: float | None
) -> None:
    left = left_by(law)
    starts = rhythm.search(WAMV, lambda: left)
    first = next(s for s in starts if (s["acts"], s["thruster"]) == (acts, motor))
    assert (first["until"] - first["since"]) / first["times"] == pytest.approx(period, rel=2e-3)
    assert first["lasts"] == pytest.approx(lasts, rel=0.15)
    off = (first["since"] + 0.5 * lasts) % period - 0.5 * lasts  # begins with the period
    assert min(off % period, -off % period) < 1.0
    if size is None:
        assert first["size"] * first["full"] == pytest.approx(40.0, rel=0.1)
        assert first["direction"] == pytest.approx(2.0, abs=0.1)
    else:
        assert first["size"] == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize(
    ("period", "alike"),
    [
        (10.05, True),  # a rate next to it
        (20.1, True),  # every second time
        (13.7, False),
        (26.0, False),
    ],
)
def test_a_period_next_to_another_or_some_of_it_is_no_start_of_its_own(
    period: float, alike: bool
) -> None:
    one, other = (rhythm.Window(1.0, p, 0.0, 3.0, 1.0, 0.0) for p in (10.0, period))
    assert rhythm._is_like(one, other, apart=1e-3) is alike
    assert rhythm._is_like(other, one, apart=1e-3) is alike


def test_a_recording_that_is_too_short_for_a_rhythm_has_one_start() -> None:
    left = left_by(squalls, 25.0)
    (start,) = rhythm.search(WAMV, lambda: left)
    assert np.isfinite(list(start.values())).all()


def test_what_is_no_rhythm_of_a_vessel_is_said() -> None:
    assert rhythm.mismatch(WAMV, RHYTHM) == ""
    many = {**RHYTHM, "acts": rhythm.THRUST, "thruster": 3.0}
    assert rhythm.mismatch(WAMV, many) == "thruster = 3: the vessel has 2"
    assert "later" in rhythm.mismatch(WAMV, {**RHYTHM, "until": 1.0})


def test_it_says_how_often_for_how_long_and_how_much() -> None:
    push = rhythm.in_words(FittedValues(RHYTHM))
    assert push == (
        "a push over the ground that comes and goes every 5 s, for 2.1 s: 30 N towards "
        "63° (north-east)"
    )
    back = rhythm.in_words(FittedValues({**RHYTHM, "size": -0.3}))
    assert back.endswith("30 N towards 243° (south-west)")
    sure_push = rhythm.in_words(FittedValues(RHYTHM, {"size": (0.25, 0.35)}))
    assert sure_push.endswith("for 2.1 s: 30 N (25–35 N) towards 63° (north-east)")
    sure = {"size": (-1.1, -0.9)}
    stops = rhythm.in_words(FittedValues({**RHYTHM, "acts": 2.0, "size": -1.0}, sure))
    assert stops == (
        "a thrust of thruster 1 that changes and comes back every 5 s, for 2.1 s: "
        "100 % (90–110 %) less"
    )
    little = rhythm.in_words(FittedValues({**RHYTHM, "acts": 3.0, "size": 0.2}))
    assert little.endswith("20 % more")
    weed = rhythm.in_words(FittedValues({**RHYTHM, "acts": 3.0, "size": 0.5}))
    assert weed.startswith("a drag that changes and comes back every 5 s")
    assert weed.endswith("50 % more")


def test_its_evidence_is_drawn_over_the_period() -> None:
    push = rhythm.EFFECT.evidence_axis(RHYTHM)
    assert push is not None
    assert (push.axis, push.by) == (ForceAxis.ALONG, "phase")
    drag = rhythm.EFFECT.evidence_axis({**RHYTHM, "acts": rhythm.DRAG})
    assert drag is not None
    assert drag.axis is ForceAxis.SURGE
    assert push.variable is not None
    since = RHYTHM["since"]
    at = push.variable(np.array([since, since + 0.25 * PERIOD_S, since - PERIOD_S]), 0, 0, RHYTHM)
    np.testing.assert_allclose(np.minimum(at, 2.0 * np.pi - at), [0.0, 0.5 * np.pi, 0.0], atol=1e-9)
