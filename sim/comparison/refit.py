"""Effects of one voyage, estimated on blocks of time other than those they are scored on.

    blocks 1, 3, 5, …  →  parameters of the voyage  →  scored on blocks 2, 4, 6, …  and vice versa

A current of one day means nothing on the next: a vessel that holds one gets the same chance on
every voyage. Blocks lie at least 5 s apart, and all vessels of a comparison are scored on the same
ones. Only parameters of effects with scope `voyage` move (current, wind, the moment of a fault);
the boat stays as it is. A moment, a phase or a direction is not found downhill: each effect's
starts are tried in turn, the best few are fitted, and the one that predicts the trial best is
taken.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.comparison import regimes_of
from sim.comparison.compare import Comparison, comparison_of, with_shown_floor
from sim.effects.effect import Effect, Kind, Role, Scope
from sim.identification import IdentifySettings, updated_vessel
from sim.identification.identify import fitted_model
from sim.identification.parameters import unknowns_of
from sim.identification.search import MOMENT_STARTS, start_points
from sim.identification.shooting import FitInputs, fit_by_shooting
from sim.model import Model
from sim.prediction import MissingForce, missing_force
from sim.prediction.free_runs import (
    DivergedError,
    FreeRun,
    Prediction,
    Ruler,
    free_run,
    nrmse,
    predict,
    shared_ruler,
)  # fmt: skip
from sim.prediction.segments import (
    BLOCK_S,
    CompareSettings,
    NoUsableTimeError,
    longest_stretch,
    time_blocks,
)
from sim.state import Floats, Ints
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

MIN_BLOCKS = 4  # two for each fold
# The search; all chosen, not measured.
FITTED_STARTS = 3  # the best starts of all effects, that are fitted
FIT_HORIZONS_S = (2.0, 6.0)  # of the fits: the base is known, so runs need not begin short
FINER_MOMENTS = 4  # to either side of the best, between it and the neighbouring starts


class TooShortError(NoUsableTimeError):
    """A trial that cannot be cut into two folds of blocks."""


@dataclass(frozen=True)
class TwoFolds:
    """A trial cut into blocks that belong to two folds in turn.

    trial   with only the blocks usable: what is scored
    fold    (T,) 0 or 1 of each row, −1 between blocks
    """

    trial: Trial
    fold: Ints

    @classmethod
    def of(cls, trial: Trial) -> "TwoFolds":
        """Every second block in each; TooShortError where there are fewer than four."""
        cut = time_blocks(trial.usable, trial.dt)
        if len(cut) < MIN_BLOCKS:
            raise TooShortError(
                f"{trial.name}: time for {len(cut)} of the {MIN_BLOCKS} blocks of {BLOCK_S:g} s "
                "that are needed to fit on some and judge by others"
            )
        fold = np.full(len(trial), -1, np.int64)
        for i, block in enumerate(cut):
            fold[block.start : block.stop] = i % 2
        return cls(replace(trial, usable=trial.usable & (fold >= 0)), fold)

    def only(self, fold: int) -> Trial:
        """The trial with one fold usable."""
        return replace(self.trial, usable=self.trial.usable & (self.fold == fold))


@dataclass(frozen=True)
class CrossFit:
    """One vessel on one voyage: for each fold a model that was fitted on the other one.

    values  parameters of the voyage in each model, by name; empty: nothing to fit
    """

    folds: TwoFolds
    models: tuple[Model, Model]
    values: tuple[Mapping[str, float], Mapping[str, float]]

    def predict(self, ruler: Ruler) -> Prediction:
        """Each free run by the model that was not fitted on its block."""
        a, b = (predict(self.folds.trial, model, ruler) for model in self.models)
        first = self.folds.fold[a.rows] == 0
        each = first[:, None, None]
        return Prediction(
            a.rows, a.steps, np.where(each, a.model, b.model), np.where(each, a.error, b.error),
            np.where(first, a.diverged, b.diverged),
        )  # fmt: skip

    def missing_force(self) -> MissingForce:
        """Each row by the model that was not fitted on its block."""
        a, b = (missing_force(self.folds.trial, model) for model in self.models)
        first = (self.folds.fold == 0)[:, None]
        return MissingForce(np.where(first, a.force, b.force), np.where(first, a.std, b.std))

    def free_run(self, scales: Floats) -> FreeRun:
        """One free run over the longest block, by the model that was not fitted on it."""
        longest = longest_stretch(self.folds.trial)
        model = self.models[int(self.folds.fold[longest.start])]
        return free_run(self.folds.trial, model, scales)


def compare_refitted(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Comparison]:
    """Compare vessels whose parameters of the voyage were each estimated on other blocks."""
    folds = TwoFolds.of(trial)
    ruler = shared_ruler(folds.trial, models, settings)
    out = []
    for model in models:
        progress(model.vessel.name)
        fit = cross_fit(folds, model.vessel, progress)
        found = comparison_of(
            folds.trial, model.vessel.name, ruler, regimes_of(folds.trial, model),
            fit.predict(ruler),
            fit.missing_force(), fit.free_run(ruler.scales),
        )  # fmt: skip
        out.append(replace(found, refit=fit.values if fit.values[0] else ()))
    return with_shown_floor(out)


def cross_fit(
    folds: TwoFolds, vessel: Vessel, progress: Callable[[str], None] = lambda _: None
) -> CrossFit:
    """The vessel's parameters of the voyage, for each fold from the other."""
    names = [a.effect.name for a in _of_voyage(vessel)]
    if not names:
        model = Model.of(vessel)
        return CrossFit(folds, (model, model), ({}, {}))
    fits = []
    for fold in (0, 1):
        progress(f"{vessel.name}: {', '.join(names)}, half {fold + 1} of 2")
        fits.append(fit_voyage(folds.only(1 - fold), vessel))
    one, other = fits
    models, values = (Model.of(one), Model.of(other)), (_voyage_values(one), _voyage_values(other))
    return CrossFit(folds, models, values)


def _of_voyage(vessel: Vessel) -> list[AddedEffect]:
    """The effects that mean nothing on another voyage."""
    return [a for a in vessel.effects if a.effect.scope is Scope.VOYAGE]


def _voyage_values(vessel: Vessel) -> dict[str, float]:
    """Their parameters, by name."""
    return {
        f"{a.effect.name}.{k}": value for a in _of_voyage(vessel) for k, value in a.values.items()
    }


def fit_voyage(trial: Trial, vessel: Vessel) -> Vessel:
    """The best of several starts, each effect's in turn, fitted on the trial."""
    try:
        ruler = Ruler.of(trial, Model.of(vessel))
    except NoUsableTimeError:
        return vessel
    candidates = [vessel]
    for added in _of_voyage(vessel):
        more = _at_starts(trial, candidates[0], added.effect)
        candidates = _best_first(trial, [*candidates, *more], ruler)[:FITTED_STARTS]
    if vessel not in candidates:
        candidates.append(vessel)
    fits = [one for candidate in candidates for one in (candidate, _fit_from(trial, candidate))]
    best = _best_first(trial, fits, ruler)[0]
    finer = _at_finer_moments(trial, best)
    if not finer:
        return best
    better = _best_first(trial, [best, *finer], ruler)[0]
    return _best_first(trial, [better, _fit_from(trial, better)], ruler)[0]


def _at_starts(trial: Trial, vessel: Vessel, effect: Effect) -> list[Vessel]:
    """The vessel with one of its effects at every start of a search."""
    name = effect.name
    bare = replace(vessel, effects=tuple(a for a in vessel.effects if a.effect.name != name))
    starts = start_points(effect, Model.of(bare), [trial])
    # a slow swing: with a wrong direction no start is better than another
    if any(p.role is Role.PERIOD for p in effect.parameters):
        return [_fit_from(trial, _with(vessel, name, s), FIT_HORIZONS_S[-1:]) for s in starts]
    not_numbers = {p.name for p in effect.parameters if p.kind is not Kind.NUMBER}
    own_size = [{key: s[key] for key in not_numbers} for s in starts] if not_numbers else []
    return [_with(vessel, name, values) for values in (*starts, *own_size)]


def _with(vessel: Vessel, name: str, values: Mapping[str, float]) -> Vessel:
    effects = tuple(
        AddedEffect(a.effect, {**a.values, **values}) if a.effect.name == name else a
        for a in vessel.effects
    )
    return replace(vessel, effects=effects)


def _best_first(trial: Trial, vessels: Sequence[Vessel], ruler: Ruler) -> list[Vessel]:
    """In the order of their errors on the trial."""
    return sorted(vessels, key=lambda vessel: _error(trial, vessel, ruler))


def _error(trial: Trial, vessel: Vessel, ruler: Ruler) -> float:
    try:
        return nrmse(predict(trial, Model.of(vessel), ruler).predicted_rows()[2], ruler.scales)
    except DivergedError:
        return np.inf


def _fit_from(trial: Trial, vessel: Vessel, horizons: tuple[float, ...] = FIT_HORIZONS_S) -> Vessel:
    """The parameters of the voyage that have a slope, fitted from where they are."""
    free = tuple(
        f"{a.effect.name}.{key}" for a in _of_voyage(vessel) for key in a.effect.fit_parameters
    )
    if not free:
        return vessel
    settings = IdentifySettings(free=free, horizons=horizons)
    unknowns = unknowns_of(Model.of(vessel), 1, settings)
    fit = fit_by_shooting(FitInputs(unknowns, [trial], settings))
    return updated_vessel(vessel, _voyage_values(fitted_model(unknowns, fit.z).vessel))


def _at_finer_moments(trial: Trial, vessel: Vessel) -> list[Vessel]:
    """The vessel with each of its events moved to moments between those of the starts."""
    apart = 0.5 * float(trial.time[-1]) / (MOMENT_STARTS + 1)
    shifts = apart * np.linspace(-1.0, 1.0, 2 * FINER_MOMENTS + 1)
    return [
        _with(vessel, a.effect.name, {p.name: float(np.clip(a.values[p.name] + s, 0.0, p.upper))})
        for a in _of_voyage(vessel)
        for p in a.effect.parameters
        if p.kind is Kind.MOMENT
        for s in shifts
    ]
