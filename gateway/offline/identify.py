"""Recordings and a vessel file -> a vessel file whose numbers were fitted, each with its origin.

An identification -> its pictures in a folder.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from gateway.atomic_file import write_whole
from gateway.errors import BadInput, numerical_errors
from gateway.figures.identification import identification_figures, parameter_changes
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.compare import file_name
from gateway.offline.trials import TrialOptions, usable_trials
from gateway.offline.usable import Exclusion, notices_of, without
from gateway.vessel_file import Provenance, dump_vessel, load_vessel, read_vessel_file
from sim.effects.effect import Effect
from sim.identification.identify import Identification, identify
from sim.identification.intervals import Estimate
from sim.identification.parameters import UnknownNameError
from sim.identification.settings import BASE, IdentifySettings
from sim.model import Model
from sim.prediction.free_runs import DivergedError, predict
from sim.prediction.scales import Ruler
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel

TABLES = (*BASE, "x_g", "Y_r", "N_v", "Y_uv", "Y_ur", "N_uv", "N_ur")  # of [dynamics]
ADVICE = "leave out odd stretches with --exclude, hold numbers with --fix, or try another --method"


@dataclass(frozen=True)
class TimeSpan:
    """From when to when [s after the first sample of each trial]; None: to its end."""

    start: float | None = None
    end: float | None = None


def identify_logs(
    logs: Sequence[str | Path],
    vessel: str | Path,
    out: str | Path | None = None,
    settings: IdentifySettings | None = None,
    *,
    span: TimeSpan | None = None,
    exclude: Sequence[Exclusion] = (),
    pictures: str | Path | None = None,
    validate: Sequence[str | Path] = (),
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    effects: Iterable[Effect] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Fit and validate; write the new vessel file to `out`, draw into the folder `pictures`."""
    known, names = tuple(effects), ", ".join(str(log) for log in logs)
    boat = load_vessel(vessel, known)
    if out is not None and not Path(out).resolve().parent.is_dir():
        raise BadInput(f"{out}: no such folder: {Path(out).resolve().parent}")
    trials = usable_trials(logs, system, options, mapping, tell)
    chosen = without([within(trial, span or TimeSpan()) for trial in trials], exclude)
    others = usable_trials(validate, system, options, mapping, tell)
    try:
        with numerical_errors(names, vessel, ADVICE):
            found = identify(chosen, boat, settings, others, tell)
    except (UnknownNameError, DivergedError) as problem:
        raise BadInput(f"{vessel}: {problem}") from None
    except NoUsableTimeError as problem:
        raise BadInput(f"{names}: {problem}") from None
    notices = (*notices_of((*chosen, *others), boat), *voyage_notices(found))
    found = replace(found, notices=notices)
    if pictures is not None:
        tell("pictures")
        save_pictures(found, boat, chosen, others, pictures)
    if out is not None:
        old = read_vessel_file(vessel).provenance
        text = dump_vessel(found.vessel, old | provenance(found.estimates, chosen))
        write_whole(Path(out), text.encode(), "the vessel file")
    return found


def identify_settings(
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


def within(trial: Trial, span: TimeSpan) -> Trial:
    """The same trial with only the span usable; one line where it holds nothing."""
    start, end = span.start or 0.0, np.inf if span.end is None else span.end
    if not start < end:
        raise BadInput(f"--from {start:g} --to {end:g}: expected a span of time, from before to")
    rows = (trial.time >= start) & (trial.time < end)
    return replace(trial, usable=trial.usable & rows)


def provenance(estimates: Sequence[Estimate], trials: Sequence[Trial]) -> dict[str, Provenance]:
    """Where each number came from: recording, date, version, interval.

    Of a number that each recording has for itself, the file holds that of the first.
    """
    names = ", ".join(trial.name for trial in trials)
    day = datetime.fromtimestamp(trials[0].start_time_ns * 1e-9, UTC).date().isoformat()
    kept = [e for e in estimates if e.trial in (None, trials[0].name)]
    return {
        _key(e): Provenance(
            recording=e.trial or names,
            date=day,
            version=version("shadow-gateway"),
            ci95=e.ci95,
            says="; ".join(filter(None, (e.doubt, *_elsewhere(e, estimates)))),
        )
        for e in kept
    }


def _elsewhere(one: Estimate, estimates: Sequence[Estimate]) -> list[str]:
    """What the same number was on the other recordings."""
    return [
        f"{e.value:.4g} {e.unit} on {e.trial}"
        for e in estimates
        if one.trial is not None and e.name == one.name and e.trial != one.trial
    ]


def voyage_notices(found: Identification) -> list[str]:
    """A warning where the vessel can hold the numbers of one recording only."""
    names = list(dict.fromkeys(e.trial for e in found.estimates if e.trial is not None))
    if len(names) < 2:
        return []
    numbers = dict.fromkeys(e.name for e in found.estimates if e.trial is not None)
    return [
        f"{', '.join(numbers)}: each recording has its own; the vessel holds those of {names[0]}, "
        "which mean nothing on another day"
    ]


def _key(estimate: Estimate) -> str:
    return f"dynamics.{estimate.name}" if estimate.name in TABLES else estimate.name


def save_pictures(
    found: Identification,
    before: Vessel,
    trials: Sequence[Trial],
    others: Sequence[Trial],
    folder: str | Path,
) -> list[Path]:
    """Parameters, and of each recording velocities and track: measured, before and after."""
    name = found.vessel.name
    pictures = {f"{name} parameters": parameter_changes(name, found.estimates)}
    first = Model.of(before)
    vessels = [*found.vessels, *(found.vessel for _ in others)]
    for trial, vessel in zip((*trials, *others), vessels, strict=True):
        ruler = Ruler.of(trial, first)
        both, later = (first, Model.of(vessel)), found.command_offset
        was, now = (predict(trial, model, ruler, later) for model in both)
        drawn = identification_figures(trial, was, now, ruler.settings.horizon)
        pictures |= {f"{trial.name} {name}": figure for name, figure in drawn.items()}
    return [save_figure(p, Path(folder) / f"{file_name(name)}.png") for name, p in pictures.items()]
