"""Trains of waves are met closely enough to begin a fit, however far the boat has moved."""

from dataclasses import replace
from math import pi, remainder

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.effects.effect import Values
from sim.effects.wave_trains import _Samples
from sim.identification.search import start_points
from sim.model import Model
from sim.trial import Trial
from tests.sim.diagnosis.sailed import sailed, with_effect
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V, commands, trial_of


def waves(model: Model, trial: Trial) -> list[Values]:
    """Where a search for a train of waves begins."""
    return start_points(named("wave_motion"), model, [trial])


@pytest.mark.parametrize(("omega", "direction"), [
    (1.2, 0.3),
    *(pytest.param(*w, marks=pytest.mark.slow) for w in ((2.2, 2.5), (1.7, -2.0), (3.1, 1.57))),
])  # fmt: skip
def test_one_train_is_found(omega: float, direction: float) -> None:
    trial = sailed(
        "wave_motion", 400.0, force=40.0, omega=omega, direction=direction, phase=0.7
    )  # fmt: skip
    first = waves(Model.of(WAM_V), trial)[0]
    assert first["omega"] == pytest.approx(omega, abs=0.01)
    assert remainder(first["direction"] - direction, 2.0 * pi) == pytest.approx(0.0, abs=0.04)
    assert first["force"] == pytest.approx(40.0, rel=0.4)  # a filter rounds accelerations


def test_the_power_of_a_grid_is_that_of_each_of_its_points() -> None:
    """From one frequency to the next the phase goes on: written out beside it, window by window."""
    draw = np.random.default_rng(2)
    time, window = 0.4 * np.arange(600.0), 50.0
    samples = _Samples(time, draw.normal(size=(600, 2)).cumsum(axis=0), draw.normal(size=(600, 2)))
    omega, direction = np.arange(0.8, 6.0, 0.04), np.array([0.3, 2.0, -1.1])
    filtered = samples.filtered(*np.meshgrid(omega, direction))
    sums = np.stack([filtered[..., time // window == k].sum(axis=-1) for k in range(5)])
    expected = np.sum(np.abs(sums) ** 2, axis=0)
    np.testing.assert_allclose(samples.power(omega, direction, window), expected, rtol=1e-9)


def test_a_fault_may_be_of_each_thruster_or_of_all() -> None:
    """Of a single thruster "all" would say the same again."""
    trial = sailed("thruster_fault", 40.0, thruster=0.0, gain=0.5, time=20.0)
    single = replace(WAM_V, thrusters=WAM_V.thrusters[:1])
    for vessel, thrusters in ((WAM_V, {0.0, 1.0, 2.0}), (single, {1.0})):
        starts = start_points(named("thruster_fault"), Model.of(vessel), [trial])
        assert {s["thruster"] for s in starts} == thrusters


def two_trains() -> Trial:
    """Swell from one side, wind sea from another."""
    drive = commands(400.0, 0.1, 2)
    vessel = with_effect(WAM_V, "wave_motion", force=40.0, omega=1.3, direction=0.5, phase=0.0)
    vessel = with_effect(vessel, "wave_motion", force=30.0, omega=2.6, direction=-1.9, phase=1.0)
    _, reports = on_floats(vessel).simulate(drive, 0.1)
    motion = reports[0, :-1]
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, 0.1, np.eye(9) * 1e-6)


@pytest.mark.slow
def test_two_trains_are_two_and_not_one_twice() -> None:
    found = waves(Model.of(WAM_V), two_trains())
    assert sorted(round(w["omega"], 1) for w in found) == [1.3, 2.6]


def test_a_voyage_shorter_than_a_window_is_searched_too() -> None:
    trial = sailed("wave_motion", 40.0, force=60.0, omega=2.0, direction=1.0, phase=0.0)
    assert waves(Model.of(WAM_V), trial)[0]["omega"] == pytest.approx(2.0, abs=0.1)
