"""Rudders, steered motors, thrust curves and currents are found from another's physics."""

from dataclasses import replace
from functools import partial

import pytest

from sim.effects.steady_current import EFFECT as CURRENT
from sim.identification import BASE, IdentifySettings
from sim.identification.identify import identify
from sim.vessel import AddedEffect
from tests.sim.identification.independent_boat import FULL, blade, motor, sail
from tests.sim.vessels import RUDDER_BOAT, STEERED_BOAT

LINEAR = tuple(replace(t, curve="linear") for t in RUDDER_BOAT.thrusters)


def by_rudder(u, v, r, throttle, helm, area=0.02, reach=0.6, curve=lambda c: c):
    """Screw and rudder."""
    thrust = FULL * curve(throttle)
    X, Y, N = blade(u, v, r, reach * helm, thrust, area, 1.5)
    return X + thrust, Y, N


def by_motor(u, v, r, throttle, helm):
    """A motor that turns by half a radian at most."""
    return motor(0.5 * helm, FULL * throttle)


def found_by(trials, vessel, *free, fix=BASE):
    """The estimates by name."""
    settings = IdentifySettings((*BASE, *free), tuple(fix))
    return {e.name: e for e in identify(trials, vessel, settings, trials[:1]).estimates}


def test_the_area_and_the_angles_of_a_rudder_are_found():
    boat = replace(RUDDER_BOAT, thrusters=LINEAR)
    wrong = replace(boat, rudders=(replace(boat.rudders[0], area=0.03, angle=(-0.4, 0.45)),))
    free = ("rudder.area", "rudder.angle_low", "rudder.angle_high")
    found = found_by([sail(by_rudder, 120.0, 1)], wrong, *free)
    assert found["rudder.area"].value == pytest.approx(0.02, rel=0.05)
    assert found["rudder.angle_low"].value == pytest.approx(-0.6, rel=0.05)
    assert found["rudder.angle_high"].value == pytest.approx(0.6, rel=0.05)
    assert all(found[name].identifiable for name in free)


def test_the_angles_of_a_steered_motor_are_found():
    boat = replace(STEERED_BOAT, thrusters=LINEAR)
    wrong = replace(boat, rudders=(replace(boat.rudders[0], angle=(-0.7, 0.3)),))
    found = found_by([sail(by_motor, 80.0, 2)], wrong, "steering.angle_low", "steering.angle_high")
    assert found["steering.angle_low"].value == pytest.approx(-0.5, rel=0.04)
    assert found["steering.angle_high"].value == pytest.approx(0.5, rel=0.04)


@pytest.mark.slow
def test_a_thrust_curve_of_any_form_is_found():
    def bent(c):
        return max(0.0, (c - 0.1) / 0.9) ** 0.7

    boat = replace(RUDDER_BOAT, thrusters=LINEAR)
    trial = sail(partial(by_rudder, curve=bent), 150.0, 3)
    found = found_by([trial], boat, "curve", fix=())
    for percent in (25, 50, 75):
        e = found[f"screw.curve_{percent}"]
        assert e.value == pytest.approx(bent(percent / 100.0), abs=0.05)
        assert abs(e.value - percent / 100.0) > 0.5 * abs(bent(percent / 100.0) - percent / 100.0)
    assert not found["screw.curve_-50"].identifiable  # it never went astern


@pytest.mark.slow
def test_the_current_of_each_voyage_is_found_along_with_the_boat():
    current = AddedEffect(CURRENT, {"speed": 0.1, "direction": 0.5})
    boat = replace(RUDDER_BOAT, thrusters=LINEAR).with_effects(current)
    trials = [
        sail(by_rudder, 100.0, seed, drift) for seed, drift in ((4, (0.3, 0.0)), (5, (0.0, -0.2)))
    ]
    settings = IdentifySettings((*BASE, "steady_current.*"))
    found = identify(trials, boat, settings, trials[:1])
    told = {(e.trial, e.name): e.value for e in found.estimates if e.trial}
    assert told["voyage 4", "steady_current.speed"] == pytest.approx(0.3, abs=0.02)
    assert abs(told["voyage 4", "steady_current.direction"]) < 0.1
    assert told["voyage 5", "steady_current.speed"] == pytest.approx(0.2, abs=0.02)
    assert told["voyage 5", "steady_current.direction"] == pytest.approx(-1.571, abs=0.1)
