"""Numbers of a vessel file that hardly any boat has: mostly another unit. Asked about, not refused.

    draught of a box   T = m / (ρ L B)             T / B between 5e-4 and 2
    mass with water    m11, m22 over m             1/4 to 10
    turning            m33 / (m L²)                1e-3 to 10

The bounds lie far outside of boats, and of models of boats that were published: a fitted m11 may
be less than the mass (0.7 of it), a moment of inertia three times m L².
"""

from collections.abc import Iterator
from math import hypot

from gateway.vessel_tables import VesselFile

WATER_KG_M3 = 1000.0
DRAUGHT_PER_BEAM = (5e-4, 2.0)
ADDED_MASS = (0.25, 10.0)  # of m11 and m22 over the mass
TURNING = (1e-3, 10.0)  # of m33 over m L²
TO_ONE_SIDE = 0.02  # of the beam: nearer to the centre line a motor is on it


def box_draught(length: float, beam: float, mass: float) -> float:
    """How deep a box of that size lies in fresh water [m]."""
    return mass / (WATER_KG_M3 * length * beam)


def is_within(value: float, bounds: tuple[float, float]) -> bool:
    """Whether a number lies between bounds."""
    return bounds[0] < value < bounds[1]


def questions(read: VesselFile) -> Iterator[str]:
    """One question for each number that cannot well be meant."""
    of_the_hull = list(_of_the_hull(read))
    yield from of_the_hull or _of_the_masses(read)  # masses are measured by those of the hull
    yield from _of_the_places(read)


def _of_the_hull(read: VesselFile) -> Iterator[str]:
    hull = read.hull
    draught = box_draught(hull.length, hull.beam, hull.mass)
    if not is_within(draught / hull.beam, DRAUGHT_PER_BEAM):
        yield (
            f"hull: {hull.length:g} m × {hull.beam:g} m with {hull.mass:g} kg would draw "
            f"{draught:.2g} m: are length and beam in metres, the mass in kilograms?"
        )


def _of_the_masses(read: VesselFile) -> Iterator[str]:
    mass, length, numbers = read.hull.mass, read.hull.length, read.dynamics
    for name, value in (("m11", numbers.m11), ("m22", numbers.m22)):
        if not is_within(value / mass, ADDED_MASS):
            yield (
                f"dynamics.{name} = {value:g} beside a mass of {mass:g} kg: is it the mass with "
                "what water moves along, in kilograms?"
            )
    if not is_within(numbers.m33 / (mass * length**2), TURNING):
        yield (
            f"dynamics.m33 = {numbers.m33:g} of a hull of {length:g} m and {mass:g} kg: is it the "
            "moment of inertia, in kg m²?"
        )


def _of_the_places(read: VesselFile) -> Iterator[str]:
    length, beam = read.hull.length, read.hull.beam
    across = [thruster.position[1] for thruster in read.thrusters]
    places = {f"thrusters[{i}]": one.position for i, one in enumerate(read.thrusters)}
    places |= {f"rudders[{i}]": one.position for i, one in enumerate(read.rudders)}
    for key, (x, y) in places.items():
        if hypot(x, y) > length:
            yield (
                f"{key}.position = [{x:g}, {y:g}] is further from the middle than the hull is long "
                f"({length:g} m): is it in metres?"
            )
    for side, sign in (("starboard", 1.0), ("port", -1.0)):
        if len(across) > 1 and all(sign * y > TO_ONE_SIDE * beam for y in across):
            yield f"all thrusters lie to {side} (the second number of position): is that so?"
