"""What the studio's workers do, each in a process of its own; plain values go in and come out.

A task's first argument, `send`, takes a line of progress or a part of the result.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gateway.errors import BadInput, ShadowError
from gateway.figures import FigureData
from gateway.figures.comparison import error_correlations, error_strips, missing_force_by_regime
from gateway.figures.diagnosis import LadderBar, evidence_figure, evidence_figures, ranking
from gateway.figures.motion import (
    commands_over_time,
    free_runs_on_rows,
    horizon_velocities,
    identification_figures,
    lanes_over_time,
    measured_series,
    measured_velocities,
    residuals,
    track,
)
from gateway.figures.words import cause_text, diagnosis_texts, why_not_texts
from gateway.ingest.log import Log, choose_floating
from gateway.ingest.log_events import Happenings, happenings
from gateway.ingest.open import open_log
from gateway.offline.add import DiagnosisFile, add_from_diagnosis
from gateway.offline.compare import TrialComparison, compare_models, distinct_vessels
from gateway.offline.diagnose import DIAGNOSIS_TRIALS, DiagnosisResult, diagnose_logs
from gateway.offline.identify import identify_logs
from gateway.offline.report import report_from_log, report_of, write_report
from gateway.offline.trials import FIRST_LOOK, TrialOptions, trials_of
from gateway.offline.usable_time import DISARMED
from gateway.studio import (
    WHOLE,
    AlternativeView,
    ComparisonView,
    DiagnosisView,
    LadderView,
    RegimeView,
    Scope,
    TimeRanges,
    TrialView,
    VesselView,
)
from gateway.studio.names import recording_names, with_name
from gateway.studio.worker import Send, file_stamp
from gateway.user_effects import EffectFile, known_effects
from gateway.vessel_file import load_vessel
from sim.comparison import Bin, Regime, bin_of, regimes_of
from sim.comparison.compare import Comparison
from sim.diagnosis.answer import LadderStep, StepBase
from sim.diagnosis.evidence import evidence_on, rivals
from sim.effects.effect import Effect
from sim.model import Model
from sim.prediction.free_runs import DivergedError, Ruler, predict
from sim.state import Eta
from sim.trial import Trial
from sim.vessel import Vessel

WORST = 6  # regimes that are named
EXPLAINS = 0.95  # of the error without any effect: what lowers it by less is not worth a figure

Read = tuple[tuple[Trial, ...], Happenings]  # trials of a recording, and the modes and events in it
LONG = 50_000  # messages of a recording: more, and a rough first look comes before the whole
MOST_KEPT = 12  # recordings, of each process
ROUGH = "{}: a first look, two points a second; it is being read whole"

_last: dict[str, DiagnosisResult] = {}  # of this process, for the report
_kept: dict[tuple[str, tuple[int, ...], str | None], Read] = {}  # of this process


def trials_in(path: str, mapping: str | None = None) -> tuple[Trial, ...]:
    """The trials of a recording with usable time; read again only when the file has changed."""
    return _read(path, mapping)[0]


def _read(
    path: str, mapping: str | None, first_look: Callable[[Read], None] = lambda _: None
) -> Read:
    """The trials of a recording; of a long one `first_look` gets a rough reading before."""
    key = path, file_stamp(path), mapping
    if key not in _kept:
        log = open_log(path, mapping)
        known = happenings(log, choose_floating(log))
        if sum(log.counts().values()) > LONG:
            first_look((_usable(log, replace(FIRST_LOOK, mapping=mapping)), known))
        _kept[key] = _usable(log, TrialOptions(mapping=mapping)), known
        for old in list(_kept)[:-MOST_KEPT]:
            del _kept[old]
    return _kept[key]


def _usable(log: Log, options: TrialOptions) -> tuple[Trial, ...]:
    return tuple(trial for trial in trials_of(log, options) if trial.usable.any())


def effects_in(files: Sequence[EffectFile]) -> tuple[Effect, ...]:
    """Effects of the user's own files."""
    return tuple(effect for file in files for effect in file.load())


def vessel_of(text: str, effects: Sequence[Effect]) -> Vessel:
    """The text of a vessel file as a vessel."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "vessel.toml"
        file.write_text(text, encoding="utf-8")
        try:
            return load_vessel(file, effects)
        except BadInput as error:  # the file is this function's own: nobody finds it
            raise BadInput(str(error).replace(f"{folder}{os.sep}", "")) from None


def compare_task(
    send: Send,
    paths: Sequence[str],
    vessels: Sequence[tuple[str, str]],
    files: Sequence[EffectFile],
    mapping: str | None = None,
    scope: Scope = WHOLE,
) -> ComparisonView:
    """Every recording against (label, vessel file) each; measured motion is sent at once.

    One that cannot be read or compared leaves the others as they are.
    """
    effects = effects_in(files)
    named = [replace(vessel_of(text, effects), name=label) for label, text in vessels]

    @cache  # after the first measured motion was sent
    def models() -> tuple[Model, ...]:
        return tuple(Model.of(vessel) for vessel in distinct_vessels(named))

    out: list[TrialView] = []
    refused: dict[str, str] = {}
    for path, name in recording_names(paths).items():
        send(f"reading {Path(path).name}")
        try:
            found = _compared(send, path, name, models, mapping, scope)
        except ShadowError as error:
            refused[path] = " ".join(str(error).split())
            continue
        out += found
        if not found:
            left = f" ({scope.text})" if scope.text else ""
            refused[path] = (
                f"{Path(path).name}: no stretch that is long enough to be compared over{left}"
            )
    return ComparisonView(tuple(out), refused, tuple(vessels), scope)


def _compared(
    send: Send,
    path: str,
    name: str,
    models: Callable[[], tuple[Model, ...]],
    mapping: str | None,
    scope: Scope,
) -> list[TrialView]:
    """The trials of one recording, under the name that it has here."""
    out: list[TrialView] = []

    def first_look(rough: Read) -> None:
        for trial in (with_name(one, path, name) for one in rough[0]):
            view = measured_view(trial, path, rough[1])
            send(replace(view, rough=True, notices=(ROUGH.format(trial.name),)))

    trials, known = _read(path, mapping, first_look)
    for trial in (with_name(one, path, name) for one in trials):
        measured = measured_view(trial, path, known)
        send(measured)
        found = compare_models(scope.of(trial), models(), None, send)
        out += [trial_view(one, measured, models()) for one in found]
    return out


def measured_view(trial: Trial, path: str, known: Happenings) -> TrialView:
    """A recording before anything was compared."""
    usable = float(trial.usable.sum()) * trial.dt
    commands, lanes = commands_over_time(trial), lanes_over_time(trial, known, DISARMED)
    return TrialView(
        trial.name, path, usable, trial.time, trial.eta[:, Eta.EAST], trial.eta[:, Eta.NORTH],
        measured_velocities(trial), replace(commands, panels=commands.panels + lanes.panels), (),
        trial.notices, trial.origin_deg, measured_series(trial).motion, trial.start_time_ns,
    )  # fmt: skip


def trial_view(one: TrialComparison, measured: TrialView, models: Sequence[Model]) -> TrialView:
    """A recording with all its vessels."""
    regimes = {regime.by: regime for regime in regimes_of(one.trial, models[0])}
    vessels = tuple(_vessel_view(one.trial, c, regimes) for c in one.comparisons)
    seconds = float(one.trial.usable.sum()) * one.trial.dt
    return replace(measured, vessels=vessels, notices=one.notices, seconds=seconds)


def _vessel_view(trial: Trial, c: Comparison, regimes: dict[str, Regime]) -> VesselView:
    figures = {
        "velocities": horizon_velocities(trial, c),
        "residuals": residuals(trial, c),
        "track": track(trial, c),
        "strips": error_strips(c),
        "forces": missing_force_by_regime(c),
    }
    if c.independence is not None:
        figures["correlations"] = error_correlations(c)
    worst = tuple(
        RegimeView(b.sentence, _times_in(b, trial, regimes[b.by])) for b in c.worst(WORST)
    )
    return VesselView(
        c.vessel, dict(c.scores.rmse), c.nrmse, c.nrmse_ci95, c.standing, worst, figures,
        free_runs_on_rows(trial, c.prediction),
        np.column_stack([c.missing.force[:, :2], c.missing.std[:, :2]]),
    )  # fmt: skip


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
    send: Send,
    paths: Sequence[str],
    text: str,
    files: Sequence[EffectFile],
    mapping: str | None = None,
    scope: Scope = WHOLE,
) -> DiagnosisView:
    """Diagnose recordings: the effects that are missing, and every vessel on the way to them."""
    effects = effects_in(files)
    with TemporaryDirectory() as folder:
        given = Path(folder) / "vessel.toml"
        given.write_text(text, encoding="utf-8")
        options = replace(DIAGNOSIS_TRIALS, mapping=mapping)
        found = diagnose_logs(list(paths), given, options=options, effects=effects,
                              chosen=scope.of, progress=send)  # fmt: skip
        steps = _ladder_views(found, found.diagnosis.ladder, given, effects)
        others = _ladder_views(found, found.diagnosis.alternatives, given, effects)
    _last["diagnosis"] = found
    send("pictures")
    d, alternatives = found.diagnosis, _alternatives(found, others)
    against = [one.step.effects[-1] for one in alternatives if one.contradicted]
    tried = [one.name for one in (*known_effects(), *effects) if not one.is_curve]
    own = {added.effect.name for added in found.before.effects}
    return DiagnosisView(
        answer=found.to_dict(),
        logs=tuple(paths),
        floor=d.noise_floor,
        steps=steps,
        ranking=ranking(d) if d.ranking else None,
        evidence=evidence_figures(d, found.trials),
        looks={effect.name: effect.looks_like for effect in (*known_effects(), *effects)},
        separations=tuple(s.description for s in found.separations.values()),
        alternatives=alternatives,
        headlines=diagnosis_texts(d),
        causes={name: cause_text(step, name) for step in (d.ladder[-1], d.best)
                for name in step.effects},
        motion=_motions(found, [one.step.effects for one in alternatives if one.evidence]),
        why_not=why_not_texts(d, [name for name in tried if name not in own], against),
    )  # fmt: skip


def _motions(
    found: DiagnosisResult, shown: Sequence[tuple[str, ...]]
) -> dict[tuple[str, ...], FigureData]:
    """Velocities of the first recording as measured, without and with what each step adds."""
    d, trial = found.diagnosis, found.trials[0]
    ruler = Ruler.of(trial, Model.of(found.before))
    out = {}
    for step in (*d.ladder[2:], *(s for s in d.alternatives if s.effects in shown)):
        lower = [s for s in d.ladder[1:] if s.effects == step.effects[: len(s.effects)]]
        before = max((s for s in lower if s is not step), key=lambda s: len(s.effects))
        try:
            was, now = (predict(trial, Model.of(s.vessel), ruler) for s in (before, step))
        except DivergedError:  # no run of it lasts a step: there is no motion to show
            continue
        figures = identification_figures(trial, was, now, ruler.longest_run(trial.dt))
        out[step.effects] = figures["velocities"]
    return out


def fit_task(
    send: Send,
    paths: Sequence[str],
    text: str,
    files: Sequence[EffectFile],
    mapping: str | None = None,
    scope: Scope = WHOLE,
) -> str:
    """The nine base numbers fitted to recordings -> the text of the vessel file with them."""
    with TemporaryDirectory() as folder:
        given, out = Path(folder) / "vessel.toml", Path(folder) / "fitted.toml"
        given.write_text(text, encoding="utf-8")
        try:
            identify_logs(list(paths), given, out, options=TrialOptions(mapping=mapping),
                          effects=effects_in(files), chosen=scope.of, progress=send)  # fmt: skip
        except BadInput as error:  # the file is this function's own: nobody finds it
            raise BadInput(str(error).replace(f"{folder}{os.sep}", "")) from None
        return out.read_text(encoding="utf-8")


def _ladder_views(
    found: DiagnosisResult, steps: Sequence[LadderStep], given: Path, effects: Sequence[Effect]
) -> tuple[LadderView, ...]:
    """Each step with its vessel file, which holds the provenance of its numbers."""
    diagnosis = DiagnosisFile.model_validate(found.to_dict())
    out = []
    for step in steps:
        file = given
        if step.base is StepBase.REFITTED:
            file = given.with_name("step.toml")
            add_from_diagnosis(step.effects, given, diagnosis, "the diagnosis", file, effects)
        text = file.read_text(encoding="utf-8")
        says = cause_text(step, step.effects[-1]) if step.effects else ""
        out.append(LadderView(step.effects, LadderBar.of(step), text, says))
    return tuple(out)


def _alternatives(
    found: DiagnosisResult, views: Sequence[LadderView]
) -> tuple[AlternativeView, ...]:
    """Effects not chosen; with evidence where they are rivals, or explain something at least."""
    d = found.diagnosis
    tied = rivals(d)
    least = EXPLAINS * d.ladder[1].heldout.nrmse
    out = []
    for step, view in zip(d.alternatives, views, strict=True):
        effect, rival = step.effects[-1], any(step is t for t in tied)
        proof = evidence_on(step, effect, found.trials)
        against = proof is not None and proof.contradicts
        told = {*d.effects, *d.best.effects}  # its evidence stands with what was found
        shown = rival or (step.heldout.nrmse < least and effect not in told)
        figure = evidence_figure(proof) if proof and shown and not against else None
        out.append(AlternativeView(view, rival, against, figure))
    return tuple(out)


def report_task(
    send: Send,
    paths: Sequence[str],
    vessels: Sequence[tuple[str, str]],
    files: Sequence[EffectFile],
    out: str,
    diagnosed: bool,
    mapping: str | None = None,
) -> str:
    """Write the report of what is on the page; `diagnosed`: with this process's last diagnosis."""
    if diagnosed and "diagnosis" not in _last:
        raise BadInput("the answer went with a job that was cancelled: diagnose again first")
    effects = effects_in(files)
    read = [(label, vessel_of(text, effects)) for label, text in vessels]
    chosen = [replace(vessel, name=f"{vessel.name}, {label}") for label, vessel in read]
    models = [Model.of(vessel) for vessel in chosen]
    found = [one for path, name in recording_names(paths).items()
             for read in trials_in(path, mapping) for trial in [with_name(read, path, name)]
             for one in compare_models(trial, models, None, send)]  # fmt: skip
    send("pictures")
    page = report_of(found, chosen, _last["diagnosis"] if diagnosed else None, read[0][1].name)
    return str(write_report(page, out).path)


def log_report_task(
    send: Send, path: str, out: str, files: Sequence[EffectFile], mapping: str | None = None
) -> str:
    """Learn a vessel from a recording alone, and write the report on it."""
    options, effects = TrialOptions(mapping=mapping), effects_in(files)
    report = report_from_log([path], out, {}, options=options, effects=effects, progress=send)
    return str(report.path)
