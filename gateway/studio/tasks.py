"""What the pages show, as plain values that cross from one process into another.

What the studio's workers do, each in a process of its own; plain values go in and come out.

A task's first argument, `send`, takes a line of progress or a part of the result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures.comparison import error_strips, missing_force_by_regime
from gateway.figures.diagnosis import LadderBar, evidence_figure, ranking
from gateway.figures.figure_data import FigureData
from gateway.figures.motion import horizon_velocities, measured_velocities, residuals, track
from gateway.ingest.open import open_log
from gateway.ingest.survey import Survey, survey
from gateway.offline.add import DiagnosisFile, add_from_diagnosis
from gateway.offline.compare import TrialComparison, compare_models, distinct_vessels
from gateway.offline.diagnose import DiagnosisResult, diagnose_logs
from gateway.offline.report import report_of, write_report
from gateway.offline.trials import load_trials
from gateway.studio.worker import Send
from gateway.user_effects import known_effects, load_effects
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison
from sim.comparison.regimes import Regime, regimes_of
from sim.comparison.where import Bin, bin_of
from sim.diagnosis.answer import LadderStep
from sim.diagnosis.evidence import evidence_of, evidence_on, rivals
from sim.effects.effect import Effect
from sim.model import Model
from sim.state import Eta, Floats
from sim.trial import Trial
from sim.vessel import Vessel

TimeRanges = tuple[tuple[float, float], ...]  # from, to [s]


@dataclass(frozen=True)
class RegimeView:
    """A regime in words, and the stretches of time that belong to it."""

    text: str
    times: TimeRanges


@dataclass(frozen=True)
class VesselView:
    """One vessel on one recording."""

    name: str
    rmse: Mapping[str, float]
    nrmse: float
    ci95: tuple[float, float] | None
    floor: float
    worst: tuple[RegimeView, ...]
    figures: Mapping[str, FigureData]


@dataclass(frozen=True)
class TrialView:
    """One stretch of a recording; without vessels while it is still being compared."""

    name: str
    log: str
    seconds: float
    time: Floats  # (T,)
    east: Floats  # (T,)
    north: Floats  # (T,)
    measured: FigureData
    vessels: tuple[VesselView, ...] = ()
    notices: tuple[str, ...] = ()
    origin_deg: tuple[float, float] | None = None


@dataclass(frozen=True)
class LadderView:
    """One step that can be taken: the effects, the error then, and the vessel file's text then."""

    effects: tuple[str, ...]
    bar: LadderBar
    text: str


@dataclass(frozen=True)
class AlternativeView:
    """What was ranked but not chosen: its step, and its evidence where that is worth a look.

    rival   these data cannot tell it from what was chosen
    """

    step: LadderView
    rival: bool
    evidence: FigureData | None = None


@dataclass(frozen=True)
class DiagnosisView:
    """A diagnosis: what `shadow diagnose --json` prints, its steps, its figures.

    looks   effect -> what it looks like
    before  effects that the vessel had when it was diagnosed
    """

    answer: Mapping[str, Any]
    logs: tuple[str, ...]
    floor: float
    steps: tuple[LadderView, ...]
    ranking: FigureData | None
    evidence: Mapping[str, FigureData]
    looks: Mapping[str, str] = field(default_factory=dict)
    separations: tuple[str, ...] = ()
    before: tuple[str, ...] = ()
    alternatives: tuple[AlternativeView, ...] = ()

    def up_to(self, step: LadderView) -> tuple[LadderView, ...]:
        """The steps on the way to one, and itself."""
        if step in self.steps:
            return self.steps[: self.steps.index(step) + 1]
        n = len(step.effects)
        below = (s for s in self.steps if s.effects == step.effects[: len(s.effects)])
        return (*(s for s in below if len(s.effects) < n), step)

    def added_since(self, effects: tuple[str, ...]) -> tuple[str, ...] | None:
        """Which of a vessel's effects were added since; None where it is another vessel."""
        n = len(self.before)
        return effects[n:] if effects[:n] == self.before else None

    def next_steps(self, effects: tuple[str, ...]) -> list[LadderView]:
        """What can be added to these effects, what was chosen first."""
        every = (*self.steps, *(alternative.step for alternative in self.alternatives))
        return [step for step in every if step.effects and step.effects[:-1] == effects]


WORST = 6  # regimes that are named
EXPLAINS = 0.95  # of the error without any effect: what lowers it by less is not worth a figure

_last: dict[str, DiagnosisResult] = {}  # of this process, for the report


def trials_in(path: str) -> tuple[Trial, ...]:
    """The trials of a recording with usable time; read again only when the file has changed."""
    return _trials(path, Path(path).stat().st_mtime_ns)


@lru_cache(maxsize=12)
def _trials(path: str, stamp: int) -> tuple[Trial, ...]:
    return tuple(trial for trial in load_trials(path) if trial.usable.any())


def effects_in(files: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of the user's own files."""
    return tuple(effect for file in files for effect in load_effects(file))


def vessel_of(text: str, effects: Sequence[Effect]) -> Vessel:
    """The text of a vessel file as a vessel."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "vessel.toml"
        file.write_text(text, encoding="utf-8")
        return load_vessel(file, effects)


def survey_task(send: Send, path: str) -> Survey:
    """What is in a recording."""
    return survey(open_log(path))


def compare_task(
    send: Send, paths: Sequence[str], vessels: Sequence[tuple[str, str]], files: Sequence[str]
) -> tuple[TrialView, ...]:
    """Every recording against (label, vessel file) each; measured motion is sent at once."""
    effects = effects_in(files)
    named = [replace(vessel_of(text, effects), name=label) for label, text in vessels]
    models: list[Model] = []
    out: list[TrialView] = []
    for path in paths:
        send(f"reading {Path(path).name}")
        for trial in trials_in(path):
            send(measured_view(trial, path))
            models = models or [Model.of(vessel) for vessel in distinct_vessels(named)]
            found = compare_models(trial, models, None, send)
            out += [trial_view(one, path, models) for one in found]
    return tuple(out)


def measured_view(trial: Trial, path: str) -> TrialView:
    """A recording before anything was compared."""
    usable = float(trial.usable.sum()) * trial.dt
    return TrialView(
        trial.name, path, usable, trial.time, trial.eta[:, Eta.EAST], trial.eta[:, Eta.NORTH],
        measured_velocities(trial), (), trial.notices, trial.origin_deg,
    )  # fmt: skip


def trial_view(one: TrialComparison, path: str, models: Sequence[Model]) -> TrialView:
    """A recording with all its vessels."""
    regimes = {regime.by: regime for regime in regimes_of(one.trial, models[0])}
    vessels = tuple(_vessel_view(one.trial, c, regimes) for c in one.comparisons)
    notices = tuple(dict.fromkeys(n for c in one.comparisons for n in c.notices))
    return replace(measured_view(one.trial, path), vessels=vessels, notices=notices)


def _vessel_view(trial: Trial, c: Comparison, regimes: dict[str, Regime]) -> VesselView:
    figures = {
        "velocities": horizon_velocities(trial, c),
        "residuals": residuals(trial, c),
        "track": track(trial, c),
        "strips": error_strips(c),
        "forces": missing_force_by_regime(c),
    }
    worst = tuple(
        RegimeView(b.sentence, _times_in(b, trial, regimes[b.by])) for b in c.worst(WORST)
    )
    return VesselView(
        c.vessel, dict(c.scores.rmse), c.nrmse, c.nrmse_ci95, c.noise_floor_nrmse, worst, figures
    )


def _times_in(one: Bin, trial: Trial, regime: Regime) -> TimeRanges:
    """Which stretches of a trial [s] lie in a bin, in order."""
    k = int(np.argmin(np.abs(regime.edges[:-1] - one.start)))
    inside = (bin_of(regime.value, regime.edges) == k) & trial.usable
    steps = np.diff(np.concatenate([[0], inside.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return tuple(
        (float(trial.time[a]), float(trial.time[b - 1]) + trial.dt)
        for a, b in zip(starts, ends, strict=True)
    )


def diagnose_task(
    send: Send, paths: Sequence[str], text: str, files: Sequence[str]
) -> DiagnosisView:
    """What is missing, and every vessel on the way to it."""
    effects = effects_in(files)
    with TemporaryDirectory() as folder:
        given = Path(folder) / "vessel.toml"
        given.write_text(text, encoding="utf-8")
        found = diagnose_logs(list(paths), given, effects=effects, progress=send)
        steps = _ladder_views(found, found.diagnosis.ladder, given, effects)
        others = _ladder_views(found, found.diagnosis.alternatives, given, effects)
    _last["diagnosis"] = found
    send("pictures")
    d = found.diagnosis
    return DiagnosisView(
        answer=found.to_dict(),
        logs=tuple(paths),
        floor=d.noise_floor,
        steps=steps,
        ranking=ranking(d) if d.ranking else None,
        evidence={one.effect: evidence_figure(one) for one in evidence_of(d, found.trials)},
        looks={effect.name: effect.looks_like for effect in (*known_effects(), *effects)},
        separations=tuple(s.description for s in found.separations.values()),
        alternatives=_alternatives(found, others),
    )


def _ladder_views(
    found: DiagnosisResult, steps: Sequence[LadderStep], given: Path, effects: Sequence[Effect]
) -> tuple[LadderView, ...]:
    """Each step with its vessel file, which holds the provenance of its numbers."""
    diagnosis = DiagnosisFile.model_validate(found.to_dict())
    out = []
    for step in steps:
        file = given
        if step.base != "plain":
            file = given.with_name("step.toml")
            add_from_diagnosis(step.effects, given, diagnosis, "the diagnosis", file, effects)
        text = file.read_text(encoding="utf-8")
        out.append(LadderView(step.effects, LadderBar.of(step), text))
    return tuple(out)


def _alternatives(
    found: DiagnosisResult, views: Sequence[LadderView]
) -> tuple[AlternativeView, ...]:
    """What was not chosen; with evidence where it is a rival, or explains something at least."""
    d = found.diagnosis
    tied = rivals(d)
    least = EXPLAINS * d.ladder[1].heldout.nrmse
    out = []
    for step, view in zip(d.alternatives, views, strict=True):
        effect, rival = step.effects[-1], any(step is t for t in tied)
        proof = None
        if rival or (step.heldout.nrmse < least and effect not in d.effects):
            proof = evidence_on(step, effect, found.trials)
        out.append(AlternativeView(view, rival, evidence_figure(proof) if proof else None))
    return tuple(out)


def report_task(
    send: Send, paths: Sequence[str], vessels: Sequence[tuple[str, str]], files: Sequence[str],
    out: str, diagnosed: bool,
) -> str:  # fmt: skip
    """Write the report of what is on the page; `diagnosed`: with this process's last diagnosis."""
    if diagnosed and "diagnosis" not in _last:
        raise BadInput("the answer went with a job that was cancelled: diagnose again first")
    effects = effects_in(files)
    read = [(label, vessel_of(text, effects)) for label, text in vessels]
    chosen = [replace(vessel, name=f"{vessel.name}, {label}") for label, vessel in read]
    models = [Model.of(vessel) for vessel in chosen]
    found = [one for path in paths for trial in trials_in(path)
             for one in compare_models(trial, models, None, send)]  # fmt: skip
    send("pictures")
    page = report_of(found, chosen, _last["diagnosis"] if diagnosed else None, read[0][1].name)
    return str(write_report(page, out).path)
