"""Recordings and vessels -> trials with their comparisons, for whoever tells or draws them.

Recordings and vessel files -> comparisons, and their pictures.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, numerical_errors
from gateway.figures.comparison import comparison_figures
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.trials import TrialOptions, left_out, load_trials
from gateway.offline.usable import notices_of
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison, compare
from sim.comparison.refit import MIN_BLOCKS, compare_refitted
from sim.effects.effect import Effect
from sim.model import Model
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import BLOCK_S, CompareSettings, NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Compared:
    """One trial and its comparisons, a vessel each, under one ruler."""

    trial: Trial
    comparisons: tuple[Comparison, ...]


def side_by_side(
    logs: Sequence[str | Path],
    vessels: Sequence[str | Path | Vessel],
    *,
    settings: CompareSettings | None = None,
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    effects: Iterable[Effect] = (),
    refit: bool = False,
    tell: Tell = lambda _: None,
) -> list[Compared]:
    """Every trial with usable time of every log; BadInput where there is none at all.

    The first vessel gives each trial's ruler; `effects` are known beside the catalogue's. `refit`:
    what belongs to one voyage is estimated anew, on blocks that it is not judged by.
    """
    if not logs or not vessels:
        raise BadInput("nothing to compare: give at least one recording and one vessel file")
    models = [Model.of(vessel) for vessel in told_apart(vessels, tuple(effects))]
    out: list[Compared] = []
    trials: list[Trial] = []
    for log in logs:
        tell(f"reading {Path(log).name}")
        read = load_trials(log, system, options, mapping)
        for trial in read:
            out += compared_trial(trial, models, settings, tell, refit)
        trials += read
    if not out:
        names = ", ".join(str(log) for log in logs)
        needed = f" (--refit needs {MIN_BLOCKS} blocks of {BLOCK_S:g} s)" if refit else ""
        why = left_out(trials) or "all are too short"
        raise BadInput(f"{names}: no stretch that can be compared over{needed}: {why}")
    return out


def compared_trial(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None,
    tell: Tell,
    refit: bool = False,
) -> list[Compared]:
    """All models on one trial; nothing where no time of it can be used."""
    how = compare_refitted if refit else compare
    try:
        with numerical_errors(trial.name, ", ".join(model.vessel.name for model in models)):
            found = how(trial, models, settings, lambda name: tell(f"{trial.name}: {name}"))
    except DivergedError as problem:
        raise BadInput(f"{trial.name}: {problem}") from None
    except NoUsableTimeError as problem:
        tell(f"left out, {problem}")
        return []
    told = [
        replace(one, notices=notices_of([trial], model.vessel))
        for one, model in zip(found, models, strict=True)
    ]
    return [Compared(trial, tuple(told))]


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
    progress: Callable[[str], None] | None = None,
    refit: bool = False,
) -> list[Comparison]:
    """Every trial of every log against every vessel; `refit` as in `side_by_side`.

    Trials without usable time are left out; a log of nothing else is bad input. `pictures` names
    a folder that gets all pictures.
    """
    tell = progress or (lambda _: None)
    if not logs:
        raise BadInput("nothing to compare: give at least one recording and one vessel file")
    chosen = told_apart(vessels, tuple(effects))
    out: list[Comparison] = []
    for log in logs:
        found = side_by_side(
            [log], chosen, settings=settings, system=system, options=options, mapping=mapping,
            refit=refit, tell=tell,
        )  # fmt: skip
        for one in found:
            if pictures is not None:
                tell(f"{one.trial.name}: pictures")
                save_pictures(one, pictures)
            out += one.comparisons
    return out


def as_json(comparisons: Iterable[Comparison]) -> dict[str, Any]:
    """What `shadow compare --json` prints."""
    return {"trials": [comparison.to_dict() for comparison in comparisons]}


def save_pictures(one: Compared, folder: str | Path) -> list[Path]:
    """All pictures of one trial into a folder."""
    return [
        save_figure(figure, Path(folder) / f"{file_name(f'{one.trial.name} {name}')}{PICTURE}")
        for name, figure in comparison_figures(one.trial, one.comparisons).items()
    ]


def file_name(text: str) -> str:
    """Letters, digits, dots and dashes alone."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-").lower()
