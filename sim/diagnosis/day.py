"""What belongs to one voyage as on this one: current, wind, the moment of a fault.

A moment, a phase or a direction is not found downhill: each effect's starts are tried in turn, the
best few are fitted, and the one that predicts the trial best is taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim.diagnosis.prediction import DivergedError, predict
from sim.diagnosis.ruler import Ruler
from sim.diagnosis.scores import nrmse
from sim.diagnosis.segments import NoUsableTimeError
from sim.diagnosis.starts import MOMENTS, searched, starts_of
from sim.effects.effect import Kind, Scope
from sim.identification.applied import applied
from sim.identification.identify import replaced
from sim.identification.settings import IdentifySettings
from sim.identification.shooting import shoot
from sim.identification.unknowns import unknowns_of
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

FITTED = 3  # starts that are fitted
HORIZONS = (2.0, 6.0)  # s: the base is known, so runs need not begin short
SLOW = "period"  # of what swings slowly: with a wrong direction no start is better than another
FINER = 4  # moments on either side of the best, between it and its neighbours


def of_the_day(vessel: Vessel) -> list[str]:
    """Names of the effects that mean nothing on another day."""
    return [a.effect.name for a in vessel.effects if a.effect.scope is Scope.VOYAGE]


def values_of_day(vessel: Vessel) -> dict[str, float]:
    """Their numbers, by name."""
    return {
        f"{a.effect.name}.{key}": value
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for key, value in a.values.items()
    }


def today(trial: Trial, vessel: Vessel) -> Vessel:
    """The best of several starts, each effect's in turn, fitted on the trial."""
    try:
        ruler = Ruler.of(trial, Model.of(vessel))
    except NoUsableTimeError:
        return vessel
    tried = [vessel]
    for name in of_the_day(vessel):
        more = _started(trial, tried[0], name)
        tried = _ordered(trial, [*tried, *more], ruler)[:FITTED]
    if vessel not in tried:
        tried.append(vessel)
    found = [shot for one in tried for shot in (one, _shot(trial, one))]
    best = _ordered(trial, found, ruler)[0]
    finer = _finer(trial, best)
    if not finer:
        return best
    better = _ordered(trial, [best, *finer], ruler)[0]
    return _ordered(trial, [better, _shot(trial, better)], ruler)[0]


def _started(trial: Trial, vessel: Vessel, name: str) -> list[Vessel]:
    """The vessel with one of its effects at every start of a search."""
    effect = next(a.effect for a in vessel.effects if a.effect.name == name)
    bare = replace(vessel, effects=tuple(a for a in vessel.effects if a.effect.name != name))
    starts = starts_of(effect, Model.of(bare), [trial])
    if any(p.name == SLOW for p in effect.parameters):
        return [_shot(trial, _with(vessel, name, s), HORIZONS[-1:]) for s in starts]
    hard = {p.name for p in effect.parameters if p.kind is not Kind.NUMBER}
    as_strong = [{key: s[key] for key in hard} for s in starts] if hard else []
    return [_with(vessel, name, values) for values in (*starts, *as_strong)]


def _with(vessel: Vessel, name: str, values: Mapping[str, float]) -> Vessel:
    effects = tuple(
        AddedEffect(a.effect, {**a.values, **values}) if a.effect.name == name else a
        for a in vessel.effects
    )
    return replace(vessel, effects=effects)


def _ordered(trial: Trial, vessels: Sequence[Vessel], ruler: Ruler) -> list[Vessel]:
    """The one that predicts the trial best first."""
    return sorted(vessels, key=lambda vessel: _error(trial, vessel, ruler))


def _error(trial: Trial, vessel: Vessel, ruler: Ruler) -> float:
    try:
        return nrmse(predict(trial, Model.of(vessel), ruler).along()[2], ruler.scales)
    except DivergedError:
        return np.inf


def _shot(trial: Trial, vessel: Vessel, horizons: tuple[float, ...] = HORIZONS) -> Vessel:
    """The numbers of the day that a small step tells something of, fitted from where they are."""
    free = tuple(
        f"{a.effect.name}.{key}"
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for key in searched(a.effect)
    )
    if not free:
        return vessel
    how = IdentifySettings(free=free, horizons=horizons)
    unknowns = unknowns_of(Model.of(vessel), 1, how)
    found = shoot(unknowns, [trial], [trial.usable], how)
    return applied(vessel, values_of_day(replaced(unknowns, found.z).vessel))


def _finer(trial: Trial, vessel: Vessel) -> list[Vessel]:
    """Moments between those that a start is tried at."""
    apart = 0.5 * float(trial.time[-1]) / (MOMENTS + 1)
    shifts = apart * np.linspace(-1.0, 1.0, 2 * FINER + 1)
    return [
        _with(vessel, a.effect.name, {p.name: float(np.clip(a.values[p.name] + s, 0.0, p.upper))})
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for p in a.effect.parameters
        if p.kind is Kind.MOMENT
        for s in shifts
    ]
