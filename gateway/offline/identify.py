"""`shadow identify`: recordings and a vessel file -> fitted parameters, each with its origin.

read → choose the time → identify → the new vessel file and its pictures
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from gateway.errors import BadInput, numerical_errors
from gateway.figures.excitation import identification_figures, parameter_changes
from gateway.figures.figure_data import FigureData
from gateway.figures.matplotlib_draw import save_figures
from gateway.files import write_whole
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, date_of, usable_trials
from gateway.offline.usable_time import (
    Exclusion,
    TimeSpan,
    exclude_stretches,
    limit_to_span,
    notices_of,
)
from gateway.outputs import check_place
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file, revised
from gateway.vessel_tables import DynamicsTable, Provenance
from sim.effects.effect import Effect
from sim.identification.identify import Identification, identify
from sim.identification.intervals import Estimate
from sim.identification.parameters import UnknownNameError
from sim.identification.settings import BASE, IdentifySettings
from sim.model import Model
from sim.prediction.free_runs import DivergedError, predict
from sim.prediction.scales import Ruler
from sim.prediction.segments import NoUsableTimeError
from sim.state import Progress
from sim.trial import Trial
from sim.vessel import Vessel

ADVICE = "leave out odd stretches with --exclude, hold numbers with --fix, or try another --method"


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
    options: TrialOptions = DEFAULT_TRIALS,
    effects: Iterable[Effect] = (),
    chosen: Callable[[Trial], Trial] = lambda trial: trial,
    progress: Progress = lambda text: None,
) -> Identification:
    """Fit and validate; write the new vessel file to `out`, draw into the folder `pictures`.

    `chosen`: what of each trial is to be usable.
    """
    known, names = tuple(effects), ", ".join(str(log) for log in logs)
    boat = load_vessel(vessel, known)
    if out is not None:
        check_place(Path(out).parent, Path(out))
    read = map(chosen, usable_trials(logs, options, progress))
    trials = exclude_stretches([limit_to_span(t, span or TimeSpan()) for t in read], exclude)
    others = usable_trials(validate, options, progress)
    found = identify_trials(
        trials, boat, settings, others, names=names, file=vessel, progress=progress
    )
    notices = (*notices_of((*trials, *others), boat), *voyage_notices(found))
    found = replace(found, notices=notices)
    if pictures is not None:
        progress("pictures")
        save_figures(_figures(found, boat, trials, others), pictures)
    if out is not None:
        old = read_vessel_file(vessel)
        origins = provenance(found.estimates, trials, f"{found.method}, {found.seconds:.0f} s")
        history = revised(
            old, boat, found.vessel, "shadow identify", ", ".join(trial.name for trial in trials)
        )
        text = dump_vessel(found.vessel, old.provenance | origins, history)
        write_whole(Path(out), text.encode(), "the vessel file")
    return found


def identify_trials(
    trials: Sequence[Trial],
    boat: Vessel,
    settings: IdentifySettings | None = None,
    others: Sequence[Trial] = (),
    *,
    names: str,
    file: str | Path | None = None,
    progress: Progress = lambda text: None,
) -> Identification:
    """Fit on trials; BadInput, which begins with the name of what is to blame, where one cannot."""
    vessel = file or boat.name
    try:
        with numerical_errors(names, vessel, ADVICE):
            return identify(trials, boat, settings, others, progress)
    except (UnknownNameError, DivergedError) as error:
        raise BadInput(f"{vessel}: {error}") from None
    except NoUsableTimeError as error:
        raise BadInput(f"{names}: {error}") from None


def identify_settings(
    free: Iterable[str], fix: Iterable[str], priors: Iterable[str], method: str
) -> IdentifySettings:
    """Settings from the options of a command line: the nine base parameters, and those named."""
    shares = {}
    for text in priors:
        name, _, share = text.partition("=")
        try:
            shares[name] = float(share)
        except ValueError:
            raise BadInput(f"--prior {text}: expected NAME=SHARE, as in m11=0.15") from None
    try:
        return IdentifySettings((*BASE, *free), tuple(fix), shares, method)
    except ValueError as error:
        raise BadInput(str(error)) from None


def provenance(
    estimates: Sequence[Estimate], trials: Sequence[Trial], fit: str
) -> dict[str, Provenance]:
    """Where each number came from: recording, fit, date, version, value, interval.

    Of a number that each recording has for itself, the file holds that of the first.
    """
    names = ", ".join(trial.name for trial in trials)
    return {
        f"dynamics.{e.name}" if e.name in DynamicsTable.model_fields else e.name: Provenance(
            recording=e.trial or names,
            date=date_of(trials[0]),
            version=version("shadow-gateway"),
            fit=f"shadow identify, {fit}",
            value=e.value,
            ci95=e.ci95,
            says="; ".join(filter(None, (e.doubt, *_on_other_recordings(e, estimates)))),
        )
        for e in estimates
        if e.trial in (None, trials[0].name)
    }


def _on_other_recordings(one: Estimate, estimates: Sequence[Estimate]) -> list[str]:
    """What the same number was on the other recordings."""
    return [
        f"{e.value:.4g} {e.unit} on {e.trial}"
        for e in estimates
        if one.trial is not None and e.name == one.name and e.trial != one.trial
    ]


def voyage_notices(found: Identification) -> list[str]:
    """A notice where the vessel can hold the numbers of one recording only."""
    own = [e for e in found.estimates if e.trial is not None]
    names = list(dict.fromkeys(e.trial for e in own))
    if len(names) < 2:
        return []
    numbers = dict.fromkeys(e.name for e in own)
    return [
        f"{', '.join(numbers)}: each recording has its own; the vessel holds those of {names[0]}, "
        "which mean nothing on another day"
    ]


def _figures(
    found: Identification, before: Vessel, trials: Sequence[Trial], others: Sequence[Trial]
) -> dict[str, FigureData]:
    """Parameters, and of each recording velocities and track: measured, before and after."""
    name = found.vessel.name
    figures = {f"{name} parameters": parameter_changes(name, found.estimates)}
    first = Model.of(before)
    vessels = [*found.vessels, *(found.vessel for _ in others)]
    for trial, vessel in zip((*trials, *others), vessels, strict=True):
        ruler = Ruler.of(trial, first)
        models, later = (first, Model.of(vessel)), found.command_offset
        was, now = (predict(trial, model, ruler, later) for model in models)
        drawn = identification_figures(trial, was, now, ruler.settings.horizon)
        figures |= {f"{trial.name} {title}": figure for title, figure in drawn.items()}
    return figures
