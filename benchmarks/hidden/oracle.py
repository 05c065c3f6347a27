"""What somebody who knew the answer would reach: the vessel with the true effects, fitted.

Shared by all that judges: times and phases of an answer count from arming, those of a trial from
its first sample, and what belongs to one day is estimated anew on another.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sim.comparison.compare import compare
from sim.effects.catalogue import named
from sim.effects.effect import Kind, Scope
from sim.identification import BASE, IdentifySettings
from sim.identification.identify import Identification, identify
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

PRIOR = 0.15  # relative, of the base: a vessel file is not made of thin air
BLOCK = 50.0  # s: every second one is for fitting what belongs to the day


def with_effects(vessel: Vessel, values: Sequence[Mapping[str, Any]], trial: Trial) -> Vessel:
    """The vessel with effects of an answer, its times and phases as on that trial."""
    added = []
    for item in values:
        numbers = {key: float(value) for key, value in item.items() if key != "type"}
        added.append(AddedEffect(named(item["type"]), shifted(numbers, armed_at(trial))))
    return vessel.with_effects(*added)


def armed_at(trial: Trial) -> float:
    """When the motors first heard a command [s of the trial]."""
    return float(trial.time[np.flatnonzero(np.isfinite(trial.pwm).any(axis=1))[0]])


def shifted(values: Mapping[str, float], by: float) -> dict[str, float]:
    """Parameters that count time from arming -> from `by` seconds earlier."""
    out = dict(values)
    if "time" in out:
        out["time"] += by
    omega = out["omega"] if "omega" in out else 2.0 * math.pi / out.get("period", math.inf)
    if "phase" in out:
        out["phase"] = math.remainder(out["phase"] - omega * by, 2.0 * math.pi)
    return out


def free_of(vessel: Vessel, scope: Scope | None = None) -> tuple[str, ...]:
    """Names of the effects' parameters that a fit can look for: no moments, no choices."""
    return tuple(
        f"{added.effect.name}.{p.name}"
        for added in vessel.effects
        if scope is None or added.effect.scope is scope
        for p in added.effect.parameters
        if p.kind not in (Kind.MOMENT, Kind.CHOICE)
    )


def fitted(trial: Trial, vessel: Vessel, offsets: bool = True) -> Identification:
    """Base and effects fitted together, from where they are."""
    return identify([trial], vessel, settings(vessel, offsets), others=[trial])


def settings(vessel: Vessel, offsets: bool = True) -> IdentifySettings:
    """The base with its prior, the effects without."""
    return IdentifySettings(
        free=(*BASE, *free_of(vessel)), priors=dict.fromkeys(BASE, PRIOR), offsets=offsets
    )


def nrmse(trial: Trial, vessels: Sequence[Vessel]) -> list[float]:
    """Errors of all on one trial; the first gives the ruler."""
    return [c.nrmse for c in compare(trial, [Model.of(vessel) for vessel in vessels])]


def halves(trial: Trial) -> tuple[Trial, Trial]:
    """The same trial with only every second block usable, and with only the others."""
    odd = (trial.time // BLOCK).astype(int) % 2 == 1
    return replace(trial, usable=trial.usable & ~odd), replace(trial, usable=trial.usable & odd)
