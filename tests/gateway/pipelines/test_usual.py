"""Missing force live: near zero for the true vessel, told in words when something sets in."""

from typing import Any

import numpy as np
import pytest

from gateway.shadow.events import (
    FORCE_BLOCK_S,
    NEEDED_BLOCKS,
    PRACTICAL_SHARE,
    REMEMBERED_BLOCKS,
    MissingForceRange,
)
from gateway.shadow.path import ShadowRows
from gateway.shadow.residuals import ModelResiduals
from gateway.simulated_boat import FAST, SimulatedBoatSettings, TimedFrame
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.hull import program_of
from sim.effects.catalogue import EFFECTS
from sim.vessel import AddedEffect
from tests.gateway.pipelines.aboard import Deck, datagrams
from tests.sim.vessels import WAMV

MISSING = ("missing_surge_n", "missing_sway_n", "missing_yaw_nm")
CUBIC = next(effect for effect in EFFECTS if effect.name == "cubic_drag")
FOULED = WAMV.with_effects(AddedEffect(CUBIC, {"X_uuu": -40.0}))


def rows(missing: Any, std: float = 30.0) -> ShadowRows:
    """A row a second with that missing force (K, 3)."""
    count = len(missing)
    none, one = np.zeros((count, 9)), np.ones((count, 3))
    number, flag = np.arange(count), np.zeros(count, np.bool_)
    residuals = ModelResiduals(np.asarray(missing, float), std * one, one, np.zeros((count, 9)))
    return ShadowRows(
        number, number * 1.0, number * 10**9, number * 10**9, none, none, ~flag, flag, none, flag,
        none, one, flag, flag, flag, residuals, one, ~flag,
    )  # fmt: skip


def kinds(missing: Any) -> list[str]:
    return [happening.kind for happening in MissingForceRange.start().observe(rows(missing))[1]]


def noise(blocks: int, scale: float = 3.0) -> Any:
    return np.random.default_rng(3).normal(0.0, scale, (int(blocks * FORCE_BLOCK_S), 3))


def test_noise_alone_is_usual() -> None:
    assert kinds(noise(500)) == []


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_force_that_sets_in_is_told_once_and_once_more_when_it_is_gone(axis: int) -> None:
    missing = noise(NEEDED_BLOCKS + 40)
    missing[100:150, axis] += 60.0
    state, told = MissingForceRange.start().observe(rows(missing))
    assert [h.kind for h in told] == ["residual_unusual", "residual_usual"]
    assert 100e9 < told[0].vehicle_time_ns <= 110e9
    assert ("ahead", "to starboard", "clockwise")[axis] in told[0].text
    assert told[0].severity == "warning"
    assert state.unusual == (False, False, False)


@pytest.mark.parametrize(("force", "unusual"), [(-1.2, False), (2.1, False), (2.8, True)])
def test_what_lies_between_forces_that_were_there_is_not_unusual(
    force: float, unusual: bool
) -> None:
    """Mostly next to nothing, and 2 N either way now and then: "lacks -1.2 N, usually -2 to 2"."""
    blocks = np.full((60, 3), 0.01)
    blocks[::8, 0], blocks[1::8, 0] = -2.2, 2.3
    state = MissingForceRange.start()._replace(blocks=blocks)
    missing = np.tile([force, 0.01, 0.01], (round(3 * FORCE_BLOCK_S), 1))
    told = state.observe(rows(missing, std=0.1))[1]
    assert [h.kind for h in told] == (["residual_unusual"] if unusual else [])


@pytest.mark.parametrize(
    ("force", "says"),
    [
        (4.03, "the model lacks 4.03 N ahead, usually -4.00 to 4.00 N"),
        (-4.3, "the model lacks -4.3 N ahead, usually -4.0 to 4.0 N"),
        (60.0, "the model lacks 60.0 N ahead, usually -4.0 to 4.0 N"),
    ],
)
def test_what_is_unusual_is_also_written_beyond_the_usual(force: float, says: str) -> None:
    """The usual are the forces that were there, not the limits of what is told."""
    missing = np.zeros((120, 3))
    missing[:20, 0] = np.repeat([4.0, 4.0, -4.0, -4.0], 5)
    missing[100:, 0] = force
    (told, *_) = MissingForceRange.start().observe(rows(missing, 5.0))[1]
    assert told.text == says


def test_little_is_no_matter_however_calm_it_was_before() -> None:
    missing = noise(NEEDED_BLOCKS + 40, 0.01)
    missing[100:] += 10.0
    assert kinds(missing) == []


def test_a_force_that_comes_and_goes_is_one_event() -> None:
    missing = noise(NEEDED_BLOCKS + 40)
    for start in range(100, 180, 10):  # five seconds on, five off
        missing[start : start + 5, 0] += 60.0
    assert kinds(missing) == ["residual_unusual", "residual_usual"]


def test_what_is_small_beside_the_thrust_is_no_event() -> None:
    missing = noise(NEEDED_BLOCKS + 40, 0.01)
    missing[100:150, 0] += 3.0
    said = [
        [h.kind for h in MissingForceRange.start(vessel).observe(rows(missing, 0.05))[1]]
        for vessel in (WAMV, None)
    ]
    thrust = sum(t.thrust[1] for t in WAMV.thrusters)
    assert 3.0 < PRACTICAL_SHARE * thrust < 60.0
    assert said == [[], ["residual_unusual", "residual_usual"]]


def test_what_stays_for_minutes_is_usual_in_the_end_and_that_is_said() -> None:
    missing = noise(NEEDED_BLOCKS + REMEMBERED_BLOCKS + 100)
    missing[int((NEEDED_BLOCKS + 2) * FORCE_BLOCK_S) :, 0] += 60.0
    assert kinds(missing) == ["residual_unusual", "residual_usual"]


def test_how_rows_are_cut_into_chunks_makes_no_difference() -> None:
    missing = noise(NEEDED_BLOCKS + 20)
    missing[100:130, 0] += 60.0
    whole, state, told = rows(missing), MissingForceRange.start(), []
    for k in range(len(missing)):
        one = rows(missing[k : k + 1])
        vars(one).update(time_s=whole.time_s[k : k + 1], vehicle_time_ns=whole.row[k : k + 1])
        state, said = state.observe(one)
        told += [happening.kind for happening in said]
    assert told == kinds(missing)


def one_after_another(*legs: tuple[SimulatedBoat, float]) -> list[TimedFrame]:
    """Boats that take over from each other where the last one was; each plays until its time."""
    state, frames = legs[0][0].start(), list[TimedFrame]()
    for boat, until_s in legs:
        state, arrived = boat.advance(state, until_s)
        frames += arrived
    return frames


def boat(vessel: Any, program: str) -> SimulatedBoat:
    return SimulatedBoat(vessel, SimulatedBoatSettings(rates=FAST), 0, program_of(WAMV, program, 0))


@pytest.mark.slow
def test_the_true_vessel_lacks_nothing_and_an_effect_is_noticed_while_it_lasts() -> None:
    clean, fouled = boat(WAMV, "steps"), boat(FOULED, "steps")
    frames = one_after_another((clean, 90.0), (fouled, 115.0), (clean, 150.0))
    with Deck() as deck:
        heard = deck.hear(datagrams(frames)).heard()
    times = np.array(heard.column("residual", "vehicle_time_ns")) * 1e-9 - 1.7e9
    for name in MISSING:
        force, std = np.array([heard.column("residual", n) for n in (name, f"{name}_std")])
        calm = times < 90.0
        assert abs(force[calm].mean()) < 0.1 * std[calm].mean()
        assert np.sqrt(np.mean(force[calm] ** 2)) < std[calm].mean()
    (unusual, usual) = [m for m in heard.messages("event") if m["kind"].startswith("residual")]
    assert unusual["kind"] == "residual_unusual"
    assert "ahead" in unusual["says"]
    assert 90.0 < unusual["vehicle_time_ns"] * 1e-9 - 1.7e9 < 110.5
    assert usual["kind"] == "residual_usual"
    assert 110.0 < usual["vehicle_time_ns"] * 1e-9 - 1.7e9 < 135.5


@pytest.mark.slow
def test_ten_quiet_minutes_give_no_false_alarm() -> None:
    """From standing still to every manoeuvre there is."""
    frames = one_after_another((boat(WAMV, "still"), 120.0), (boat(WAMV, "mixed"), 600.0))
    with Deck() as deck:
        heard = deck.hear(datagrams(frames)).heard()
    assert heard.events() == ["started"]
    assert len(heard.payloads["residual"]) > 29_000
