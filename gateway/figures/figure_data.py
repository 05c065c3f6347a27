"""What a picture shows, as plain values: any library can draw it, and nothing is computed there."""

from dataclasses import dataclass
from enum import Enum

from sim.state import Floats


class Role(Enum):
    """What a mark stands for; each role has one colour in every picture."""

    MEASURED = "measured"
    MODEL = "model"
    SHADOW = "shadow"
    ERROR = "error"
    FLOOR = "noise floor"
    INTERVAL = "interval"
    CONTEXT = "context"


@dataclass(frozen=True)
class Axis:
    """What an axis shows and in which unit; an empty unit is for names and plain numbers."""

    label: str
    unit: str = ""

    @property
    def text(self) -> str:
        """Label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class Line:
    """A line through x (n,), y (n,); NaN lifts the pen."""

    x: Floats
    y: Floats
    role: Role
    label: str = ""


@dataclass(frozen=True)
class Coloured:
    """Points x (n,), y (n,) coloured by value (n,)."""

    x: Floats
    y: Floats
    value: Floats
    scale: Axis


@dataclass(frozen=True)
class Bars:
    """Bars from start (n,) to end (n,), height (n,); `outline` draws their edge alone."""

    start: Floats
    end: Floats
    height: Floats
    role: Role
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
    role: Role
    label: str = ""


@dataclass(frozen=True)
class Band:
    """The area between low (n,) and high (n,) over x (n,)."""

    x: Floats
    low: Floats
    high: Floats
    role: Role
    label: str = ""


@dataclass(frozen=True)
class Level:
    """A horizontal line at `y`."""

    y: float
    role: Role
    label: str = ""


Mark = Line | Coloured | Bars | Strip | Dots | Band | Level


@dataclass(frozen=True)
class Panel:
    """One pair of axes. `equal`: one metre is as long on both. `names`: of x = 0, 1, 2, …"""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    title: str = ""
    equal: bool = False
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class FigureData:
    """A whole picture: panels row by row, `columns` to a row."""

    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared_x: bool = False
    says: str = ""
