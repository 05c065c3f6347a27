"""A bin in one sentence that a boat's owner understands: degrees, m/s, per cent, with units."""

import numpy as np

from sim.diagnosis.regimes import DEGREES, Regime
from sim.state import Floats

Triple = tuple[float, float, float]

COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
STEADY = 0.3  # a mean below this part of the rms is no tendency
NAMES = {
    "speed": "speed",
    "turn_rate": "turn rate",
    "drift_angle": "drift angle",
    "throttle": "mean throttle",
    "reverse": "hardest reverse",
    "voltage": "battery",
    "time": "time",
    "north": "position north",
    "east": "position east",
}
MORE = (
    ("faster ahead", "slower ahead"),
    ("faster to starboard", "faster to port"),
    ("faster clockwise", "faster counter-clockwise"),
)
CHANNEL = ("surge", "sway", "turn rate")


def says(
    regime: Regime, start: float, end: float, share: float, time_share: float, mean: Triple,
    rmse: Triple, scales: Floats,
) -> str:  # fmt: skip
    """The place, its share of the squared error and of the time, and what the boat does there."""
    return (
        f"{place(regime, start, end)}: {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time; {tendency(mean, rmse, scales)}"
    )


def place(regime: Regime, start: float, end: float) -> str:
    """The bin itself, as people say it."""
    unit, factor = regime.shown
    span = f"{_number(start * factor)} to {_number(end * factor)}" + (f" {unit}" if unit else "")
    if regime.by == "heading":
        k = round(start * DEGREES / 45.0)
        ends = f"{COMPASS[k % 8]} and {COMPASS[(k + 1) % 8]}"
        return f"heading between {ends} ({start * DEGREES:.0f}–{end * DEGREES:.0f}°)"
    if regime.by == "reverse" and start == 0.0:
        return "no thruster astern"
    if regime.by in ("throttle", "reverse"):
        return f"{NAMES[regime.by]} {_number(100 * start)} to {_number(100 * end)} %"
    return f"{NAMES[regime.by]} {span}"


def at_place(north: float, east: float, size: float, share: float, time_share: float) -> str:
    """A square of the map, its side and the middle of it in metres from the local origin."""
    return (
        f"around {_from_origin(north, 'north', 'south')}, {_from_origin(east, 'east', 'west')} "
        f"of the origin ({size:.0f} m square): {100 * share:.0f} % of the squared error in "
        f"{100 * time_share:.0f} % of the time"
    )


def _from_origin(value: float, ahead: str, back: str) -> str:
    return f"{abs(value):.0f} m {ahead if value >= 0.0 else back}"


def tendency(mean: Triple, rmse: Triple, scales: Floats) -> str:
    """Mean and rms error of u, v, r -> which way the boat differs from the model."""
    worst = int(np.argmax(np.array(rmse) / scales))
    size, factor, unit = rmse[worst], *((DEGREES, "°/s") if worst == 2 else (1.0, "m/s"))
    if abs(mean[worst]) < STEADY * size:
        return f"errors of {size * factor:.2g} {unit} in {CHANNEL[worst]}, either way"
    verb = "turns" if worst == 2 else "moves"
    direction = MORE[worst][0 if mean[worst] > 0 else 1]
    return f"the boat {verb} {abs(mean[worst]) * factor:.2g} {unit} {direction} than the model"


def _number(value: float) -> str:
    return f"{round(value, 6) + 0.0:g}".replace("-", "−")
