"""Colours of figures: one palette for paper and screen, safe for colour-blind eyes.

Source: Okabe and Ito, Color Universal Design, 2008. Text and background of a theme are WCAG AA.

Quantities as people read them: label, unit, and how many of that unit make one SI unit.

One table for figures, terminal and pages: angles are in degrees and shares in per cent everywhere.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gateway.figures.figure_data import Axis, SeriesRole

COLOUR = {
    SeriesRole.MEASURED: "#0072B2",  # blue
    SeriesRole.MODEL: "#D55E00",  # vermilion
    SeriesRole.SHADOW: "#009E73",  # bluish green
    SeriesRole.ERROR: "#CC79A7",  # reddish purple
    SeriesRole.FLOOR: "#000000",  # black: lies on bars of any colour
    SeriesRole.INTERVAL: "#000000",
    SeriesRole.CONTEXT: "#767676",  # grey, 4.5 : 1 on white
}
SELECTED = "#E69F00"  # orange of the same palette: what the user marked

# Of things that have no role, one after the other, from the same palette.
SEVERAL = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#767676")

# From little to much, falling steadily in lightness: readable in grey print too.
COLOUR_SCALE = ("#DCE9F2", "#56B4E9", "#0072B2", "#5B2A86", "#1B0A2A")
DARK_COLOUR_SCALE = ("#24384A", "#0072B2", "#56B4E9", "#CBE8F8", "#FFFFFF")
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW", "N")  # every 45°, 0 to 360°


@dataclass(frozen=True)
class Theme:
    """Colours of one theme. Measured, model and shadow are the same in both."""

    name: str
    paper: str
    ink: str
    faint: str  # text of less weight
    grid: str
    stops: tuple[str, ...]  # of the colour scale: what is much stands out from the paper
    strong: str  # floors and intervals: as far from the paper as can be

    def colour(self, role: SeriesRole) -> str:
        """The colour of a role on this paper."""
        return self.strong if role in (SeriesRole.FLOOR, SeriesRole.INTERVAL) else COLOUR[role]

    def scale(self, steps: int = 64) -> list[str]:
        """The colour scale in so many colours."""
        stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in self.stops])
        at = np.linspace(0.0, len(stops) - 1.0, steps)
        mixed = [np.interp(at, np.arange(len(stops)), stops[:, k]) for k in range(3)]
        return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.rint(mixed).astype(int).T]


LIGHT = Theme("light", "#FFFFFF", "#1B2430", "#55606E", "#E3E7EC", COLOUR_SCALE, "#000000")
DARK = Theme("dark", "#171C23", "#E8ECF1", "#A9B4C2", "#2C3540", DARK_COLOUR_SCALE, "#FFFFFF")
THEMES = {theme.name: theme for theme in (LIGHT, DARK)}


DEGREES = 180.0 / np.pi
PER_CENT = 100.0

PEOPLES_UNITS = {"rad": ("°", DEGREES), "rad/s": ("°/s", DEGREES)}


def peoples_unit(unit: str) -> tuple[str, float]:
    """A unit as people read it, and how many of it make one of the unit given."""
    return PEOPLES_UNITS.get(unit, (unit or "–", 1.0))


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


def motion_texts(rmse: Mapping[str, float]) -> tuple[str, str, str, str, str]:
    """Errors of u, v, r, then of the place [m] (north and east together) and the heading [°]."""
    place = math.hypot(rmse["x"], rmse["y"])
    return *velocity_texts(rmse), f"{place:.2f}", f"{rmse['psi'] * DEGREES:.1f}"


def probability_text(probability: float) -> str:
    """Per cent with one decimal; `< 0.1 %` below that."""
    return f"{100.0 * probability:.1f} %" if probability >= SMALLEST_PROBABILITY else "< 0.1 %"
