"""Arms of another length are motors at another place, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.effects.lever_arm import arms_of
from sim.vessel import AddedEffect, Vessel
from tests.sim.simulated import DT, on_floats
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, STEERED_BOAT, WAMV, excitation


def moved(vessel: Vessel, x: float = 1.0, port: float = 1.0, starboard: float = 1.0) -> Vessel:
    """The vessel with its motors so many times as far from the middle."""
    motors = [
        replace(t, position=(x * t.position[0], (port if t.position[1] < 0.0 else starboard)
                             * t.position[1]))
        for t in vessel.thrusters
    ]  # fmt: skip
    return replace(vessel, thrusters=tuple(motors))


def sailed(vessel: Vessel) -> np.ndarray:
    drive = excitation(vessel, 12.0, DT)
    _, reports = on_floats(vessel).simulate(drive, DT)
    return np.asarray(reports[0])


@pytest.mark.parametrize(
    ("vessel", "which", "file"),
    [
        (WAMV, 0.0, moved(WAMV, port=1.7, starboard=1.7)),
        (WAMV, 1.0, moved(WAMV, port=1.7)),
        (WAMV, 2.0, moved(WAMV, starboard=1.7)),
        (IACQUABOT, 1.0, moved(IACQUABOT, port=1.7)),
        (STEERED_BOAT, 3.0, moved(STEERED_BOAT, x=1.7)),
    ],
)
def test_an_arm_is_a_motor_at_another_place(vessel: Vessel, which: float, file: Vessel) -> None:
    """Also of a motor that is steered, wherever it points."""
    arm = AddedEffect(named("lever_arm"), {"gain": 1.7, "which": which})
    as_found, as_filed = sailed(vessel.with_effects(arm)), sailed(file)
    np.testing.assert_allclose(as_found, as_filed, atol=1e-9)
    assert np.abs(as_found - sailed(vessel)).max() > 0.05


def test_a_search_begins_with_the_arms_that_turn_a_boat() -> None:
    def which(vessel: Vessel) -> list[float]:
        return [start["which"] for start in arms_of(vessel, lambda: None)]

    assert which(WAMV) == [0.0, 1.0, 2.0]
    assert which(STEERED_BOAT) == [3.0]
    one = replace(WAMV, thrusters=tuple(t for t in WAMV.thrusters if t.position[1] > 0.0))
    assert which(one) == [0.0]  # of one side "all" is that side
    aside = replace(RUDDER_BOAT.thrusters[0], azimuth=0.5 * np.pi, position=(1.0, 0.0))
    assert which(replace(RUDDER_BOAT, thrusters=(*RUDDER_BOAT.thrusters, aside))) == [3.0]
    assert RUDDER_BOAT.unmet_needs(named("lever_arm"))  # one motor in the middle and a rudder
    assert not STEERED_BOAT.unmet_needs(named("lever_arm"))
