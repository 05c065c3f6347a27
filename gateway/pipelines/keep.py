"""What is kept of a diagnosis: its JSON, the better vessel file, its pictures."""

from collections.abc import Callable, Iterable
from pathlib import Path

from gateway.pictures.diagnosed import album
from gateway.pictures.draw import save as save_picture
from gateway.pipelines.add import DiagnosisFile, added
from gateway.pipelines.compare import PICTURE, file_name
from gateway.pipelines.diagnosed import Diagnosed, save_json
from sim.effects.effect import Effect


def kept(
    found: Diagnosed,
    *,
    save: Path | None = None,
    out: Path | None = None,
    pictures: Path | None = None,
    effects: Iterable[Effect] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> None:
    """Write what was asked for; no vessel file where there is nothing better to write."""
    if save is not None:
        save_json(found.as_dict(), save)
    if pictures is not None:
        tell("pictures")
        save_pictures(found, pictures)
    if out is not None and found.improves:
        told = DiagnosisFile.model_validate(found.as_dict())
        names = found.diagnosis.effects
        added(names, found.vessel_file, told, save or "the diagnosis", out, effects)


def save_pictures(found: Diagnosed, folder: Path) -> list[Path]:
    """All pictures into a folder."""
    pictures = album(found.diagnosis, found.trials)
    return [
        save_picture(figure, folder / f"{file_name(name)}{PICTURE}")
        for name, figure in pictures.items()
    ]
