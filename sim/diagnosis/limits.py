"""Whether an effect only fits with numbers that no boat has: then it stands in for something else.

An effect that is not the cause takes the cause's form as far as its law can. Where that ends at the
limit of a number (a boat three times as heavy from one moment on), or beyond the hull (an antenna
in the water beside it), what was found is a shape, and no finding.
"""

from sim.diagnosis.answer import LadderStep
from sim.effects.effect import Kind, Parameter
from sim.identification.intervals import Estimate
from sim.vessel import AddedEffect, Vessel

NEAR = 1e-3  # of the way from one limit to the other


def strained(step: LadderStep) -> tuple[str, ...]:
    """What is beyond belief in the numbers of the effects that were found, in words; () if nothing.

    A limit of zero is none: a motor may be dead. Nor is one of a number that makes the effect no
    stronger (the shape of a wind's force).
    """
    found = [a for a in step.vessel.effects if a.effect.name in step.effects]
    told = [
        _of(added, one, step.vessel)
        for added in found
        for one in step.parameters.get(added.effect.name, ())
    ]
    return tuple(dict.fromkeys(filter(None, told)))


def _of(added: AddedEffect, one: Estimate, vessel: Vessel) -> str:
    effect, key = added.effect, one.name.rpartition(".")[2]
    p = next(p for p in effect.parameters if p.name == key)
    if p.kind is not Kind.NUMBER or p.neutral is None:
        return ""
    name, unit = f"{key} of {effect.name}", f" {p.unit}" if p.unit not in {"1", "-"} else ""
    limit = _limit_at(p, one.value)
    if limit is not None:
        return f"{name} stands at its limit, {limit:g}{unit}"
    if effect.within is None or key not in (within := effect.within(vessel)):
        return ""
    low, high = within[key]
    if one.ci95[1] < low or one.ci95[0] > high:
        end = low if one.value < low else high
        return f"{name} is {one.value:.3g}{unit}, and the hull ends at {end:.3g}{unit}"
    return ""


def _limit_at(p: Parameter, value: float) -> float | None:
    """The limit that a number stands at; None where it stands at none."""
    near = NEAR * (p.upper - p.lower)
    at = (end for end in (p.lower, p.upper) if abs(value - end) <= near)
    return next((end for end in at if end not in {0.0, p.neutral}), None)
