"""Stretches of time that the user leaves out: FROM:TO, or RECORDING:FROM:TO for one of several."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gateway.errors import BadInput
from sim.trial import Stretch, Trial

WHY = "left out by --exclude"
EXPECTED = "expected FROM:TO or RECORDING:FROM:TO, in seconds after its first sample"


@dataclass(frozen=True)
class Exclusion:
    """From when to when [s after the first sample]; of one recording, or of all."""

    start: float
    end: float
    recording: str | None = None


def exclusions_of(texts: Iterable[str]) -> tuple[Exclusion, ...]:
    """What a command line says; an empty end is the recording's own."""
    return tuple(_exclusion(text) for text in texts)


def _exclusion(text: str) -> Exclusion:
    name, _, rest = text.rpartition(":")[0].rpartition(":")
    last = text.rpartition(":")[2]
    try:
        start, end = float(rest or 0.0), float(last or np.inf)
    except ValueError:
        raise BadInput(f"--exclude {text}: {EXPECTED}") from None
    if ":" not in text or not start < end:
        raise BadInput(f"--exclude {text}: {EXPECTED}")
    return Exclusion(start, end, name or None)


def without(trials: Sequence[Trial], exclusions: Sequence[Exclusion]) -> list[Trial]:
    """The trials with those stretches not usable, and told among what is excluded."""
    names = [trial.name for trial in trials]
    for one in exclusions:
        if one.recording is not None and one.recording not in names:
            raise BadInput(f"--exclude: no recording {one.recording!r}: there are {names}")
    return [_without(trial, exclusions) for trial in trials]


def _without(trial: Trial, exclusions: Sequence[Exclusion]) -> Trial:
    usable, told = trial.usable.copy(), list(trial.excluded)
    for one in exclusions:
        if one.recording in (None, trial.name):
            usable[(trial.time >= one.start) & (trial.time < one.end)] = False
            told.append(Stretch(one.start, min(one.end, float(trial.time[-1])), WHY))
    return replace(trial, usable=usable, excluded=tuple(told))
