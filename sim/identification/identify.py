"""Parameters of a vessel from trials: start, fit, intervals, validation.

Validation: a vessel before and after a fit, on time that the fit did not see, with the same ruler.
A channel is confirmed on a recording where a free run of the model beats the prediction "zero":

    RMSE(measured − model) < 0.9 · RMS(measured)

A parameter may fit the data that it came from and be wrong on another day. A channel that no
validation recording confirms is called not identifiable from these data, whatever its intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.excitation.responses import StepResponses, step_responses
from sim.identification import BASE, MASSES, IdentifySettings, updated_vessel
from sim.identification.estimators import (
    cross_check_by_instruments,
    fit_by_instruments,
    fit_by_output_error,
)
from sim.identification.intervals import (
    NUISANCE,
    Estimate,
    estimates_of,
    not_identifiable,
    trade_offs,
    uncertainty_of,
    undetermined,
)
from sim.identification.light_inertia import too_light
from sim.identification.parameters import OFFSETS, Unknowns, unknowns_of
from sim.identification.regression import fit_by_regression
from sim.identification.shooting import FitInputs, FitResult, fit_by_shooting
from sim.model import Model
from sim.prediction import measured_motion
from sim.prediction.free_runs import (
    MIN_SCALES,
    FreeRun,
    Ruler,
    Scores,
    free_run,
    nrmse,
    predict,
    scores,
    shown_floor,
)
from sim.prediction.segments import GUARD_S, NoUsableTimeError, require_finite, time_blocks
from sim.state import Floats, Progress
from sim.trial import Trial, data_frame
from sim.vessel import Vessel, with_free_curves

# Chosen, not measured:
HELD_OUT_EVERY = 4  # each fourth block is held out
MIN_BLOCKS = 4
CONFIRMED_SHARE = 0.9  # of the error of predicting zero
WORSE, WORSE_SHARE = 1.25, 0.1  # times what a channel's error was, and of its smallest scale beside
AT_REST_SHARE = 0.5  # of the smallest scale: a channel that moves less confirms nothing
CHANNELS = {
    "u": ("surge", "m/s", 3, "m11, X_u and X_uu"),
    "v": ("sway", "m/s", 4, "m22, Y_v and Y_vv"),
    "r": ("yaw rate", "rad/s", 5, "m33, N_r and N_rr"),
}  # name, unit, column of (eta, nu), and the channel's own parameters


@dataclass(frozen=True)
class ModelErrors:
    """One vessel on one trial: errors of predictions over the horizon, and of one free run."""

    scores: Scores
    nrmse: float
    free_run: FreeRun | None

    def to_dict(self) -> dict[str, Any]:
        """Scores by channel."""
        out: dict[str, Any] = {"nrmse": self.nrmse, **self.scores.to_dict()}
        return out if self.free_run is None else out | {"free_run": self.free_run.to_dict()}


@dataclass(frozen=True)
class Validation:
    """Before and after, and what it was measured on."""

    name: str
    seconds: float
    noise_floor_nrmse: float
    before: ModelErrors
    after: ModelErrors

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "on": self.name, "seconds": self.seconds, "noise_floor_nrmse": self.noise_floor_nrmse,
            "before": self.before.to_dict(), "after": self.after.to_dict(),
        }  # fmt: skip


def unseen_losses(validation: Sequence[Validation]) -> tuple[str, ...]:
    """A sentence for each recording on which the fit predicts no better than the vessel before,
    and for each channel that it predicts clearly worse.
    """
    out = []
    for v in validation:
        old, new = v.before.scores.rmse, v.after.scores.rmse
        if not v.after.nrmse < v.before.nrmse:  # of a diverged one it is no number
            out.append(
                f"on time that the fit did not see ({v.name}) the vessel is no better than before: "
                f"nrmse {v.after.nrmse:.3f}, before {v.before.nrmse:.3f}; keep the file that you "
                "had, or fit to more recordings"
            )
        for channel, (name, unit, column, _) in CHANNELS.items():
            rise = new[channel] - old[channel]
            least = WORSE_SHARE * MIN_SCALES[column - 3]
            if new[channel] > WORSE * old[channel] and rise > least:
                out.append(
                    f"{name} is predicted worse on time that the fit did not see ({v.name}): "
                    f"off by {new[channel]:.3f} {unit}, before {old[channel]:.3f}"
                )
    return tuple(out)


def held_out(trial: Trial) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Rows to fit and rows to validate on, a guard between; None on a trial too short."""
    blocks = time_blocks(trial.usable, trial.dt)
    if len(blocks) < MIN_BLOCKS:
        return None
    fit, validation = trial.usable.copy(), np.zeros(len(trial), np.bool_)
    gap = int(np.ceil(GUARD_S / trial.dt))
    for block in blocks[HELD_OUT_EVERY // 2 :: HELD_OUT_EVERY]:
        validation[block.start : block.stop] = trial.usable[block.start : block.stop]
        fit[max(block.start - gap, 0) : block.stop + gap] = False
    return fit, validation


def validate(
    trial: Trial,
    before: Model,
    after: Model,
    command_offset: float,
    rows: NDArray[np.bool_] | None = None,
) -> Validation:
    """Both models on the usable rows, or on the held-out `rows` of them, then without a free run.

    By how much `command_offset` [s] commands act later than recorded is a property of the
    recording, and no merit of either model: both are given it.
    """
    name = trial.name if rows is None else f"{trial.name}, blocks held out"
    trial = trial if rows is None else replace(trial, usable=trial.usable & rows)
    ruler = Ruler.of(trial, before)
    errors = []
    for model in (before, after):
        _, at, error = predict(trial, model, ruler, command_offset).predicted_rows()
        free = free_run(trial, model, ruler.scales, command_offset) if rows is None else None
        measured = measured_motion(trial)[at, :6]
        errors.append(ModelErrors(scores(measured, error), nrmse(error, ruler.scales), free))
    floor = shown_floor(ruler.noise_floor, [one.nrmse for one in errors])
    return Validation(name, float(trial.usable.sum()) * trial.dt, floor, *errors)


def free_run_errors(run: FreeRun, channel: str) -> tuple[float, float]:
    """RMSE of a free run on a channel, and that of predicting zero."""
    error = run.error[:, CHANNELS[channel][2]]
    measured = run.model[:, CHANNELS[channel][2]] + error
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(measured**2)))


def is_confirmed(run: FreeRun, channel: str) -> bool | None:
    """Better than zero by a tenth; None: it hardly moved."""
    if run.diverged:
        return False
    model, zero = free_run_errors(run, channel)
    at_rest = zero < AT_REST_SHARE * MIN_SCALES[CHANNELS[channel][2] - 3]
    return None if at_rest else model < CONFIRMED_SHARE * zero


def unconfirmed_channels(validation: Sequence[Validation]) -> tuple[str, ...]:
    """A sentence for each channel that no recording confirms; none without a free run."""
    runs = [v.after.free_run for v in validation if v.after.free_run is not None]
    out = []
    for channel, (name, unit, _, parameters) in CHANNELS.items():
        confirmed = [(run, is_confirmed(run, channel)) for run in runs]
        moved = [run for run, sure in confirmed if sure is not None]
        if moved and not any(sure for _, sure in confirmed):
            pairs = [free_run_errors(run, channel) for run in moved if not run.diverged]
            figures = ", ".join(f"{model:.3f} against {zero:.3f} {unit}" for model, zero in pairs)
            out.append(
                f"{name} is not identifiable from these data: on recordings that the fit did not "
                "see the model is no better than predicting zero "
                f"({figures or 'its free runs leave the track'}): "
                f"{parameters} mean nothing beyond the runs fitted"
            )
    return tuple(out)


MIN_USABLE_S = 20.0  # chosen, not measured
MIN_INERTIA = 1e-3  # kg, kg m²: of a vessel made of what equations gave
PLAIN = IdentifySettings(offsets=False)  # the nine parameters of equations
EQUATIONS = {"regression": fit_by_regression, "instrumental": fit_by_instruments}
FITS = {"shooting": fit_by_shooting, "simulation": fit_by_output_error}


@dataclass(frozen=True)
class Identification:
    """The vessel with its fitted parameters, their intervals, and its errors on unseen time.

    vessel       with the parameters of the first recording where each has its own
    trade        parameters that trade against each other, a sentence for each such direction
    vessels      the vessel as on each recording
    cross_check  where instrumental variables disagree
    notices      what looks wrong with recordings and channels
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
    notices: tuple[str, ...] = ()

    @property
    def command_offset(self) -> float:
        """How much later than recorded commands act [s]; 0 where that was not estimated."""
        return next((e.value for e in self.nuisances if e.name == OFFSETS[0]), 0.0)

    @cached_property
    def step_responses(self) -> StepResponses:
        """Responses of the vessel to a step of throttle and of the helm."""
        return step_responses(Model.of(self.vessel))

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Channels that no validation recording confirms, a sentence each."""
        return unconfirmed_channels(self.validation)

    @property
    def unseen_losses(self) -> tuple[str, ...]:
        """Where the fit predicts unseen time no better than the vessel before, a sentence each."""
        return unseen_losses(self.validation)

    @property
    def too_light(self) -> tuple[str, ...]:
        """That fitted inertia is far less than the hull's own; empty where it is not."""
        return too_light(self.estimates, self.vessel)

    def to_pandas(self) -> Any:
        """One row per parameter: before, value, interval, whether the data determine it."""
        return data_frame([
            {"name": e.name, "recording": e.trial, "unit": e.unit, "before": e.before,
             "value": e.value, "low": e.ci95[0], "high": e.ci95[1],
             "identifiable": e.identifiable, "doubt": e.doubt}
            for e in (*self.estimates, *self.nuisances)
        ])  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """The JSON object that `shadow identify --json` prints."""
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
            "not_identifiable": list(self.unconfirmed), "worse": list(self.unseen_losses),
            "too_light": list(self.too_light),
            "step_responses": self.step_responses.to_dict(),
        }  # fmt: skip


def identify(
    trials: Sequence[Trial],
    vessel: Vessel,
    settings: IdentifySettings | None = None,
    others: Sequence[Trial] = (),
    progress: Progress = lambda _: None,
) -> Identification:
    """Fit on the trials, validate on `others`, or else on blocks that another fit did not see.

    NoUsableTimeError where there is too little usable time; a parameter that the data do not
    determine stays as it was and is not `identifiable`.
    """
    settings = settings or IdentifySettings()
    for trial in (*trials, *others):
        require_finite(trial)
    seconds = sum(float(t.usable.sum()) * t.dt for t in trials)
    if seconds < MIN_USABLE_S:
        raise NoUsableTimeError(f"{seconds:.0f} s of usable time: {MIN_USABLE_S:.0f} s are needed")
    before = Model.of(with_free_curves(vessel, settings.free))
    if settings.method in EQUATIONS:
        return _by_equations(trials, before, settings, others, seconds)
    settings = settings.with_motion_of(trials)
    unknowns = unknowns_of(before, len(trials), settings)
    inputs, search = FitInputs(unknowns, trials, settings), FITS[settings.method]
    fit = search(inputs, None, progress)
    uncertainty = uncertainty_of(unknowns, fit, settings.block)
    vague = undetermined(unknowns, fit.z, uncertainty)
    last = replace(settings, horizons=settings.horizons[-1:])
    fixed = FitInputs(unknowns.fixed(vague), trials, last)
    if (vague & ~unknowns.at_rest).any() and not vague.all():
        fit = search(fixed, np.where(vague, unknowns.start, fit.z))
    every = estimates_of(unknowns, fit.z, uncertainty, [t.name for t in trials], last.filtered)
    models = [fitted_model(unknowns, fit.z, i) for i in range(len(trials))]
    offset = _command_offset(unknowns, fit.z)
    validation = [validate(t, before, models[0], offset) for t in others]
    if not others:
        progress("validation")
        validation = _on_held_out(fixed, fit, before)
    estimates = tuple(e for e in every if e.name not in NUISANCE)
    return Identification(
        models[0].vessel, settings.method, seconds, estimates,
        tuple(e for e in every if e.name in NUISANCE),
        trade_offs(unknowns, fit.z, uncertainty), tuple(validation),
        tuple(model.vessel for model in models),
        cross_check_by_instruments(trials, models[0], estimates),
    )  # fmt: skip


def fitted_model(unknowns: Unknowns, z: Floats, trial: int = 0) -> Model:
    """The model with the parameters z (n,); those of one voyage as on that trial."""
    theta = unknowns.theta(z[None], trial)[0]
    model = unknowns.model
    values = dict(zip(model.names, theta.tolist(), strict=True))
    changed = {u.name: values[u.name] for u in unknowns.each if u.name in values}
    return replace(model, vessel=updated_vessel(model.vessel, changed), theta=theta)


def _on_held_out(inputs: FitInputs, fit: FitResult, before: Model) -> list[Validation]:
    """Another fit without each fourth block, validated on those blocks."""
    cuts = [held_out(trial) for trial in inputs.trials]
    if not any(cuts):
        return []
    pairs = list(zip(inputs.trials, cuts, strict=True))
    usable = [t.usable if cut is None else cut[0] for t, cut in pairs]
    again = FITS[inputs.settings.method](inputs._replace(usable=usable), fit.z)
    offset = _command_offset(inputs.unknowns, again.z)
    return [
        validate(trial, before, fitted_model(inputs.unknowns, again.z, i), offset, cut[1])
        for i, (trial, cut) in enumerate(pairs)
        if cut is not None
    ]


def _command_offset(unknowns: Unknowns, z: Floats) -> float:
    """How much later than recorded commands act [s]: so they do on other recordings too."""
    return float(unknowns.offset(z[None], OFFSETS[0])[0])


def _by_equations(
    trials: Sequence[Trial],
    before: Model,
    settings: IdentifySettings,
    others: Sequence[Trial],
    seconds: float,
) -> Identification:
    """Linear in the parameters: nine of a plain vessel, all at once.

    The interval of one that is not determined holds all that a vessel can have.
    """
    fit = EQUATIONS[settings.method](trials, before)
    values = {name: float(v) for name, v in zip(BASE, fit.value, strict=True)}
    usable = {n: max(v, MIN_INERTIA) if n in MASSES else min(v, 0.0) for n, v in values.items()}
    vessel = updated_vessel(before.vessel, usable)
    after = Model.of(vessel)
    estimates = []
    for u in sorted(unknowns_of(before, 1, PLAIN).each, key=lambda u: BASE.index(u.name)):
        i, value = BASE.index(u.name), values[u.name]
        determined = bool(np.isfinite(fit.std[i]))
        interval = (float(fit.low[i]), float(fit.high[i])) if determined else (u.lower, u.upper)
        doubt = "" if determined else not_identifiable(u.name)
        if value != usable[u.name]:
            doubt = "sign that no vessel can have"
        start = float(before.theta[before.names.index(u.name)])
        estimates.append(Estimate(u.name, u.unit, start, value, interval, determined, doubt=doubt))
    return Identification(
        vessel, settings.method, seconds, tuple(estimates), (), (),
        tuple(validate(t, before, after, 0.0) for t in others), tuple(vessel for _ in trials),
    )  # fmt: skip
