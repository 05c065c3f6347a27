"""Recordings and vessel files -> comparisons, and their pictures."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.pictures.album import album
from gateway.pictures.draw import save
from gateway.pipelines.side_by_side import Compared, side_by_side, told_apart
from gateway.pipelines.trials import TrialOptions
from sim.comparison.compare import Comparison
from sim.effects.effect import Effect
from sim.prediction.segments import CompareSettings
from sim.vessel import Vessel

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
    return {"trials": [comparison.as_dict() for comparison in comparisons]}


def save_pictures(one: Compared, folder: str | Path) -> list[Path]:
    """All pictures of one trial into a folder."""
    return [
        save(figure, Path(folder) / f"{file_name(f'{one.trial.name} {name}')}{PICTURE}")
        for name, figure in album(one.trial, one.comparisons).items()
    ]


def file_name(text: str) -> str:
    """Letters, digits, dots and dashes alone."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-").lower()
