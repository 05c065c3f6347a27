"""Whether an effect only fits with numbers that no boat has: then it stands in for something else;
or is so small that it would say nothing of the boat.

An effect that is not the cause takes the cause's form as far as its law can. Where that ends at the
limit of a number (a boat three times as heavy from one moment on), or far beyond the hull (an
antenna over the water), what was found is a shape, and no finding.
"""

import numpy as np

from sim.diagnosis import thresholds
from sim.effects.effect import Kind, Parameter
from sim.vessel import AddedEffect, Vessel

NEAR = 1e-3  # of the way from one limit to the other
BEYOND = 1.25  # times half the hull: what is a little over its edge may be its interval


def strain_of(added: AddedEffect, vessel: Vessel) -> str:
    """What is beyond belief in the numbers of an effect that was found, in words; empty if nothing.

    A limit of zero is none: a motor may be dead. Nor is one of a number that makes the effect no
    stronger (the shape of a wind's force).
    """
    effect = added.effect
    ends = {} if effect.within is None else effect.within(vessel)
    for p in effect.parameters:
        if p.kind is not Kind.NUMBER or p.neutral is None:
            continue
        value, unit = added.values[p.name], f" {p.unit}" if p.unit not in {"1", "-"} else ""
        limit = _limit_at(p, value)
        if limit is not None:
            return f"{p.name} of {effect.name} stands at its limit, {limit:g}{unit}"
        low, high = ends.get(p.name, (p.lower, p.upper))
        if not BEYOND * low <= value <= BEYOND * high:
            end = low if value < low else high
            told = f"{p.name} of {effect.name} is {value:.3g}{unit}"
            return f"{told}, and the hull ends at {end:.3g}{unit}"
    return ""


def smallness_of(added: AddedEffect) -> str:
    """That an effect is no more than a good sensor, or what is known of a boat, is off by anyway,
    in words; empty where it is more, or where nothing is known of that.
    """
    known = [p for p in added.effect.parameters if p.least]
    sizes = [abs(added.values[p.name] - (p.neutral or 0.0)) for p in known]
    if not known or any(size >= p.least for p, size in zip(known, sizes, strict=True)):
        return ""
    told = " and ".join(_told(p, size) for p, size in zip(known, sizes, strict=True))
    of_boat = added.effect.thrust or added.effect.angle or added.effect.reaction
    what = "a boat's numbers are" if of_boat else "a good sensor is"
    return f"{told} is less than {what} off by anyway ({_told(known[0], known[0].least)})"


def sameness_of(added: AddedEffect) -> str:
    """That a current or a wind that changed is nearly the same on both sides of its moment, in
    words; empty where it is not.
    """
    values = added.values
    if not {"direction", "later_speed", "later_direction"} <= values.keys():
        return ""
    before, after = (
        values[f"{side}speed"] * np.exp(1j * values[f"{side}direction"]) for side in ("", "later_")
    )
    larger = max(abs(before), abs(after))
    if abs(after - before) >= thresholds.MIN_CHANGE * larger:
        return ""
    return f"it changes by {100.0 * abs(after - before) / larger:.0f} % only: that is no change"


def _told(p: Parameter, value: float) -> str:
    """A size with its unit."""
    if p.unit == "rad":
        return f"{np.degrees(abs(value)):.1f}°"
    if p.unit == "-":
        return f"{100.0 * abs(value):.0f} %"
    return f"{abs(value):.2g} {p.unit}"


def _limit_at(p: Parameter, value: float) -> float | None:
    """The limit that a number stands at; None where it stands at none."""
    near = NEAR * (p.upper - p.lower)
    at = (end for end in (p.lower, p.upper) if abs(value - end) <= near)
    return next((end for end in at if end not in {0.0, p.neutral, p.reached}), None)
