"""Which key of a vessel file a number of the model comes from, and whether the file holds it.

    length, antenna_x, Y_r             hull.length, sensors.antenna, dynamics.Y_r
    left.y, left.ahead, left.curve_25  thrusters.left.position, .thrust, .curve
    rudder.angle_low                   rudders.rudder.angle
    EFFECT.NAME                        EFFECT.NAME

A key may hold several numbers: what a file says of it, it says of each.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from gateway.vessel_tables import StrictTable, VesselFile
from sim.body import Body
from sim.vessel import KNOT_PREFIX


class FileKey(NamedTuple):
    """A key of a vessel file; `given`: the file holds it, and not the table's default."""

    key: str
    given: bool


_OF_HULL = {
    "length": "length", "beam": "beam", "mass": "mass", "area_front": "wind_area",
    "area_side": "wind_area",
}  # fmt: skip
_OF_SENSORS = {"antenna_x": "antenna", "antenna_y": "antenna"}
_OF_ACTUATOR = {  # any other number has the name of its key
    "x": "position", "y": "position", "astern": "thrust", "ahead": "thrust", "exponent": "curve",
    "angle_low": "angle", "angle_high": "angle",
}  # fmt: skip


def file_key(name: str, read: VesselFile) -> FileKey:
    """The key of a number by its name in the model: m11, left.ahead, EFFECT.NAME."""
    if name in _OF_HULL:
        return _key("hull", _OF_HULL[name], read.hull)
    if name in _OF_SENSORS:
        return _key("sensors", _OF_SENSORS[name], read.sensors)
    if name in Body._fields:
        return _key("dynamics", name, read.dynamics)
    owner, _, number = name.rpartition(".")
    for label, entry in _labelled_effects(read):
        if label == owner:
            return FileKey(name, number in entry)
    member = "curve" if number.startswith(KNOT_PREFIX) else _OF_ACTUATOR.get(number, number)
    for kind, tables in (("thrusters", read.thrusters), ("rudders", read.rudders)):
        for table in tables:
            if table.name == owner:
                return _key(f"{kind}.{owner}", member, table)
    raise KeyError(name)


def _key(table: str, member: str, read: StrictTable) -> FileKey:
    return FileKey(f"{table}.{member}", member in read.model_fields_set)


def _labelled_effects(read: VesselFile) -> Iterator[tuple[str, dict[str, object]]]:
    """Effects as the model calls them: name, name#2, …"""
    counts: Counter[str] = Counter()
    for entry in read.effects:
        name = str(entry["type"])
        counts[name] += 1
        yield (f"{name}#{counts[name]}" if counts[name] > 1 else name), entry
