"""Numbers by the names that a model gives them, put back into a vessel."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from sim.vessel import KNOT_PREFIX, AddedEffect, Dynamics, Rudder, Thruster, Vessel, knot_key

PLACES = {  # key of an actuator's number -> its field, and the place in it
    "x": ("position", 0), "y": ("position", 1), "astern": ("thrust", 0), "ahead": ("thrust", 1),
    "angle_low": ("angle", 0), "angle_high": ("angle", 1),
}  # fmt: skip
ANTENNA = ("antenna_x", "antenna_y")
AREAS = ("area_front", "area_side")
HULL = ("length", "beam", "mass")


def updated_vessel(vessel: Vessel, values: Mapping[str, float]) -> Vessel:
    """The same vessel with other numbers; what is not named stays."""
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
