"""The page in the browser: what a user does in five steps, by mouse (`shadow studio`).

Here: what the pages show, as plain values that cross from one process into another.

What is kept from one day to the next, named ranges, plots and derived signals, is one small file,
studio-layout.json, beside the results; it is written whole or not at all.

What a page shows is kept in its address: a reload, a step back and a link show the same again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.figures import FigureData
from gateway.figures.diagnosis import LadderBar
from gateway.files import write_whole
from sim.comparison.compare import Standing
from sim.state import Floats
from sim.trial import Trial

TimeRanges = tuple[tuple[float, float], ...]  # from, to [s]


def inside(time: Floats, ranges: TimeRanges) -> NDArray[np.bool_]:
    """Which of the times (n,) [s] lie in one of the stretches: (n,)."""
    out = np.zeros(len(time), np.bool_)
    for start, end in ranges:
        out |= (time >= start) & (time <= end)
    return out


@dataclass(frozen=True)
class Scope:
    """Stretches of one recording that alone are worked on, or that are left out.

    Without stretches all of it is worked on, as all of every other recording always is.
    """

    recording: str = ""
    times: TimeRanges = ()
    without: bool = False

    @property
    def text(self) -> str:
        """In words; empty where nothing is left out."""
        if not self.times:
            return ""
        first = ", ".join(f"{start:.1f}–{end:.1f} s" for start, end in self.times[:3])
        more = f" and {len(self.times) - 3} more" if len(self.times) > 3 else ""
        part = f"all but {first}{more}" if self.without else f"only {first}{more}"
        return f"of {self.recording} {part}"

    def of(self, trial: Trial) -> Trial:
        """The trial with what is left out not usable."""
        if not self.times or trial.name != self.recording:
            return trial
        kept = inside(trial.time, self.times)
        return replace(trial, usable=trial.usable & (~kept if self.without else kept))


WHOLE = Scope()


@dataclass(frozen=True)
class RegimeView:
    """A regime in words, and the stretches of time that belong to it."""

    text: str
    times: TimeRanges


@dataclass(frozen=True)
class VesselView:
    """One vessel on one recording.

    motion  (T, 6) η and ν of its free predictions on the recording's rows, NaN between them
    force   (T, 4) missing X, Y and their standard deviations [N]
    """

    name: str
    rmse: Mapping[str, float]
    nrmse: float
    ci95: tuple[float, float] | None
    standing: Standing
    worst: tuple[RegimeView, ...]
    figures: Mapping[str, FigureData]
    motion: Floats | None = None
    force: Floats | None = None


@dataclass(frozen=True)
class TrialView:
    """One stretch of a recording; without vessels while it is still being compared.

    rough   a first look: the whole reading takes its place
    """

    name: str
    log: str
    seconds: float
    time: Floats  # (T,)
    east: Floats  # (T,)
    north: Floats  # (T,)
    measured: FigureData
    commands: FigureData
    vessels: tuple[VesselView, ...] = ()
    notices: tuple[str, ...] = ()
    origin_deg: tuple[float, float] | None = None
    motion: Floats = field(default_factory=lambda: np.empty((0, 6)))  # (T, 6) η, ν as measured
    start_time_ns: int = 0  # of the boat's clock
    rough: bool = False


@dataclass(frozen=True)
class ComparisonView:
    """All recordings that could be compared, those that could not with the reason, and by what.

    vessels   (label, vessel file's text) each, as they were asked for
    scope     what was left out
    """

    trials: tuple[TrialView, ...]
    refused: Mapping[str, str]
    vessels: tuple[tuple[str, str], ...]
    scope: Scope = WHOLE


@dataclass(frozen=True)
class LadderView:
    """One step that can be taken: the effects, the error then, and the vessel file's text then.

    says    what its last effect says with its fitted numbers, in a sentence
    """

    effects: tuple[str, ...]
    bar: LadderBar
    text: str
    says: str = ""


@dataclass(frozen=True)
class AlternativeView:
    """An effect that was ranked but not chosen: its step, and evidence that is worth a look.

    rival        these data cannot tell it from what was chosen
    contradicted its own curve points the other way than what is missing: it is not offered
    """

    step: LadderView
    rival: bool
    contradicted: bool = False
    evidence: FigureData | None = None


@dataclass(frozen=True)
class DiagnosisView:
    """A diagnosis: what `shadow diagnose --json` prints, its steps, its figures.

    headlines  the answer in sentences, what matters first
    causes  effect that was found -> what it says with its fitted numbers
    looks   effect -> what it looks like
    before  effects that the vessel had when it was diagnosed
    motion  effects of a step -> velocities measured, without its last effect, and with it
    why_not effect that was not chosen -> why, in a sentence
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
    headlines: tuple[str, ...] = ()
    causes: Mapping[str, str] = field(default_factory=dict)
    motion: Mapping[tuple[str, ...], FigureData] = field(default_factory=dict)
    why_not: Mapping[str, str] = field(default_factory=dict)

    @property
    def curve(self) -> tuple[str, ...]:
        """Effects of the alternative with the curve, where nothing in the catalogue is it."""
        return tuple((self.answer.get("curve") or {"effects": ()})["effects"])

    @property
    def curve_stands_alone(self) -> bool:
        """Whether the curve does without the effects of the last step: these only come near."""
        return bool(self.curve) and not set(self.steps[-1].effects) <= set(self.curve)

    def is_advised(self, step: LadderView) -> bool:
        """Whether a step leads to what predicts unseen time best."""
        return step.effects == self.curve or (step in self.steps and not self.curve_stands_alone)

    def up_to(self, step: LadderView) -> tuple[LadderView, ...]:
        """The steps on the way to one, and itself."""
        if step in self.steps:
            return self.steps[: self.steps.index(step) + 1]
        n = len(step.effects)
        below = (s for s in self.steps if s.effects == step.effects[: len(s.effects)])
        return (*(s for s in below if len(s.effects) < n), step)

    def step_of(self, effect: str) -> tuple[str, ...]:
        """The effects of the step that brought one in; none where no step did."""
        steps = (step.effects for step in self.steps if effect in step.effects)
        return min(steps, key=len, default=())

    def added_since(self, effects: tuple[str, ...]) -> tuple[str, ...] | None:
        """Which of a vessel's effects were added since; None where it is another vessel."""
        n = len(self.before)
        return effects[n:] if effects[:n] == self.before else None

    def next_steps(self, effects: tuple[str, ...]) -> list[LadderView]:
        """The steps that can be added to these effects, the one that is advised first."""
        others = (one.step for one in self.alternatives if not one.contradicted)
        every = (*self.steps, *others)
        can = [step for step in every if step.effects and step.effects[:-1] == effects]
        return sorted(can, key=lambda step: not self.is_advised(step))


LAYOUT_FILE = "studio-layout.json"


@dataclass(frozen=True)
class NamedRange:
    """Stretches of time [s] of one recording."""

    recording: str
    times: TimeRanges


@dataclass(frozen=True)
class Layout:
    """ranges by name; derived signals, name -> expression; plots, each the names of its signals."""

    ranges: Mapping[str, NamedRange] = field(default_factory=dict)
    derived: Mapping[str, str] = field(default_factory=dict)
    plots: tuple[tuple[str, ...], ...] = ()


def load_layout(folder: Path) -> Layout:
    """The layout kept in a folder; an empty one where none is, BadInput where it cannot be read."""
    file = folder / LAYOUT_FILE
    try:
        return msgspec.json.decode(file.read_bytes(), type=Layout)
    except FileNotFoundError:
        return Layout()
    except (OSError, msgspec.MsgspecError) as error:
        raise BadInput(
            f"{LAYOUT_FILE} cannot be read, move it away to begin anew: {error}"
        ) from None


def save_layout(layout: Layout, folder: Path) -> None:
    """Keep it, but never in the place of a file that cannot be read."""
    load_layout(folder)
    text = msgspec.json.format(msgspec.json.encode(layout), indent=1)
    write_whole(folder / LAYOUT_FILE, text, "the layout")


MOST_RANGES = 60  # that an address holds: one that is longer than 1 kB is cut by mail programs


class Address:
    """The query of one open page: names and texts. Others than those written are kept.

    But for the token of an exposed studio: it is a cookie by now, and goes out with no link.
    """

    def __init__(self) -> None:
        from panel import state  # workers need nothing of the pages

        self._location: Any = state.location
        search = self._location.search if self._location is not None else ""
        self._values = dict(parse_qsl((search or "").lstrip("?")))
        self._values.pop("token", None)

    def read(self, name: str) -> str | None:
        """The text that the address holds under a name, None where it holds none."""
        return self._values.get(name)

    def write(self, **values: str | None) -> None:
        """Say something else; None or nothing takes a name away."""
        kept = {k: v for k, v in {**self._values, **values}.items() if v}
        if kept == self._values:
            return
        self._values = kept
        if self._location is not None:
            self._location.search = f"?{urlencode(kept)}" if kept else ""


def ranges_text(ranges: TimeRanges) -> str:
    """Stretches of time [s] as they stand in an address: 12.0:15.5,20.0:31.0."""
    if len(ranges) > MOST_RANGES:
        return ""
    return ",".join(f"{start:.1f}:{end:.1f}" for start, end in ranges)


def ranges_in(text: str | None) -> TimeRanges:
    """Stretches of time [s] from an address; none where it holds anything else."""
    try:
        pairs = [tuple(map(float, one.split(":"))) for one in (text or "").split(",") if one]
        return tuple((start, end) for start, end in pairs if start < end)
    except ValueError:
        return ()
