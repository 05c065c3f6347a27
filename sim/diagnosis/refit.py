"""What belongs to one voyage, estimated anew on blocks of time that it is not judged by.

    blocks 1, 3, 5, …  →  numbers of the day  →  judged on blocks 2, 4, 6, …      and the other way

A current of one day means nothing on the next: a vessel that holds one gets the same chance on
every voyage. Blocks lie at least 5 s apart, and all vessels of a comparison are judged on the same
ones. Only parameters of effects with scope `voyage` move; the boat stays as it is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis.blocks import blocks, stretches
from sim.diagnosis.compare import Comparison, judged
from sim.diagnosis.day import of_the_day, today, values_of_day
from sim.diagnosis.free_run import FreeRun, free_run
from sim.diagnosis.missing import MissingForce, missing_force
from sim.diagnosis.prediction import Prediction, predict
from sim.diagnosis.regimes import regimes_of
from sim.diagnosis.ruler import Ruler
from sim.diagnosis.segments import NoUsableTimeError
from sim.diagnosis.settings import CompareSettings
from sim.model import Model
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import Vessel

LENGTH_S = 25.0  # of a block
FEWEST = 4  # blocks: two for each half


class TooShortError(NoUsableTimeError):
    """A trial that cannot be halved into blocks."""


@dataclass(frozen=True)
class Halves:
    """A trial cut into blocks, and the two halves of them.

    trial   with only the blocks usable: what is judged
    number  (T,) 0 or 1: the half that a row is in, −1 between blocks
    """

    trial: Trial
    number: Ints

    @classmethod
    def of(cls, trial: Trial) -> "Halves":
        """Every second block; TooShortError where there are fewer than four."""
        cut = blocks(trial.usable, trial.dt, LENGTH_S)
        if len(cut) < FEWEST:
            raise TooShortError(
                f"{trial.name}: time for {len(cut)} of the {FEWEST} blocks of {LENGTH_S:g} s that "
                "are needed to fit on some and judge by others"
            )
        number = np.full(len(trial), -1, np.int64)
        for i, block in enumerate(cut):
            number[block.start : block.stop] = i % 2
        return cls(replace(trial, usable=trial.usable & (number >= 0)), number)

    def half(self, number: int) -> Trial:
        """The trial with only one half usable."""
        return replace(self.trial, usable=self.trial.usable & (self.number == number))


@dataclass(frozen=True)
class Refitted:
    """One vessel on one day: a model for either half of the blocks, fitted on the other half.

    values  what was found on the half that each was fitted on, by name; empty: nothing to fit
    """

    halves: Halves
    models: tuple[Model, Model]
    values: tuple[Mapping[str, float], Mapping[str, float]]

    def predict(self, ruler: Ruler) -> Prediction:
        """Each free run by the model that did not see its block."""
        a, b = (predict(self.halves.trial, model, ruler) for model in self.models)
        first = self.halves.number[a.rows] == 0
        each = first[:, None, None]
        return Prediction(
            a.rows, a.steps, np.where(each, a.model, b.model), np.where(each, a.error, b.error),
            np.where(first, a.diverged, b.diverged),
        )  # fmt: skip

    def missing(self) -> MissingForce:
        """Each row by the model that did not see its block."""
        a, b = (missing_force(self.halves.trial, model) for model in self.models)
        first = (self.halves.number == 0)[:, None]
        return MissingForce(np.where(first, a.force, b.force), np.where(first, a.std, b.std))

    def alone(self, scales: Floats) -> FreeRun:
        """One free run over the longest block, by the model that did not see it."""
        longest = max(stretches(self.halves.trial.usable), key=len)
        model = self.models[int(self.halves.number[longest.start])]
        return free_run(self.halves.trial, model, scales)


def compare_refitted(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Comparison]:
    """As `compare`, each vessel with what belongs to the day estimated anew on other blocks."""
    halves = Halves.of(trial)
    ruler = Ruler.of(halves.trial, models[0], settings)
    regimes = regimes_of(halves.trial, models[0])
    out = []
    for model in models:
        progress(model.vessel.name)
        day = refitted(halves, model.vessel, progress)
        told = judged(halves.trial, model.vessel.name, ruler, regimes, day.predict(ruler),
                      day.missing(), day.alone(ruler.scales))  # fmt: skip
        out.append(replace(told, refit=day.values if day.values[0] else ()))
    return out


def refitted(
    halves: Halves, vessel: Vessel, tell: Callable[[str], None] = lambda _: None
) -> Refitted:
    """The vessel with what belongs to the day, for either half from the other."""
    if not of_the_day(vessel):
        model = Model.of(vessel)
        return Refitted(halves, (model, model), ({}, {}))
    found = []
    for number in (0, 1):
        tell(f"{vessel.name}: {', '.join(of_the_day(vessel))}, half {number + 1} of 2")
        found.append(today(halves.half(1 - number), vessel))
    values = tuple(values_of_day(one) for one in found)
    models = tuple(Model.of(one) for one in found)
    return Refitted(halves, (models[0], models[1]), (values[0], values[1]))
