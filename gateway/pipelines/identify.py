"""Recordings and a vessel file -> a vessel file whose numbers were fitted, each with its origin."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.pipelines.trials import TrialOptions, load_trials
from gateway.vessel_file import Provenance, dump_vessel, load_vessel, read_vessel_file
from sim.diagnosis.segments import NoUsableTimeError
from sim.effects.effect import Effect
from sim.identification.estimate import Estimate
from sim.identification.identify import Identified, identify
from sim.identification.settings import BASE, IdentifySettings
from sim.identification.unknowns import UnknownNameError
from sim.trial import Trial

TABLES = (*BASE, "x_g", "Y_r", "N_v", "Y_uv", "Y_ur", "N_uv", "N_ur")  # of [dynamics]


@dataclass(frozen=True)
class Span:
    """From when to when [s after the first sample of each trial]; None: to its end."""

    start: float | None = None
    end: float | None = None


def identify_logs(
    logs: Sequence[str | Path],
    vessel: str | Path,
    out: str | Path | None = None,
    settings: IdentifySettings | None = None,
    *,
    span: Span | None = None,
    validate: Sequence[str | Path] = (),
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    effects: Iterable[Effect] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> Identified:
    """Fit, validate, and write the new vessel file where `out` names one."""
    known = tuple(effects)
    boat = load_vessel(vessel, known)
    if out is not None and not Path(out).resolve().parent.is_dir():
        raise BadInput(f"{out}: no such folder: {Path(out).resolve().parent}")
    trials = _read(logs, system, options, mapping, tell)
    chosen = [within(trial, span or Span()) for trial in trials]
    others = _read(validate, system, options, mapping, tell)
    try:
        found = identify(chosen, boat, settings, others, tell)
    except UnknownNameError as problem:
        raise BadInput(f"{vessel}: {problem}") from None
    except NoUsableTimeError as problem:
        names = ", ".join(str(log) for log in logs)
        raise BadInput(f"{names}: {problem}") from None
    if out is not None:
        old = read_vessel_file(vessel).provenance
        text = dump_vessel(found.vessel, old | provenance(found.estimates, chosen))
        Path(out).write_text(text, encoding="utf-8")
    return found


def settings_of(
    free: Iterable[str], fix: Iterable[str], priors: Iterable[str], method: str
) -> IdentifySettings:
    """What a command line asks for: the nine base parameters, and what is named."""
    known = {}
    for text in priors:
        name, _, share = text.partition("=")
        try:
            known[name] = float(share)
        except ValueError:
            raise BadInput(f"--prior {text}: expected NAME=SHARE, as in m11=0.15") from None
    try:
        return IdentifySettings((*BASE, *free), tuple(fix), known, method)
    except ValueError as problem:
        raise BadInput(str(problem)) from None


def within(trial: Trial, span: Span) -> Trial:
    """The same trial with only the span usable; one line where it holds nothing."""
    start, end = span.start or 0.0, np.inf if span.end is None else span.end
    if not start < end:
        raise BadInput(f"--from {start:g} --to {end:g}: expected a span of time, from before to")
    rows = (trial.time >= start) & (trial.time < end)
    return replace(trial, usable=trial.usable & rows)


def provenance(estimates: Sequence[Estimate], trials: Sequence[Trial]) -> dict[str, Provenance]:
    """Where each number came from: recording, date, version, interval."""
    names = ", ".join(trial.name for trial in trials)
    day = datetime.fromtimestamp(trials[0].start_time_ns * 1e-9, UTC).date().isoformat()
    return {
        _key(e): Provenance(
            recording=e.trial or names,
            date=day,
            version=version("shadow-gateway"),
            ci95=e.ci95,
            says=e.doubt,
        )
        for e in estimates
    }


def _key(estimate: Estimate) -> str:
    return f"dynamics.{estimate.name}" if estimate.name in TABLES else estimate.name


def _read(
    logs: Sequence[str | Path],
    system: int | None,
    options: TrialOptions | None,
    mapping: str | Path | None,
    tell: Callable[[str], None],
) -> list[Trial]:
    """All trials of all logs."""
    out: list[Trial] = []
    for log in logs:
        tell(f"reading {Path(log).name}")
        out += [t for t in load_trials(log, system, options, mapping) if t.usable.any()]
    return out
