"""What the studio's workers do, each in a process of its own; plain values go in and come out."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures.comparison import error_strips, missing_force_by_regime
from gateway.figures.diagnosis import (
    LadderBar,
    evidence_figure,
    evidence_of,
    evidence_on,
    ranking,
    rivals,
)
from gateway.figures.motion import horizon_velocities, measured_velocities, residuals, track
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from gateway.offline.add import DiagnosisFile, added
from gateway.offline.compare import Compared, compared_trial, told_apart
from gateway.offline.diagnose import Diagnosed, diagnosed
from gateway.offline.report import report_of, write_report
from gateway.offline.trials import load_trials
from gateway.studio.views import Found, LadderView, Other, Row, TrialView, VesselView, Worst
from gateway.user_effects import known_effects, load_effects
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison
from sim.comparison.regimes import regimes_of
from sim.comparison.where import Bin, bin_of
from sim.diagnosis.answer import LadderStep
from sim.effects.effect import Effect
from sim.model import Model
from sim.state import Eta
from sim.trial import Trial
from sim.vessel import Vessel

Tell = Callable[[Any], None]  # a line of text, or a part of the result
WORST = 6
EXPLAINS = 0.95  # of the error without any effect: what lowers it by less is not worth a picture

_last: dict[str, Diagnosed] = {}  # of this process: the report tells it


def trials_in(path: str) -> tuple[Trial, ...]:
    """The trials of a recording; read again only when the file has changed."""
    return _trials(path, Path(path).stat().st_mtime_ns)


@lru_cache(maxsize=12)
def _trials(path: str, stamp: int) -> tuple[Trial, ...]:
    return tuple(load_trials(path))


def effects_in(files: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of the user's own files."""
    return tuple(effect for file in files for effect in load_effects(file))


def vessel_of(text: str, own: Sequence[Effect]) -> Vessel:
    """The text of a vessel file as a vessel."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "vessel.toml"
        file.write_text(text, encoding="utf-8")
        return load_vessel(file, own)


def look(tell: Tell, path: str) -> Row:
    """What is in a recording."""
    found = survey(open_log(path))
    rates = sorted(((n, m.rate_hz) for n, m in found.messages.items()), key=lambda r: -r[1])
    return Row(
        path, found.kind, found.statistics.size_bytes / 1e6, found.seconds,
        tuple(f"{b.boat} {b.firmware}".strip() for b in found.boats),
        tuple(says for b in found.boats for says in b.good_for),
        tuple(n for b in found.boats for n in b.notices), tuple(rates[:8]),
    )  # fmt: skip


def compare(
    tell: Tell, paths: Sequence[str], vessels: Sequence[tuple[str, str]], files: Sequence[str]
) -> tuple[TrialView, ...]:
    """Every recording against (label, vessel file) each; measured motion is told at once."""
    own = effects_in(files)
    named = [_named(vessel_of(text, own), label) for label, text in vessels]
    models: list[Model] = []
    out: list[TrialView] = []
    for path in paths:
        tell(f"reading {Path(path).name}")
        for trial in trials_in(path):
            if not trial.usable.any():
                continue
            tell(bare(trial, path))
            models = models or [Model.of(vessel) for vessel in told_apart(named)]
            found = compared_trial(trial, models, None, tell)
            out += [trial_view(one, path, models) for one in found]
    return tuple(out)


def _named(vessel: Vessel, label: str) -> Vessel:
    return replace(vessel, name=label)


def bare(trial: Trial, path: str) -> TrialView:
    """A recording before anything was compared."""
    usable = float(trial.usable.sum()) * trial.dt
    return TrialView(
        trial.name, path, usable, trial.time, trial.eta[:, Eta.EAST], trial.eta[:, Eta.NORTH],
        measured_velocities(trial), (), trial.notices,
        trial.origin_deg,
    )  # fmt: skip


def trial_view(one: Compared, path: str, models: Sequence[Model]) -> TrialView:
    """A recording with all its vessels."""
    spans = _Spans(one.trial, models[0])
    vessels = tuple(_vessel_view(one.trial, c, spans) for c in one.comparisons)
    notices = tuple(dict.fromkeys(n for c in one.comparisons for n in c.notices))
    return replace(bare(one.trial, path), vessels=vessels, notices=notices)


def _vessel_view(trial: Trial, c: Comparison, spans: "_Spans") -> VesselView:
    pictures = {
        "velocities": horizon_velocities(trial, c),
        "residuals": residuals(trial, c),
        "track": track(trial, c),
        "strips": error_strips(c),
        "forces": missing_force_by_regime(c),
    }
    worst = tuple(Worst(b.sentence, spans.of(b)) for b in c.worst(WORST))
    return VesselView(
        c.vessel, dict(c.scores.rmse), c.nrmse, c.nrmse_ci95, c.noise_floor_nrmse, worst, pictures
    )


class _Spans:
    """Which stretches of a trial lie in a bin."""

    def __init__(self, trial: Trial, model: Model) -> None:
        self._trial = trial
        self._regimes = {regime.by: regime for regime in regimes_of(trial, model)}

    def of(self, one: Bin) -> tuple[tuple[float, float], ...]:
        """From when to when [s], in order."""
        regime = self._regimes[one.by]
        k = int(np.argmin(np.abs(regime.edges[:-1] - one.start)))
        inside = (bin_of(regime.value, regime.edges) == k) & self._trial.usable
        steps = np.diff(np.concatenate([[0], inside.astype(np.int8), [0]]))
        time, dt = self._trial.time, self._trial.dt
        starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
        return tuple(
            (float(time[a]), float(time[b - 1]) + dt) for a, b in zip(starts, ends, strict=True)
        )


def diagnose(tell: Tell, paths: Sequence[str], text: str, files: Sequence[str]) -> Found:
    """What is missing, and every vessel on the way to it."""
    own = effects_in(files)
    with TemporaryDirectory() as folder:
        given = Path(folder) / "vessel.toml"
        given.write_text(text, encoding="utf-8")
        found = diagnosed(list(paths), given, effects=own, tell=tell)
        rungs = _rungs(found, found.diagnosis.ladder, given, own)
        others = _rungs(found, found.diagnosis.alternatives, given, own)
    _last["diagnosis"] = found
    tell("pictures")
    d = found.diagnosis
    proofs = evidence_of(d, found.trials)
    return Found(
        answer=found.to_dict(), logs=tuple(paths), floor=d.floor, rungs=rungs,
        ranking=ranking(d) if d.ranking else None,
        evidence={one.effect: evidence_figure(one) for one in proofs},
        looks=_looks(own), separates=tuple(s.says for s in found.separations.values()),
        others=_others(found, others),
    )  # fmt: skip


def _rungs(
    found: Diagnosed, rungs: Sequence[LadderStep], given: Path, own: Sequence[Effect]
) -> tuple[LadderView, ...]:
    """Each rung as a vessel file with the provenance of its numbers."""
    told = DiagnosisFile.model_validate(found.to_dict())
    out = []
    for rung in rungs:
        file = given.with_name("rung.toml")
        if rung.base == "plain":
            text = given.read_text(encoding="utf-8")
        else:
            added(rung.effects, given, told, "the diagnosis", file, own)
            text = file.read_text(encoding="utf-8")
        out.append(LadderView(rung.effects, LadderBar.of(rung), text))
    return tuple(out)


def _others(found: Diagnosed, rungs: Sequence[LadderView]) -> tuple[Other, ...]:
    """What was not chosen; with a picture where it is a rival, or explains something at least."""
    d = found.diagnosis
    tied = rivals(d)
    least = EXPLAINS * d.ladder[1].heldout.nrmse
    out = []
    for one, rung in zip(d.alternatives, rungs, strict=True):
        effect, rival = one.effects[-1], any(one is t for t in tied)
        proof = None
        if rival or (one.heldout.nrmse < least and effect not in d.effects):
            proof = evidence_on(one, effect, found.trials)
        shown = None if proof is None else evidence_figure(proof)
        out.append(Other(rung, rival, shown))
    return tuple(out)


def _looks(own: Sequence[Effect]) -> dict[str, str]:
    return {effect.name: effect.looks_like for effect in (*known_effects(), *own)}


def report(
    tell: Tell, paths: Sequence[str], vessels: Sequence[tuple[str, str]], files: Sequence[str],
    out: str, told: bool,
) -> str:  # fmt: skip
    """Write the report of what is on the page; `told`: with this process's last diagnosis."""
    if told and "diagnosis" not in _last:
        raise BadInput("the answer went with a job that was cancelled: diagnose again first")
    own = effects_in(files)
    read = [(label, vessel_of(text, own)) for label, text in vessels]
    chosen = [_named(vessel, f"{vessel.name}, {label}") for label, vessel in read]
    models = [Model.of(vessel) for vessel in chosen]
    found = [one for path in paths for trial in trials_in(path) if trial.usable.any()
             for one in compared_trial(trial, models, None, tell)]  # fmt: skip
    tell("pictures")
    page = report_of(found, chosen, _last["diagnosis"] if told else None, read[0][1].name)
    return str(write_report(page, out).path)
