"""Where the search for an effect's parameters begins: the points of a grid, effect by effect.

A number starts where its effect says, on either side of zero where it may have either sign; a
direction at the four quarters; a moment every so often along the trial, because nothing changes
until it passes a sample; a choice at each of its values. Waves start where `sim.diagnosis.waves`
finds them.
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from sim.diagnosis.waves import FINEST, waves
from sim.effects.effect import Effect, Kind, Parameter
from sim.model import Model
from sim.trial import Trial
from sim.vessel import Vessel

Start = Mapping[str, float]

QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)
THIRDS = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)
MOMENTS = 12  # along a trial
PERIODS = 7
LONGEST = 2.0  # of the length of the trials: a longer period is a trend


def starts_of(effect: Effect, model: Model, trials: Sequence[Trial]) -> list[Start]:
    """All points that a search for the effect starts from."""
    if effect.name == "actuator_wiring":
        return wirings(model.vessel)
    if effect.name == "wave_motion":
        return waves(model, max(trials, key=len))
    longest = max(float(t.time[-1]) for t in trials)
    values = [_values(p, _linear(effect, p), model.vessel, longest) for p in effect.parameters]
    names = [p.name for p in effect.parameters]
    return [dict(zip(names, point, strict=True)) for point in product(*values)]


def searched(effect: Effect) -> tuple[str, ...]:
    """The parameters that a small step tells something of: those that a fit moves."""
    return tuple(p.name for p in effect.parameters if p.kind in (Kind.NUMBER, Kind.CIRCLE))


def _linear(effect: Effect, p: Parameter) -> bool:
    """A direction whose north and east parts act in proportion is met from anywhere."""
    return p.name == "direction" and effect.name != "steady_wind"


def _values(p: Parameter, linear: bool, vessel: Vessel, longest: float) -> Sequence[float]:
    if p.kind is Kind.MOMENT:
        return [float(t) for t in np.linspace(0.0, longest, MOMENTS + 2)[1:-1]]
    if p.kind is Kind.CHOICE:
        return [float(i + 1) for i in range(len(vessel.thrusters))]
    if p.name == "period":
        shortest = max(p.lower, 1.5 * FINEST)
        return [float(t) for t in np.geomspace(max(shortest, 30.0), LONGEST * longest, PERIODS)]
    if p.kind is Kind.CIRCLE and not linear:
        return THIRDS if p.name == "phase" else QUARTERS
    return (p.start, -p.start) if p.lower == -p.upper and p.start != 0.0 else (p.start,)


def wirings(vessel: Vessel) -> list[Start]:
    """Plugs of port and starboard swapped, single motors or all of them the wrong way round."""
    count = len(vessel.actuators)
    own = "".join(str(i + 1) for i in range(count))
    all_motors = "".join(str(i + 1) for i in range(len(vessel.thrusters)))
    orders = [0.0, float(_mirrored(vessel))] if _mirrored(vessel) != own else [0.0]
    turned = [0.0, *(float(i + 1) for i in range(count)), float(all_motors or 0)]
    points = [{"order": o, "reversed": r} for o in orders for r in dict.fromkeys(turned)]
    return [p for p in points if p["order"] or p["reversed"]]


def _mirrored(vessel: Vessel) -> str:
    """Each thruster hears what was meant for the one on the other side."""
    place = [np.array(t.position) for t in vessel.thrusters]
    digits = []
    for p in place:
        away = [float(np.hypot(*(q - p * [1.0, -1.0]))) for q in place]
        digits.append(str(int(np.argmin(away)) + 1))
    digits += [str(i + 1) for i in range(len(place), len(vessel.actuators))]
    return "".join(digits)
