"""Inertia that a fit leaves far below what the hull has without any water: no vessel has that.

    m11, m22 < 0.6 m        m33 < 0.01 m L²        over the whole 95 % interval

m mass of the hull [kg], L its length [m]. Added mass is never negative, but published models of
real boats go down to 0.7 m and to 0.016 m L². Motion tells no more than the ratio of thrust and
inertia: of a thrust in the file that is too small, or a mass that is too large, this is what a fit
makes.
"""

from collections.abc import Sequence

from sim.identification import MASSES
from sim.identification.intervals import Estimate
from sim.vessel import Hull, Vessel

LEAST_MASS = 0.6  # of m
LEAST_TURNING = 0.01  # of m L²


def too_light(estimates: Sequence[Estimate], vessel: Vessel) -> tuple[str, ...]:
    """A sentence where fitted inertia is surely less than the hull's own; else nothing."""
    known = [e for e in estimates if e.name in MASSES and e.ci95[1] > e.ci95[0]]
    light = [e for e in known if e.ci95[1] < _least(e.name, vessel.hull)]
    if not light:
        return ()
    told = ", ".join(f"{e.name} {e.value:.3g} {e.unit}" for e in light)
    return (
        f"{told} is far less than a hull of {vessel.hull.mass:g} kg has without any water: "
        f"mass or thrust{_thrust(vessel)} of the vessel file cannot be right; check both first",
    )


def _least(name: str, hull: Hull) -> float:
    if name == "m33":
        return LEAST_TURNING * hull.mass * hull.length**2
    return LEAST_MASS * hull.mass


def _thrust(vessel: Vessel) -> str:
    """How hard all motors push together, as the file has it."""
    total = sum(thruster.thrust[1] for thruster in vessel.thrusters)
    return f" ({total:.3g} N in all)" if total > 0.0 else ""
