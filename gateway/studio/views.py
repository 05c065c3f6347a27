"""What the page shows, as plain values that cross from one process into another."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.figures.diagnosis import LadderBar
from gateway.figures.figure_data import FigureData
from sim.state import Floats

Ranges = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Worst:
    """A regime in words, and the stretches of time [s] that belong to it."""

    says: str
    spans: Ranges


@dataclass(frozen=True)
class VesselView:
    """One vessel on one recording."""

    name: str
    rmse: Mapping[str, float]
    nrmse: float
    ci95: tuple[float, float] | None
    floor: float
    worst: tuple[Worst, ...]
    pictures: Mapping[str, FigureData]


@dataclass(frozen=True)
class TrialView:
    """One stretch of a recording; without vessels while it is still being compared."""

    name: str
    log: str
    seconds: float
    time: Floats  # (T,)
    east: Floats  # (T,)
    north: Floats  # (T,)
    measured: FigureData
    vessels: tuple[VesselView, ...] = ()
    notices: tuple[str, ...] = ()
    origin_deg: tuple[float, float] | None = None


@dataclass(frozen=True)
class LadderView:
    """One step that can be taken: the effects, the error then, and the vessel file then."""

    effects: tuple[str, ...]
    step: LadderBar
    text: str


@dataclass(frozen=True)
class Other:
    """What was ranked but not chosen: its own rung, and its evidence where that is worth a look.

    rival   these data cannot tell it from what was chosen
    """

    rung: LadderView
    rival: bool
    evidence: FigureData | None = None


@dataclass(frozen=True)
class Found:
    """A diagnosis: what `shadow diagnose --json` prints, its rungs, its pictures."""

    answer: Mapping[str, Any]
    logs: tuple[str, ...]
    floor: float
    rungs: tuple[LadderView, ...]
    ranking: FigureData | None
    evidence: Mapping[str, FigureData]
    looks: Mapping[str, str] = field(default_factory=dict)  # effect -> what it looks like
    separates: tuple[str, ...] = ()
    before: tuple[str, ...] = ()  # effects that the vessel had when it was diagnosed
    others: tuple[Other, ...] = ()

    @property
    def every(self) -> tuple[LadderView, ...]:
        """All that can be added: what was chosen first."""
        return (*self.rungs, *(other.rung for other in self.others))

    def up_to(self, rung: LadderView) -> tuple[LadderView, ...]:
        """The rungs on the way to one, and itself."""
        if rung in self.rungs:
            return self.rungs[: self.rungs.index(rung) + 1]
        n = len(rung.effects)
        below = (r for r in self.rungs if r.effects == rung.effects[: len(r.effects)])
        return (*(r for r in below if len(r.effects) < n), rung)


@dataclass(frozen=True)
class Row:
    """A recording on the page: what it is, and what it is good for."""

    path: str
    kind: str
    megabytes: float
    seconds: float
    boats: tuple[str, ...]
    good_for: tuple[str, ...]
    notices: tuple[str, ...]
    rates: tuple[tuple[str, float], ...]
