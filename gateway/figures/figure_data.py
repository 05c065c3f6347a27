"""What a picture shows, as plain values: any library can draw it, and nothing is computed there."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from sim.state import Floats

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
    """A line through x (n,), y (n,); NaN interrupts it."""

    x: Floats
    y: Floats
    role: SeriesRole
    label: str = ""


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


Mark = Line | ColouredPoints | Bars | Strip | Dots | Band | Level


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


@dataclass(frozen=True)
class FigureData:
    """A whole figure: panels row by row, `columns` to a row, and a sentence about it."""

    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared_x: bool = False
    caption: str = ""
