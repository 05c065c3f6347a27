"""Bins of a comparison in the units that people read: degrees, per cent."""

import numpy as np

from gateway.pictures.figure_data import Axis
from sim.comparison.compare import Comparison
from sim.comparison.where import Bin
from sim.state import Floats

DEGREES = 180.0 / np.pi
SHOWN = {  # name of the regime -> axis and how much of its unit makes one SI unit
    "heading": (Axis("heading", "°"), DEGREES),
    "speed": (Axis("speed over ground", "m/s"), 1.0),
    "turn_rate": (Axis("turn rate", "°/s"), DEGREES),
    "drift_angle": (Axis("drift angle", "°"), DEGREES),
    "throttle": (Axis("mean throttle", "%"), 100.0),
    "reverse": (Axis("hardest reverse", "%"), 100.0),
    "voltage": (Axis("battery", "V"), 1.0),
    "time": (Axis("time", "s"), 1.0),
    "north": (Axis("north", "m"), 1.0),
    "east": (Axis("east", "m"), 1.0),
}


def bins_of(comparison: Comparison, by: str) -> list[Bin]:
    """The bins of one regime, in the order of its values."""
    return sorted((b for b in comparison.where if b.by == by), key=lambda b: b.start)


def edges_of(bins: list[Bin], by: str) -> tuple[Floats, Floats]:
    """Where bins begin and end (n,), in the unit shown."""
    factor = SHOWN[by][1]
    return np.array([b.start for b in bins]) * factor, np.array([b.end for b in bins]) * factor
