"""What a figure shows, as plain values that any library can draw, and how it looks.

Lines of many points are thinned so that they look the same: no peak, no gap and no end is lost.

Colours: one palette for paper and screen, safe for colour-blind eyes.
Source: Okabe and Ito, Color Universal Design, 2008. Text and background of a theme are WCAG AA.

Quantities as people read them: label, unit, and how many of that unit make one SI unit. One table
for figures, terminal and pages: angles are in degrees and shares in per cent everywhere.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from sim.state import Floats, Ints

WORST = 0.99  # quantile of coloured values at which the colour scale ends


class SeriesRole(Enum):
    """What a mark stands for; each role has one colour in every figure."""

    MEASURED = "measured"
    MODEL = "model"
    SHADOW = "shadow"
    ERROR = "error"
    FLOOR = "noise floor"
    INTERVAL = "interval"
    CONTEXT = "context"


@dataclass(frozen=True)
class Axis:
    """A quantity as people read it: its label, its unit, and how many of that unit make an SI unit.

    An empty unit is for names and plain numbers.
    """

    label: str
    unit: str = ""
    factor: float = 1.0

    @property
    def text(self) -> str:
        """Label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class Line:
    """A line through x (n,), y (n,); NaN interrupts it. `colour`: another than its role's."""

    x: Floats
    y: Floats
    role: SeriesRole
    label: str = ""
    colour: str = ""


@dataclass(frozen=True)
class ColouredPoints:
    """Points x (n,), y (n,) coloured by value (n,)."""

    x: Floats
    y: Floats
    value: Floats
    scale: Axis

    @property
    def highest(self) -> float:
        """Value at the end of the colour scale."""
        return max(float(np.quantile(self.value, WORST)) if len(self.value) else 1.0, 1e-9)


@dataclass(frozen=True)
class Bars:
    """Bars from start (n,) to end (n,), height (n,); `outline` draws their edge alone."""

    start: Floats
    end: Floats
    height: Floats
    role: SeriesRole
    label: str = ""
    outline: bool = False


@dataclass(frozen=True)
class Strip:
    """Coloured cells: columns from start (n,) to end (n,), one row (n,) of `value` per name."""

    start: Floats
    end: Floats
    rows: tuple[str, ...]
    value: Floats  # (rows, n)
    scale: Axis
    highest: float  # value at the end of the colour scale


@dataclass(frozen=True)
class Dots:
    """Points x (n,), y (n,) with a whisker from low (n,) to high (n,)."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Band:
    """The area between low (n,) and high (n,) over x (n,)."""

    x: Floats
    low: Floats
    high: Floats
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Level:
    """A horizontal line at `y`."""

    y: float
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Lanes:
    """Named stretches from start (n,) to end (n,) in lane `row` (n,), one lane below the other.

    A stretch without length is a moment. `bad` (n,): something was wrong then.
    """

    names: tuple[str, ...]
    start: Floats
    end: Floats
    row: Ints
    texts: tuple[str, ...]
    bad: tuple[bool, ...]


Mark = Line | ColouredPoints | Bars | Strip | Dots | Band | Level | Lanes


@dataclass(frozen=True)
class Panel:
    """One pair of axes. `equal`: one metre is as long on both. `names`: of x = 0, 1, 2, …"""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    title: str = ""
    equal: bool = False
    names: tuple[str, ...] = ()

    @property
    def names_span(self) -> tuple[float, float]:
        """Ends of an axis of names; a few names do not fill all of its width."""
        return -0.6, max(len(self.names) - 0.4, 2.6)

    @property
    def strip(self) -> Strip | None:
        """The coloured cells of the panel, if it shows such."""
        return next((mark for mark in self.marks if isinstance(mark, Strip)), None)

    @property
    def lanes(self) -> Lanes | None:
        """The lanes of the panel, if it shows such."""
        return next((mark for mark in self.marks if isinstance(mark, Lanes)), None)


@dataclass(frozen=True)
class FigureData:
    """A whole figure: panels row by row, `columns` to a row, and a sentence about it."""

    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared_x: bool = False
    caption: str = ""


COLUMNS = 1200  # of pixels that a figure may be wide


def decimated(x: Floats, y: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """x (n,) ascending but for pauses, y (n,) -> the lowest and highest point of each column.

    NaN interrupts the line: one of each run of NaN stays where it was.
    """
    if len(x) <= 4 * columns:
        return x, y
    edges = np.linspace(0, len(x), columns + 1).astype(np.int64)
    starts, known = edges[:-1], np.isfinite(y)
    low = _least(np.where(known, y, np.inf), starts)
    high = _least(np.where(known, -y, np.inf), starts)
    pauses = np.flatnonzero(~known & np.concatenate([[True], known[:-1]]))
    ends = np.array([0, len(x) - 1])
    keep = np.unique(np.concatenate([low, high, pauses, ends]))
    return x[keep], y[keep]


def _least(values: Floats, starts: Ints) -> Ints:
    """Index of the least value of each column, values (n,), columns beginning at `starts`."""
    lengths = np.diff(np.append(starts, len(values)))
    floor = np.repeat(np.minimum.reduceat(values, starts), lengths)
    at = np.flatnonzero(values == floor)
    column = np.repeat(np.arange(len(starts)), lengths)[at]
    return at[np.unique(column, return_index=True)[1]]


def within(x: Floats, y: Floats, start: float, end: float) -> tuple[Floats, Floats]:
    """The points of x (n,) ascending between start and end, one more on either side."""
    first = max(int(np.searchsorted(x, start)) - 1, 0)
    last = int(np.searchsorted(x, end, side="right")) + 1
    return x[first:last], y[first:last]


def worst_kept(value: Floats, count: int) -> Ints:
    """value (n,) -> indices of at most `count` points in order: of each run of points the worst."""
    if len(value) <= count:
        return np.arange(len(value))
    edges = np.linspace(0, len(value), count + 1).astype(np.int64)
    return _least(-value, edges[:-1])


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
    "phase": Axis("phase", "°", DEGREES),
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
