"""An identification -> its pictures in a folder."""

from collections.abc import Sequence
from pathlib import Path

from gateway.pictures.draw import save
from gateway.pictures.identified import album, parameters
from gateway.pipelines.compare import file_name
from sim.identification.identify import Identified
from sim.model import Model
from sim.prediction.free_runs import predict
from sim.prediction.scales import Ruler
from sim.trial import Trial
from sim.vessel import Vessel


def save_pictures(
    found: Identified,
    before: Vessel,
    trials: Sequence[Trial],
    others: Sequence[Trial],
    folder: str | Path,
) -> list[Path]:
    """Parameters, and of each recording velocities and track: measured, before and after."""
    pictures = {f"{found.vessel.name} parameters": parameters(found.vessel.name, found.estimates)}
    first = Model.of(before)
    vessels = [*found.vessels, *(found.vessel for _ in others)]
    for trial, vessel in zip((*trials, *others), vessels, strict=True):
        ruler = Ruler.of(trial, first)
        both, later = (first, Model.of(vessel)), found.command_offset
        was, now = (predict(trial, model, ruler, later) for model in both)
        drawn = album(trial, was, now, ruler.settings.horizon)
        pictures |= {f"{trial.name} {name}": figure for name, figure in drawn.items()}
    return [save(p, Path(folder) / f"{file_name(name)}.png") for name, p in pictures.items()]
