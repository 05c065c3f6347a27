"""Units of a table's columns: how they become SI, and which sizes of values are none of theirs.

A wrong unit in a mapping is the usual mistake, and often a plain one: pulses of 1 µs, latitudes of
3600°, rows that come once in two minutes.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from sim.state import Floats

KNOT, KMH = 1852.0 / 3600.0, 1.0 / 3.6
DEGREE = float(np.pi / 180.0)

Scale = tuple[float, float]  # factor, then offset, to the unit of `Quantity`
ANGLE = {"rad": (1.0, 0.0), "deg": (DEGREE, 0.0)}
RATE = {"rad/s": (1.0, 0.0), "deg/s": (DEGREE, 0.0)}
SPEED = {"m/s": (1.0, 0.0), "kn": (KNOT, 0.0), "km/h": (KMH, 0.0)}
PLACE = {"deg": (1.0, 0.0), "1e-7 deg": (1e-7, 0.0), "rad": (1.0 / DEGREE, 0.0)}
PULSE = {"us": (1.0, 0.0), "fraction": (400.0, 1500.0)}  # a fraction −1 … 1 is 1100 … 1900 µs
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

LATEST_S = 9e9  # a later time does not fit into nanoseconds

# Usual sizes of values: where those in the middle are others, they are of another unit.
LEAST_PULSE_US, MOST_FRACTION = 400.0, 1.2
FURTHEST_DEG = {"latitude": 90.0, "longitude": 360.0}
HALF_CIRCLE_DEG = 180.0
SHORTEST_STEP_S, LONGEST_STEP_S = 0.002, 5.0  # from row to row
# Further apart rows are no telemetry. A table is worked on in steps of a tenth of a second, however
# few rows it has: this bounds the work by their number.
REFUSED_STEP_S = 10.0


def check_unit(file: Path, name: str, column: str, unit: str, values: Floats) -> None:
    """BadInput where values (K,) of a column, for quantity `name`, cannot be of that unit."""
    spans = _spans(name)
    seen = values[np.isfinite(values) & (values != 0.0)]  # zeros are zero in any unit
    if unit not in spans or not len(seen):
        return
    usual = float(np.median(np.abs(seen)))  # one wild cell is no unit
    fits = [u for u, (least, most) in spans.items() if least <= usual <= most]
    if unit in fits:
        return
    other = f"{fits[0]!r} would fit" if fits else f"nor is that any of {', '.join(spans)}"
    if (name, unit) == ("latitude", "deg") and usual <= HALF_CIRCLE_DEG:
        other = "are latitude and longitude exchanged?"
    raise BadInput(
        f"{file}: {name} cannot be {unit!r}: column {column!r} holds "
        f"{seen.min():.6g} to {seen.max():.6g}; {other}"
    )


def _spans(name: str) -> Mapping[str, tuple[float, float]]:
    """Unit -> least and largest size that values of a quantity usually have in it."""
    if name in FURTHEST_DEG:
        spans = {unit: (0.0, FURTHEST_DEG[name] / factor) for unit, (factor, _) in PLACE.items()}
        spans["1e-7 deg"] = (spans["deg"][1], spans["1e-7 deg"][1])  # less: within 4 m of zero
        return spans
    if name.startswith("channel_"):
        return {"us": (LEAST_PULSE_US, np.inf), "fraction": (0.0, MOST_FRACTION)}
    return {}


def check_time(file: Path, column: str, unit: str, time: Floats) -> None:
    """BadInput where times (K,) [s], NaN where empty, are not those of two rows."""
    there = time[np.isfinite(time)]
    known = there[np.abs(there) < LATEST_S]
    if len(known) < 2 <= len(there):
        raise BadInput(
            f"{file}: times of column {column!r} lie beyond all dates: is their unit {unit!r}?"
        )
    if len(known) < 2:
        raise BadInput(f"{file}: fewer than two rows with a time in {column!r}")
    if known.min() == known.max():
        raise BadInput(f"{file}: the time in {column!r} is the same in all rows")


def about_steps(time_s: Floats, unit: str) -> tuple[str, ...]:
    """A sentence where rows at times (K,) [s] are apart as if these were of another unit."""
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else LONGEST_STEP_S
    if SHORTEST_STEP_S <= step <= LONGEST_STEP_S:
        return ()
    return (f"{_apart(step)}: is {unit!r} the unit of time?{_instead(step, unit)}",)


def check_steps(file: Path, column: str, unit: str, time_s: Floats) -> None:
    """BadInput where rows at times (K,) [s] are further apart than those of any telemetry."""
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if step > REFUSED_STEP_S:
        raise BadInput(
            f"{file}: {_apart(step)}, which no telemetry of a boat is: is {unit!r} the unit of "
            f"column {column!r}?{_instead(step, unit)}"
        )


def _apart(step_s: float) -> str:
    return f"rows are {step_s:.3g} s apart"


def _instead(step_s: float, unit: str) -> str:
    """The units of time in which steps would be usual ones."""
    others = {other: step_s / TIME[unit] * size for other, size in TIME.items()}
    fits = [
        f"{s:.3g} s in {u!r}" for u, s in others.items() if SHORTEST_STEP_S <= s <= LONGEST_STEP_S
    ]
    return f" They would be {' or '.join(fits)}" if fits else ""
