"""Recordings and vessel files -> comparisons, and their pictures."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.pictures.album import album
from gateway.pictures.draw import save
from gateway.pipelines.trials import TrialOptions, load_trials
from gateway.vessel_file import load_vessel
from sim.diagnosis.compare import Comparison, compare
from sim.diagnosis.prediction import DivergedError
from sim.diagnosis.segments import NoUsableTimeError
from sim.diagnosis.settings import CompareSettings
from sim.effects.effect import Effect
from sim.model import Model
from sim.trial import Trial
from sim.vessel import Vessel

Progress = Callable[[str], None]
PICTURE = ".png"


def compare_logs(
    logs: Sequence[str | Path],
    vessels: Sequence[str | Path | Vessel],
    settings: CompareSettings | None = None,
    *,
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    effects: Iterable[Effect] = (),
    pictures: str | Path | None = None,
    progress: Progress | None = None,
) -> list[Comparison]:
    """Every trial of every log against every vessel; the first vessel gives each trial's ruler.

    Trials without usable time are left out; a log of nothing else is bad input. `pictures` names
    a folder that gets all pictures; `effects` are known beside the catalogue's.
    """
    tell = progress or (lambda _: None)
    if not logs or not vessels:
        raise BadInput("nothing to compare: give at least one recording and one vessel file")
    models = [Model.of(vessel) for vessel in told_apart(vessels, tuple(effects))]
    out: list[Comparison] = []
    for log in logs:
        tell(f"reading {Path(log).name}")
        trials = load_trials(log, system, options, mapping)
        found = [_compared(trial, models, settings, pictures, tell) for trial in trials]
        if not any(found):
            raise BadInput(f"{log}: no stretch that can be compared over: {_excluded(trials)}")
        out += [one for comparisons in found for one in comparisons]
    return out


def as_json(comparisons: Iterable[Comparison]) -> dict[str, Any]:
    """What `shadow compare --json` prints."""
    return {"trials": [comparison.as_dict() for comparison in comparisons]}


def save_pictures(
    trial: Trial, comparisons: Sequence[Comparison], folder: str | Path
) -> list[Path]:
    """All pictures of one trial into a folder."""
    return [
        save(figure, Path(folder) / f"{_file_name(f'{trial.name} {name}')}{PICTURE}")
        for name, figure in album(trial, comparisons).items()
    ]


def told_apart(
    vessels: Sequence[str | Path | Vessel], effects: Sequence[Effect] = ()
) -> list[Vessel]:
    """Vessels or their files -> vessels with names of their own: old and new often share one."""
    read = [v if isinstance(v, Vessel) else load_vessel(v, effects) for v in vessels]
    names = [v.name for v in read]
    out = []
    for i, (given, vessel) in enumerate(zip(vessels, read, strict=True)):
        mark = f"#{i + 1}" if isinstance(given, Vessel) else Path(given).name
        twin = names.count(vessel.name) > 1
        out.append(replace(vessel, name=f"{vessel.name} ({mark})") if twin else vessel)
    return out


def _compared(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None,
    pictures: str | Path | None,
    tell: Progress,
) -> list[Comparison]:
    """All vessels on one trial; nothing where no time can be used."""
    try:
        found = compare(trial, models, settings, lambda name: tell(f"{trial.name}: {name}"))
    except DivergedError as problem:
        raise BadInput(f"{trial.name}: {problem}") from None
    except NoUsableTimeError as problem:
        tell(f"left out, {problem}")
        return []
    if pictures is not None:
        tell(f"{trial.name}: pictures")
        save_pictures(trial, found, pictures)
    return found


def _excluded(trials: Sequence[Trial]) -> str:
    """Why time is left out, in seconds per reason."""
    seconds: defaultdict[str, float] = defaultdict(float)
    for trial in trials:
        for stretch in trial.excluded:
            seconds[stretch.why] += stretch.end - stretch.start
    return ", ".join(f"{why} {s:.0f} s" for why, s in seconds.items()) or "all are too short"


def _file_name(text: str) -> str:
    """Letters, digits, dots and dashes alone."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-").lower()
