"""Quantities as people read them: label, unit, and how many of that unit make one SI unit.

One table for figures, terminal and pages: angles are in degrees and shares in per cent everywhere.
"""

from collections.abc import Mapping

import numpy as np

from gateway.figures.figure_data import Axis

DEGREES = 180.0 / np.pi
PER_CENT = 100.0

TIME = Axis("time", "s")
NORTH, EAST, HEADING = Axis("north", "m"), Axis("east", "m"), Axis("heading", "°", DEGREES)
POSE = (NORTH, EAST, HEADING)
SURGE, SWAY = Axis("surge u", "m/s"), Axis("sway v", "m/s")
YAW_RATE = Axis("yaw rate r", "°/s", DEGREES)
VELOCITIES = (SURGE, SWAY, YAW_RATE)
MISSING_FORCES = (
    Axis("missing surge X", "N"), Axis("missing sway Y", "N"), Axis("missing yaw N", "N m"),
)  # fmt: skip
NRMSE = Axis("nrmse (0 is perfect)")

_THROTTLE, _BATTERY = Axis("mean throttle", "%", PER_CENT), Axis("battery", "V")
REGIMES = {  # variables of a comparison's bins
    "heading": HEADING,
    "speed": Axis("speed over ground", "m/s"),
    "turn_rate": Axis("turn rate", "°/s", DEGREES),
    "drift_angle": Axis("drift angle", "°", DEGREES),
    "throttle": _THROTTLE,
    "reverse": Axis("hardest reverse", "%", PER_CENT),
    "voltage": _BATTERY,
    "time": TIME,
    "north": NORTH,
    "east": EAST,
}
EVIDENCE = {  # variables that a diagnosis draws missing force against
    "heading": HEADING,
    "surge": SURGE,
    "sway": SWAY,
    "turn_rate": Axis("turn rate r", "°/s", DEGREES),
    "acceleration": Axis("surge acceleration", "m/s²"),
    "throttle": _THROTTLE,
    "astern": Axis("hardest reverse", "%", PER_CENT),
    "helm": Axis("helm", "%", PER_CENT),
    "throttle_change": Axis("change of mean throttle", "%/s", PER_CENT),
    "helm_change": Axis("change of helm", "%/s", PER_CENT),
    "voltage": _BATTERY,
    "time": Axis("time in the recording", "s"),
    "phase": Axis("phase of the wave", "°", DEGREES),
}

SMALLEST_PROBABILITY = 0.001  # that is printed as a number; chosen by readability


def velocity_texts(rmse: Mapping[str, float]) -> tuple[str, str, str]:
    """Errors of u, v [m/s] and r [rad/s] as people read them: m/s, m/s, °/s."""
    return f"{rmse['u']:.3f}", f"{rmse['v']:.3f}", f"{rmse['r'] * DEGREES:.2f}"


def probability_text(probability: float) -> str:
    """Per cent with one decimal; `< 0.1 %` below that."""
    return f"{100.0 * probability:.1f} %" if probability >= SMALLEST_PROBABILITY else "< 0.1 %"
