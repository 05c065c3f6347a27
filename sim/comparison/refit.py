"""What belongs to one voyage, estimated anew on blocks of time that it is not judged by.

    blocks 1, 3, 5, …  →  numbers of the day  →  judged on blocks 2, 4, 6, …      and the other way

A current of one day means nothing on the next: a vessel that holds one gets the same chance on
every voyage. Blocks lie at least 5 s apart, and all vessels of a comparison are judged on the same
ones. Only parameters of effects with scope `voyage` move; the boat stays as it is.

What belongs to one voyage as on this one: current, wind, the moment of a fault.

A moment, a phase or a direction is not found downhill: each effect's starts are tried in turn, the
best few are fitted, and the one that predicts the trial best is taken.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.comparison.compare import Comparison, judged
from sim.comparison.regimes import regimes_of
from sim.effects.effect import Kind, Role, Scope
from sim.identification.identify import replaced
from sim.identification.parameters import unknowns_of
from sim.identification.settings import IdentifySettings
from sim.identification.shooting import shoot
from sim.identification.starts import MOMENTS, starts_of
from sim.identification.vessel_update import applied
from sim.model import Model
from sim.prediction.free_runs import DivergedError, FreeRun, Prediction, free_run, predict
from sim.prediction.missing_force import MissingForce, missing_force
from sim.prediction.scales import Ruler
from sim.prediction.scores import nrmse
from sim.prediction.segments import CompareSettings, NoUsableTimeError, blocks, stretches
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

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


FITTED = 3  # starts that are fitted
HORIZONS = (2.0, 6.0)  # s: the base is known, so runs need not begin short
FINER = 4  # moments on either side of the best, between it and its neighbours


def of_the_day(vessel: Vessel) -> list[str]:
    """Names of the effects that mean nothing on another day."""
    return [a.effect.name for a in vessel.effects if a.effect.scope is Scope.VOYAGE]


def values_of_day(vessel: Vessel) -> dict[str, float]:
    """Their numbers, by name."""
    return {
        f"{a.effect.name}.{key}": value
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for key, value in a.values.items()
    }


def today(trial: Trial, vessel: Vessel) -> Vessel:
    """The best of several starts, each effect's in turn, fitted on the trial."""
    try:
        ruler = Ruler.of(trial, Model.of(vessel))
    except NoUsableTimeError:
        return vessel
    tried = [vessel]
    for name in of_the_day(vessel):
        more = _started(trial, tried[0], name)
        tried = _ordered(trial, [*tried, *more], ruler)[:FITTED]
    if vessel not in tried:
        tried.append(vessel)
    found = [shot for one in tried for shot in (one, _shot(trial, one))]
    best = _ordered(trial, found, ruler)[0]
    finer = _finer(trial, best)
    if not finer:
        return best
    better = _ordered(trial, [best, *finer], ruler)[0]
    return _ordered(trial, [better, _shot(trial, better)], ruler)[0]


def _started(trial: Trial, vessel: Vessel, name: str) -> list[Vessel]:
    """The vessel with one of its effects at every start of a search."""
    effect = next(a.effect for a in vessel.effects if a.effect.name == name)
    bare = replace(vessel, effects=tuple(a for a in vessel.effects if a.effect.name != name))
    starts = starts_of(effect, Model.of(bare), [trial])
    # a slow swing: with a wrong direction no start is better than another
    if any(p.role is Role.PERIOD for p in effect.parameters):
        return [_shot(trial, _with(vessel, name, s), HORIZONS[-1:]) for s in starts]
    hard = {p.name for p in effect.parameters if p.kind is not Kind.NUMBER}
    as_strong = [{key: s[key] for key in hard} for s in starts] if hard else []
    return [_with(vessel, name, values) for values in (*starts, *as_strong)]


def _with(vessel: Vessel, name: str, values: Mapping[str, float]) -> Vessel:
    effects = tuple(
        AddedEffect(a.effect, {**a.values, **values}) if a.effect.name == name else a
        for a in vessel.effects
    )
    return replace(vessel, effects=effects)


def _ordered(trial: Trial, vessels: Sequence[Vessel], ruler: Ruler) -> list[Vessel]:
    """The one that predicts the trial best first."""
    return sorted(vessels, key=lambda vessel: _error(trial, vessel, ruler))


def _error(trial: Trial, vessel: Vessel, ruler: Ruler) -> float:
    try:
        return nrmse(predict(trial, Model.of(vessel), ruler).along()[2], ruler.scales)
    except DivergedError:
        return np.inf


def _shot(trial: Trial, vessel: Vessel, horizons: tuple[float, ...] = HORIZONS) -> Vessel:
    """The numbers of the day that a small step tells something of, fitted from where they are."""
    free = tuple(
        f"{a.effect.name}.{key}"
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for key in a.effect.fitted
    )
    if not free:
        return vessel
    how = IdentifySettings(free=free, horizons=horizons)
    unknowns = unknowns_of(Model.of(vessel), 1, how)
    found = shoot(unknowns, [trial], [trial.usable], how)
    return applied(vessel, values_of_day(replaced(unknowns, found.z).vessel))


def _finer(trial: Trial, vessel: Vessel) -> list[Vessel]:
    """Moments between those that a start is tried at."""
    apart = 0.5 * float(trial.time[-1]) / (MOMENTS + 1)
    shifts = apart * np.linspace(-1.0, 1.0, 2 * FINER + 1)
    return [
        _with(vessel, a.effect.name, {p.name: float(np.clip(a.values[p.name] + s, 0.0, p.upper))})
        for a in vessel.effects
        if a.effect.scope is Scope.VOYAGE
        for p in a.effect.parameters
        if p.kind is Kind.MOMENT
        for s in shifts
    ]
