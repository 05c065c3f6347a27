"""Parameters of a vessel from trials, with intervals that hold.

Here: the settings, and numbers by the names that a model gives them, put back into a vessel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from sim.identification.at_rest import axes_at_rest
from sim.near_names import did_you_mean
from sim.prediction.segments import BLOCK_S
from sim.trial import Trial
from sim.vessel import BASE as BASE
from sim.vessel import KNOT_PREFIX, AddedEffect, Dynamics, Rudder, Thruster, Vessel, knot_key

METHODS = ("shooting", "simulation", "instrumental", "regression")


# Of the hull's numbers: nine of an Otter in the loop with the real ArduRover 4.6.3, whose truth is
# known, came out up to 2.5 % off from 90 to 400 s, masses 1.4 % low, by all methods alike.
FILTERED_STD = 0.01
MASSES = ("m11", "m22", "m33")


@dataclass(frozen=True)
class IdentifySettings:
    """Which parameters are estimated, and how.

    free       parameters of the model by name; `effect.*` frees all of an effect
    fix        taken out of those again
    priors     name -> relative standard deviation of its value in the vessel file
    horizons   lengths of the free runs [s], from the first, careful fit to the last
    average    rows are compared in means over so long [s]: what is faster, a smoother has rounded
    growth     a run is halved where an error of its start grows by more than this
    robust     residuals beyond so many standard deviations count less
    block      length of the blocks [s] that intervals are made from
    tied       short runs tied by a filter, not free ones (`sim.identification.innovations`): for
               hulls that are unstable on course
    offsets    offsets in time of commands and velocities, and rounding, are estimated along
    at_rest    axes along which the recordings show no motion (`at_rest`): their numbers are held
    filtered   relative standard deviation of the hull's numbers for what an autopilot's filter does
               to the motion: no block of time shows it, for it does so in all
    fastest    |u|, |v|, |r| of the recordings [m/s, m/s, rad/s]: damping that is over before a row
               can show it at these is held (`parameters`); None: none is
    """

    free: tuple[str, ...] = BASE
    fix: tuple[str, ...] = ()
    priors: Mapping[str, float] = field(default_factory=dict)
    method: str = "shooting"
    horizons: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)
    average: float = 0.4
    growth: float = 6.0
    robust: float = 3.0
    block: float = BLOCK_S
    offsets: bool = True
    tied: bool = False
    at_rest: tuple[str, ...] = ()
    filtered: float = 0.0
    fastest: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            meant = did_you_mean(self.method, METHODS)
            raise ValueError(f"method {self.method!r}: {meant}expected one of {', '.join(METHODS)}")
        if not self.horizons or min(self.horizons) <= 0.0:
            raise ValueError(f"horizons {self.horizons}: expected lengths in seconds")
        for name, share in self.priors.items():
            if not share > 0.0:
                raise ValueError(f"prior of {name}: {share} is no relative standard deviation")

    @property
    def sizes_are_free(self) -> bool:
        """Whether thrust alone says how large all forces are: no mass is held or known."""
        held = {*self.fix, *self.priors}
        return all(name in self.free and name not in held for name in MASSES)

    def with_motion_of(self, trials: Sequence[Trial]) -> "IdentifySettings":
        """The same with how fast these trials are, but for the fastest hundredth of their rows, and
        the axes along which they are at rest, and whether an autopilot's filter made them.
        """
        speeds = np.concatenate([np.abs(t.nu[t.usable]) for t in trials])
        u, v, r = np.quantile(speeds, 0.99, axis=0).tolist()
        filtered = FILTERED_STD if any(trial.filtered for trial in trials) else 0.0
        return replace(self, fastest=(u, v, r), at_rest=axes_at_rest(trials), filtered=filtered)


PLACES = {  # key of an actuator's number -> its field, and the place in it
    "x": ("position", 0), "y": ("position", 1), "astern": ("thrust", 0), "ahead": ("thrust", 1),
    "angle_low": ("angle", 0), "angle_high": ("angle", 1),
}  # fmt: skip
ANTENNA = ("antenna_x", "antenna_y")
AREAS = ("area_front", "area_side")
HULL = ("length", "beam", "mass")


def updated_vessel(vessel: Vessel, values: Mapping[str, float]) -> Vessel:
    """The vessel with new values of the numbers that are named; all others stay as they are."""
    base = {f.name for f in fields(Dynamics)} & set(values)
    hull: dict[str, Any] = {key: values[key] for key in HULL if key in values}
    area = vessel.hull.wind_area  # what was assumed stays so until a fit gives another
    if set(AREAS) & set(values):
        area = _pair(vessel.hull.areas, AREAS, values)
    antenna = _pair(vessel.sensors.antenna, ANTENNA, values)
    return replace(
        vessel,
        dynamics=replace(vessel.dynamics, **{key: values[key] for key in base}),
        hull=replace(vessel.hull, wind_area=area, **hull),
        sensors=replace(vessel.sensors, antenna=antenna),
        thrusters=tuple(replace(t, **_moved(t, values)) for t in vessel.thrusters),
        rudders=tuple(replace(r, **_moved(r, values)) for r in vessel.rudders),
        effects=_effects(vessel, values),
        sketch=vessel.sketch and not base,
    )


def _pair(
    was: tuple[float, float], names: tuple[str, str], values: Mapping[str, float]
) -> tuple[float, float]:
    return values.get(names[0], was[0]), values.get(names[1], was[1])


def _moved(actuator: Thruster | Rudder, values: Mapping[str, float]) -> dict[str, Any]:
    """The fields of an actuator that change."""
    changed: dict[str, Any] = {}
    for name, value in values.items():
        label, _, key = name.rpartition(".")
        if label != actuator.name:
            continue
        if key.startswith(KNOT_PREFIX) and isinstance(actuator, Thruster):
            was = changed.get("curve", actuator.curve)
            changed["curve"] = tuple((c, value if knot_key(c) == key else s) for c, s in was)
        elif key in PLACES:
            field, place = PLACES[key]
            was = changed.get(field, getattr(actuator, field))
            changed[field] = (value, was[1]) if place == 0 else (was[0], value)
        else:
            changed[key] = value
    return changed


def _effects(vessel: Vessel, values: Mapping[str, float]) -> tuple[AddedEffect, ...]:
    """Effects with their new numbers; a second one of a name is `name#2`."""
    seen: dict[str, int] = {}
    out = []
    for added in vessel.effects:
        seen[added.effect.name] = count = seen.get(added.effect.name, 0) + 1
        label = added.effect.name + (f"#{count}" if count > 1 else "")
        new = {key: values.get(f"{label}.{key}", was) for key, was in added.values.items()}
        out.append(AddedEffect(added.effect, new))
    return tuple(out)
