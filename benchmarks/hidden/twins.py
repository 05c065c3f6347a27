"""What belongs to one day, estimated anew on another: each vessel gets the same chance.

A moment, a phase or a direction cannot be searched for downhill, so that many starts are tried
first: the values found on the diagnosed voyage, those that are true of this day where the effect
is truly there, and random ones. Every second block of the day is for this, the others are judged.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator as Dice

from benchmarks.hidden.oracle import armed_at, free_of, halves, nrmse, shifted
from sim.effects.effect import Kind, Parameter, Scope
from sim.identification import IdentifySettings
from sim.identification.identify import identify
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

STARTS = 24  # random ones, where there is something that cannot be searched for downhill
LENGTH = ("period", "omega")  # no angles, yet as hard to search for


def on_another_day(
    trial: Trial, vessels: Sequence[Vessel], truth: Sequence[Mapping[str, Any]]
) -> list[float]:
    """Errors of vessels on the blocks of another voyage that no fit saw; the last is the ruler."""
    fit, judged = halves(trial)
    today = [of_the_day(fit, vessel, truth) for vessel in vessels]
    return nrmse(judged, [today[-1], *today])[1:]


def of_the_day(trial: Trial, vessel: Vessel, truth: Sequence[Mapping[str, Any]]) -> Vessel:
    """The vessel with what belongs to a voyage as on this one; the boat stays as it is."""
    if not any(added.effect.scope is Scope.VOYAGE for added in vessel.effects):
        return vessel
    starts = list(starts_of(trial, vessel, truth))
    if len(starts) > 1:
        starts = [starts[int(np.argmin([nrmse(trial, [vessel, s])[1] for s in starts]))]]
    best, free = starts[0], free_of(vessel, Scope.VOYAGE)
    return fitted_to(trial, best, free) if free else best


def fitted_to(trial: Trial, vessel: Vessel, free: tuple[str, ...]) -> Vessel:
    """The start, or what a fit makes of it if that is better."""
    found = identify([trial], vessel, IdentifySettings(free=free), others=[trial]).vessel
    before, after = nrmse(trial, [vessel, found])
    return found if after < before else vessel


def starts_of(trial: Trial, vessel: Vessel, truth: Sequence[Mapping[str, Any]]) -> Iterator[Vessel]:
    """As found, as true, at random."""
    yield vessel
    true = {item["type"]: item for item in truth}
    armed = armed_at(trial)
    if any(added.effect.name in true for added in vessel.effects):
        yield _changed(vessel, lambda a: _true(a, true, armed))
    if any(_hard(p) for added in vessel.effects for p in _of_a_day(added)):
        dice = np.random.default_rng(trial.start_time_ns % 2**32)
        for _ in range(STARTS):
            yield _changed(vessel, lambda a: _thrown(a, dice, float(trial.time[-1])))


def _changed(vessel: Vessel, how: Any) -> Vessel:
    return replace(vessel, effects=tuple(how(added) for added in vessel.effects))


def _true(added: AddedEffect, true: Mapping[str, Any], armed: float) -> AddedEffect:
    item = true.get(added.effect.name)
    if item is None or added.effect.scope is not Scope.VOYAGE:
        return added
    values = {key: float(value) for key, value in item.items() if key != "type"}
    return AddedEffect(added.effect, shifted(values, armed))


def _thrown(added: AddedEffect, dice: Dice, seconds: float) -> AddedEffect:
    values = dict(added.values)
    for p in _of_a_day(added):
        if p.kind is Kind.MOMENT:
            values[p.name] = float(dice.uniform(0.0, seconds))
        elif p.kind is Kind.CIRCLE:
            values[p.name] = float(dice.uniform(-math.pi, math.pi))
        elif p.name in LENGTH:
            wide = values[p.name] * math.exp(dice.normal(0.0, 0.4))
            values[p.name] = min(max(wide, p.lower), p.upper)
    return AddedEffect(added.effect, values)


def _of_a_day(added: AddedEffect) -> tuple[Parameter, ...]:
    return added.effect.parameters if added.effect.scope is Scope.VOYAGE else ()


def _hard(parameter: Parameter) -> bool:
    return parameter.kind in (Kind.MOMENT, Kind.CIRCLE) or parameter.name in LENGTH
