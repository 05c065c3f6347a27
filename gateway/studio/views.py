"""What the pages show, as plain values that cross from one process into another."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.figures.diagnosis import LadderBar
from gateway.figures.figure_data import FigureData
from sim.state import Floats

TimeRanges = tuple[tuple[float, float], ...]  # from, to [s]


@dataclass(frozen=True)
class RegimeView:
    """A regime in words, and the stretches of time that belong to it."""

    text: str
    times: TimeRanges


@dataclass(frozen=True)
class VesselView:
    """One vessel on one recording."""

    name: str
    rmse: Mapping[str, float]
    nrmse: float
    ci95: tuple[float, float] | None
    floor: float
    worst: tuple[RegimeView, ...]
    figures: Mapping[str, FigureData]


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
    """One step that can be taken: the effects, the error then, and the vessel file's text then."""

    effects: tuple[str, ...]
    bar: LadderBar
    text: str


@dataclass(frozen=True)
class AlternativeView:
    """What was ranked but not chosen: its step, and its evidence where that is worth a look.

    rival   these data cannot tell it from what was chosen
    """

    step: LadderView
    rival: bool
    evidence: FigureData | None = None


@dataclass(frozen=True)
class DiagnosisView:
    """A diagnosis: what `shadow diagnose --json` prints, its steps, its figures.

    looks   effect -> what it looks like
    before  effects that the vessel had when it was diagnosed
    """

    answer: Mapping[str, Any]
    logs: tuple[str, ...]
    floor: float
    steps: tuple[LadderView, ...]
    ranking: FigureData | None
    evidence: Mapping[str, FigureData]
    looks: Mapping[str, str] = field(default_factory=dict)
    separations: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    alternatives: tuple[AlternativeView, ...] = ()

    def up_to(self, step: LadderView) -> tuple[LadderView, ...]:
        """The steps on the way to one, and itself."""
        if step in self.steps:
            return self.steps[: self.steps.index(step) + 1]
        n = len(step.effects)
        below = (s for s in self.steps if s.effects == step.effects[: len(s.effects)])
        return (*(s for s in below if len(s.effects) < n), step)

    def added_since(self, effects: tuple[str, ...]) -> tuple[str, ...] | None:
        """Which of a vessel's effects were added since; None where it is another vessel."""
        n = len(self.before)
        return effects[n:] if effects[:n] == self.before else None

    def next_steps(self, effects: tuple[str, ...]) -> list[LadderView]:
        """What can be added to these effects, what was chosen first."""
        every = (*self.steps, *(alternative.step for alternative in self.alternatives))
        return [step for step in every if step.effects and step.effects[:-1] == effects]
