"""Steering that hangs loose against the play of the books, which has no memory but its output."""

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.effects.steering_play import FOLLOWS_S
from sim.state import Floats
from sim.vessel import AddedEffect, Vessel
from tests.sim.simulated import on_floats
from tests.sim.vessels import RUDDER_BOAT, STEERED_BOAT

DT, PERIOD_S, SWING, PLAY = 0.05, 8.0, 0.5, 0.08


def played(asked: Floats, play: float) -> Floats:
    """The classical operator, row by row: pushed along by either end of the gap."""
    out, now = np.empty(len(asked)), 0.0
    for k, angle in enumerate(asked):
        now = min(max(now, angle - play), angle + play)
        out[k] = now
    return out


@pytest.mark.parametrize("vessel", [RUDDER_BOAT, STEERED_BOAT], ids=lambda v: v.name)
def test_a_helm_that_swings_is_followed_the_gap_behind_and_held_as_it_comes_back(
    vessel: Vessel,
) -> None:
    time = DT * np.arange(480)
    commands = np.zeros((len(time), len(vessel.actuators)))
    commands[:, 0] = 0.6
    commands[:, -1] = SWING * np.sin(2.0 * np.pi * time / PERIOD_S)
    asked = commands[:, -1] * vessel.rudders[-1].angle[1]
    loose = vessel.with_effects(AddedEffect(named("steering_play"), {"play": PLAY}))
    model = on_floats(loose)
    states, _ = model.simulate(commands, DT, np.zeros(model.state_size))
    stands, books = states[0, 1 : len(time) + 1, -1], played(asked, PLAY)
    fastest = np.abs(np.diff(asked)).max() / DT
    assert np.abs(stands - books).max() < 1.1 * FOLLOWS_S * fastest
    assert np.abs(books - asked).max() == pytest.approx(PLAY, rel=1e-6)
    held = np.abs(np.diff(stands)) < 1e-12  # after each turn of the helm, until the gap is crossed
    assert 0.1 < held[160:].mean() < 0.6
