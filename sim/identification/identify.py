"""Parameters of a vessel from trials: start, fit, intervals, validation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.excitation.step_response import StepResponses, step_responses
from sim.identification.instrumental import cross_check_by_instruments, instrumental
from sim.identification.intervals import (
    NUISANCE,
    Estimate,
    estimates_of,
    trade_offs,
    uncertainty_of,
    undetermined,
)
from sim.identification.output_error import fit_by_output_error
from sim.identification.parameters import OFFSETS, Unknowns, unknowns_of
from sim.identification.regression import fit_by_regression
from sim.identification.settings import BASE, IdentifySettings
from sim.identification.shooting import FitResult, fit_by_shooting
from sim.identification.validation import (
    Validation,
    held_out,
    unconfirmed_channels,
    validate,
    with_usable_rows,
)
from sim.identification.vessel_update import updated_vessel
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError
from sim.state import Floats
from sim.tables import data_frame
from sim.trial import Trial
from sim.vessel import Vessel, with_free_curves

LEAST_S = 20.0  # of usable time
EQUATIONS = {"regression": fit_by_regression, "instrumental": instrumental}


@dataclass(frozen=True)
class Identification:
    """The vessel with its new numbers, how sure they are, and what it gains on unseen time.

    vessel       with the numbers of the first recording where each has its own
    vessels      the same as on each recording
    cross_check  where instrumental variables say otherwise
    """

    vessel: Vessel
    method: str
    seconds: float
    estimates: tuple[Estimate, ...]
    nuisances: tuple[Estimate, ...]
    trade: tuple[str, ...]
    validation: tuple[Validation, ...]
    vessels: tuple[Vessel, ...] = ()
    cross_check: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()  # what looks wrong with recordings and channels

    @property
    def command_offset(self) -> float:
        """How much later than told commands act [s]; 0 where that was not looked for."""
        return next((e.value for e in self.nuisances if e.name == OFFSETS[0]), 0.0)

    @cached_property
    def answers(self) -> StepResponses:
        """How the vessel answers to a step of throttle and of the helm."""
        return step_responses(Model.of(self.vessel))

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Channels that no validation recording confirms, a sentence each."""
        return unconfirmed_channels(self.validation)

    def to_pandas(self) -> Any:
        """One row per parameter: before, value, interval, whether the data tell it."""
        return data_frame([
            {"name": e.name, "recording": e.trial, "unit": e.unit, "before": e.before,
             "value": e.value, "low": e.ci95[0], "high": e.ci95[1],
             "identifiable": e.identifiable, "doubt": e.doubt}
            for e in (*self.estimates, *self.nuisances)
        ])  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """What `shadow identify --json` prints."""
        shared = {e.name: e.to_dict() for e in self.estimates if e.trial is None}
        of_trials: dict[str, dict[str, Any]] = {}
        for e in self.estimates:
            if e.trial is not None:
                of_trials.setdefault(e.trial, {})[e.name] = e.to_dict()
        return {
            "vessel": self.vessel.name, "method": self.method, "seconds": self.seconds,
            "parameters": shared, "parameters_of_recordings": of_trials,
            "offsets": {e.name: e.to_dict() for e in self.nuisances},
            "trade": list(self.trade), "validation": [v.to_dict() for v in self.validation],
            "cross_check": list(self.cross_check), "notices": list(self.notices),
            "not_identifiable": list(self.unconfirmed), "step_responses": self.answers.to_dict(),
        }  # fmt: skip


def identify(
    trials: Sequence[Trial],
    vessel: Vessel,
    settings: IdentifySettings | None = None,
    others: Sequence[Trial] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Fit on the trials, validate on `others`, or else on blocks that another fit did not see."""
    settings = settings or IdentifySettings()
    seconds = sum(float(t.usable.sum()) * t.dt for t in trials)
    if seconds < LEAST_S:
        raise NoUsableTimeError(f"{seconds:.0f} s of usable time: {LEAST_S:.0f} s are needed")
    before = Model.of(with_free_curves(vessel, settings.free))
    if settings.method in EQUATIONS:
        return _by_equations(trials, before, settings, others, seconds)
    unknowns = unknowns_of(before, len(trials), settings)
    shot = _search(unknowns, trials, [t.usable for t in trials], settings, None, tell)
    spread = uncertainty_of(unknowns, shot, settings.block)
    vague = undetermined(unknowns, shot.z, spread)
    if vague.any() and not vague.all():
        shot = _without(unknowns, vague, shot, trials, settings)
    every = estimates_of(unknowns, shot.z, spread, [t.name for t in trials])
    afters = [fitted_model(unknowns, shot.z, i) for i in range(len(trials))]
    after = afters[0]
    later = _later(unknowns, shot.z)
    validation = [validate(t, before, after, t.name, later=later) for t in others]
    if not others:
        tell("validation")
        validation = _on_held_out(unknowns.held(vague), trials, shot, settings, before)
    estimates = tuple(e for e in every if e.name not in NUISANCE)
    return Identification(
        after.vessel, settings.method, seconds, estimates,
        tuple(e for e in every if e.name in NUISANCE),
        trade_offs(unknowns, shot.z, spread), tuple(validation),
        tuple(model.vessel for model in afters), cross_check_by_instruments(trials, after, estimates),
    )  # fmt: skip


def _search(
    unknowns: Unknowns,
    trials: Sequence[Trial],
    usable: Sequence[NDArray[np.bool_]],
    settings: IdentifySettings,
    start: Floats | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FitResult:
    """By the method that was asked for."""
    find = fit_by_output_error if settings.method == "simulation" else fit_by_shooting
    return find(unknowns, trials, usable, settings, start, tell)


def fitted_model(unknowns: Unknowns, z: Floats, trial: int = 0) -> Model:
    """The model with the numbers found; those of one voyage as on that trial."""
    theta = unknowns.theta(z[None], trial)[0]
    model = unknowns.model
    values = dict(zip(model.names, theta.tolist(), strict=True))
    changed = {u.name: values[u.name] for u in unknowns.each if u.name in values}
    return replace(model, vessel=updated_vessel(model.vessel, changed), theta=theta)


def _without(
    unknowns: Unknowns,
    vague: NDArray[np.bool_],
    shot: FitResult,
    trials: Sequence[Trial],
    settings: IdentifySettings,
) -> FitResult:
    """Once more, with what the data do not tell left as it was."""
    last = replace(settings, horizons=settings.horizons[-1:])
    start = np.where(vague, unknowns.start, shot.z)
    return _search(unknowns.held(vague), trials, [t.usable for t in trials], last, start)


def _on_held_out(
    unknowns: Unknowns,
    trials: Sequence[Trial],
    shot: FitResult,
    settings: IdentifySettings,
    before: Model,
) -> list[Validation]:
    """Another fit without each fourth block, judged on those blocks."""
    cuts = [held_out(trial) for trial in trials]
    if not any(cuts):
        return []
    usable = [t.usable if cut is None else cut[0] for t, cut in zip(trials, cuts, strict=True)]
    last = replace(settings, horizons=settings.horizons[-1:])
    again = _search(unknowns, trials, usable, last, shot.z)
    out = []
    for i, (trial, cut) in enumerate(zip(trials, cuts, strict=True)):
        if cut is not None:
            after = fitted_model(unknowns, again.z, i)
            name = f"{trial.name}, blocks held out"
            judged, later = with_usable_rows(trial, cut[1]), _later(unknowns, again.z)
            out.append(validate(judged, before, after, name, alone=False, later=later))
    return out


def _later(unknowns: Unknowns, z: Floats) -> float:
    """How much later than told commands act [s]: of the telemetry, so of other recordings too."""
    return float(unknowns.offset(z[None], OFFSETS[0])[0])


def _by_equations(
    trials: Sequence[Trial],
    before: Model,
    settings: IdentifySettings,
    others: Sequence[Trial],
    seconds: float,
) -> Identification:
    """Linear in the parameters: nine of a plain vessel, all at once."""
    found = EQUATIONS[settings.method](trials, before)
    values = {name: float(v) for name, v in zip(BASE, found.value, strict=True)}
    usable = {n: min(v, 0.0) if n not in BASE[:3] else max(v, 1e-3) for n, v in values.items()}
    vessel = updated_vessel(before.vessel, usable)
    after = Model.of(vessel)
    return Identification(
        vessel, settings.method, seconds,
        tuple(
            Estimate(
                name, unit, float(before.theta[before.names.index(name)]), values[name],
                (float(found.low[i]), float(found.high[i])), bool(np.isfinite(found.std[i])),
                doubt="" if values[name] == usable[name] else "sign that no vessel can have",
            )
            for i, (name, unit) in enumerate(zip(BASE, found.units, strict=True))
        ),
        (), (), tuple(validate(t, before, after, t.name) for t in others),
        tuple(vessel for _ in trials),
    )  # fmt: skip
