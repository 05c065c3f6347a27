"""Start points of the search for an effect's parameters: a grid.

A number begins at its `start`, on either side of zero where its limits are symmetric; an angle at
the four quarters, unless it is the direction of a magnitude, which is fitted as north and east
parts; the moment of an event every so often along the trial, because nothing changes until it
passes a sample; a choice at each thruster. A parameter may declare starts of its own
(`Parameter.starts`), and an effect its own search (`Effect.search`).
"""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from sim.effects.effect import QUARTERS, Effect, Kind, Parameter, ResidualForce, Role, Values
from sim.model import Model
from sim.prediction.missing_force import missing_force_only
from sim.state import Eta
from sim.trial import Trial
from sim.vessel import Vessel

# Chosen, not measured:
MOMENT_STARTS = 12  # times of an event along a trial
PERIOD_STARTS = 7
SHORTEST_PERIOD_S = 30.0
LONGEST_PERIOD = 2.0  # lengths of the longest trial: a slower oscillation is a trend


def start_points(effect: Effect, model: Model, trials: Sequence[Trial]) -> list[Values]:
    """All points that a search for the effect begins from."""
    if effect.search is not None:
        longest_trial = max(trials, key=lambda trial: (trial.usable.any(), len(trial)))
        return list(effect.search(model.vessel, partial(residual_force, model, longest_trial)))
    if effect.tables is not None:
        nu = np.concatenate([trial.nu[trial.usable] for trial in trials])
        low, high = nu.min(axis=0), nu.max(axis=0)
        extent = {n: (float(low[i]), float(high[i])) for i, n in enumerate("uvr")}
        return list(effect.tables(model.vessel, extent))
    longest = max(float(t.time[-1]) for t in trials)
    directions = {p.direction for p in effect.parameters}
    values = [_values(p, p.name in directions, model.vessel, longest) for p in effect.parameters]
    names = [p.name for p in effect.parameters]
    return [dict(zip(names, point, strict=True)) for point in product(*values)]


def residual_force(model: Model, trial: Trial) -> ResidualForce:
    """Horizontal missing force of a model in a trial's usable rows, without its mean."""
    force, yaw = missing_force_only(trial, model), trial.eta[:, Eta.YAW]
    c, s = np.cos(yaw), np.sin(yaw)
    world = np.stack([c * force[:, 0] - s * force[:, 1], s * force[:, 0] + c * force[:, 1]], 1)
    use = trial.usable
    world = (world - world[use].mean(axis=0))[use]
    return ResidualForce(trial.time[use], trial.eta[use, : Eta.YAW], world)


def _values(p: Parameter, paired: bool, vessel: Vessel, longest: float) -> Sequence[float]:
    """Starts of one parameter; `paired`: the direction of a magnitude; `longest` trial [s]."""
    if p.starts:
        return p.starts
    if p.kind is Kind.MOMENT:
        return [float(t) for t in np.linspace(0.0, longest, MOMENT_STARTS + 2)[1:-1]]
    if p.kind is Kind.CHOICE:
        return [float(i + 1) for i in range(len(vessel.thrusters))]
    if p.role is Role.PERIOD:
        shortest = max(p.lower, SHORTEST_PERIOD_S)
        return [float(t) for t in np.geomspace(shortest, LONGEST_PERIOD * longest, PERIOD_STARTS)]
    if p.kind is Kind.CIRCLE and not paired:
        return QUARTERS
    return (p.start, -p.start) if p.lower == -p.upper and p.start != 0.0 else (p.start,)
