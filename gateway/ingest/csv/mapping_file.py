"""Which column of a table is which quantity, in which unit: a small TOML file beside the .csv.

    # mapping.toml
    time = { column = "original_timestamp", unit = "ms" }

    [columns]
    latitude  = { column = "lat", unit = "deg" }
    longitude = { column = "lon", unit = "deg" }
    yaw       = { column = "yaw", unit = "deg" }
    yaw_rate  = { column = "yaw_rate", unit = "rad/s" }
    surge     = { column = "surge", unit = "m/s" }
    sway      = { column = "sway", unit = "m/s" }
    channel_1 = { column = "thr_left", unit = "us" }
    channel_3 = { column = "thr_right", unit = "us" }

Quantities are those of `QUANTITIES` and channel_1 … channel_32; yaw is clockwise from north, surge
and sway are over ground, wind is the velocity of the air towards north and east. Times from 2001 on
are Unix time, smaller ones count from the start of the recording. An empty cell is not a value.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gateway.errors import BadInput
from gateway.samples import CHANNELS, Quantity

T = TypeVar("T")

KNOT, KMH = 1852.0 / 3600.0, 1.0 / 3.6
DEGREE = float(np.pi / 180.0)

Scale = tuple[float, float]  # factor, then offset, to the unit of `Quantity`
ANGLE = {"rad": (1.0, 0.0), "deg": (DEGREE, 0.0)}
RATE = {"rad/s": (1.0, 0.0), "deg/s": (DEGREE, 0.0)}
SPEED = {"m/s": (1.0, 0.0), "kn": (KNOT, 0.0), "km/h": (KMH, 0.0)}
PLACE = {"deg": (1.0, 0.0), "1e-7 deg": (1e-7, 0.0), "rad": (1.0 / DEGREE, 0.0)}
PULSE = {"us": (1.0, 0.0), "fraction": (400.0, 1500.0)}  # a fraction −1 … 1 is 1100 … 1900 µs
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

# name in the file -> quantity, column of its values, units
QUANTITIES: Mapping[str, tuple[Quantity, int, Mapping[str, Scale]]] = {
    "latitude": (Quantity.GLOBAL_POSITION, 0, PLACE),
    "longitude": (Quantity.GLOBAL_POSITION, 1, PLACE),
    "north": (Quantity.POSITION, 0, {"m": (1.0, 0.0)}),
    "east": (Quantity.POSITION, 1, {"m": (1.0, 0.0)}),
    "yaw": (Quantity.YAW, 0, ANGLE),
    "yaw_rate": (Quantity.YAW_RATE, 0, RATE),
    "roll": (Quantity.TILT, 0, ANGLE),
    "pitch": (Quantity.TILT, 1, ANGLE),
    "velocity_north": (Quantity.VELOCITY, 0, SPEED),
    "velocity_east": (Quantity.VELOCITY, 1, SPEED),
    "surge": (Quantity.BODY_VELOCITY, 0, SPEED),
    "sway": (Quantity.BODY_VELOCITY, 1, SPEED),
    "surge_acceleration": (Quantity.ACCELERATION, 0, {"m/s2": (1.0, 0.0)}),
    "sway_acceleration": (Quantity.ACCELERATION, 1, {"m/s2": (1.0, 0.0)}),
    "voltage": (Quantity.VOLTAGE, 0, {"V": (1.0, 0.0), "mV": (1e-3, 0.0)}),
    "wind_north": (Quantity.WIND, 0, SPEED),
    "wind_east": (Quantity.WIND, 1, SPEED),
    "armed": (Quantity.ARMED, 0, {"1": (1.0, 0.0)}),
    **{f"channel_{n}": (Quantity.ACTUATORS, n - 1, PULSE) for n in range(1, CHANNELS + 1)},
}

WIDTHS = {  # quantity -> columns of its values
    quantity: 1 + max(index for other, index, _ in QUANTITIES.values() if other is quantity)
    for quantity, _, _ in QUANTITIES.values()
}


@dataclass(frozen=True)
class Column:
    """One column of the table: what it is, and how it becomes SI."""

    name: str
    column: str
    quantity: Quantity
    index: int
    factor: float
    offset: float


@dataclass(frozen=True)
class CsvMapping:
    """The whole mapping file."""

    path: str
    time_column: str
    time_unit_s: float
    columns: tuple[Column, ...]


def beside(csv: Path) -> Path:
    """The mapping file of a table that names none: <stem>.toml, else mapping.toml."""
    for candidate in (csv.with_suffix(".toml"), csv.with_name("mapping.toml")):
        if candidate.is_file():
            return candidate
    raise BadInput(
        f"{csv}: needs a mapping file that says which column is what: write "
        f"{csv.with_suffix('.toml').name} or mapping.toml beside it, or give --mapping FILE"
    )


def read_mapping(path: Path) -> CsvMapping:
    """A mapping file, checked."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: no TOML: {error}") from None
    unknown = set(content) - {"time", "columns"}
    if unknown:
        raise BadInput(f"{path}: unknown key {sorted(unknown)[0]!r}: expected time, [columns]")
    column, unit = _entry(path, "time", content.get("time"))
    columns = content.get("columns")
    if not isinstance(columns, dict) or not columns:
        raise BadInput(f"{path}: [columns] is missing: quantity = {{ column = …, unit = … }}")
    found = tuple(_column(path, name, entry) for name, entry in columns.items())
    return CsvMapping(str(path), column, _unit(path, "time", unit, TIME), found)


def _column(path: Path, name: str, entry: Any) -> Column:
    if name not in QUANTITIES:
        known = ", ".join(key for key in QUANTITIES if not key.startswith("channel_"))
        raise BadInput(f"{path}: unknown quantity {name!r}: expected {known}, channel_1 … 32")
    column, unit = _entry(path, name, entry)
    quantity, index, units = QUANTITIES[name]
    factor, offset = _unit(path, name, unit, units)
    return Column(name, column, quantity, index, factor, offset)


def _entry(path: Path, name: str, entry: Any) -> tuple[str, str]:
    """{ column = "…", unit = "…" } -> both."""
    good = isinstance(entry, dict) and set(entry) == {"column", "unit"}
    if not good or not all(isinstance(value, str) for value in entry.values()):
        raise BadInput(f'{path}: {name}: expected {name} = {{ column = "…", unit = "…" }}')
    return entry["column"], entry["unit"]


def _unit(path: Path, name: str, unit: str, units: Mapping[str, T]) -> T:
    if unit not in units:
        raise BadInput(f"{path}: {name}: unknown unit {unit!r}: expected {', '.join(units)}")
    return units[unit]
