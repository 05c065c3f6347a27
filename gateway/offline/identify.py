"""`shadow identify`: recordings and a vessel file -> fitted parameters, each with its origin.

read → choose the time → identify → the new vessel file and its pictures

With `--by-recording` each of many recordings is fitted alone, then put together as one boat.
Recordings of boats of one type may stand beside each other: hull numbers are then shared, thrusters
are each boat's own. The boat of a recording is the name of the first pattern that it matches.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, numerical_errors
from gateway.figures import FigureData
from gateway.figures.matplotlib_draw import save_figures
from gateway.figures.motion import identification_figures, parameter_changes
from gateway.files import check_name, check_place, write_whole
from gateway.ingest.open import check_each_once
from gateway.offline.notices import notices_of
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, date_of, usable_trials
from gateway.offline.usable_time import (
    Exclusion,
    TimeSpan,
    exclude_stretches,
    limit_to_span,
    runs_without_thrust,
)
from gateway.vessel_file import (
    dump_vessel,
    listed,
    load_vessel,
    of_fitted_areas,
    read_vessel_file,
    revised,
)
from gateway.vessel_tables import AREAS_KEY, DynamicsTable, Provenance
from sim.effects.effect import Effect
from sim.identification import AREAS, BASE, MASSES, IdentifySettings
from sim.identification.by_recording import ByRecording, PooledNumber, identify_by_recording
from sim.identification.identify import Identification, identify
from sim.identification.intervals import Estimate
from sim.identification.parameters import UnknownNameError
from sim.identification.wiring import wiring_notices, wiring_of
from sim.model import Model
from sim.prediction.free_runs import DivergedError, Ruler, predict
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
    check_each_once((*logs, *validate))
    options = options.with_all((*logs, *validate))
    boat = load_vessel(vessel, known)
    if out is not None:
        check_place(Path(out).parent, Path(out))
    read = map(chosen, usable_trials(logs, options, progress))
    trials = exclude_stretches([limit_to_span(t, span or TimeSpan()) for t in read], exclude)
    others = usable_trials(validate, options, progress)
    if not options.anyway:
        _require_wiring(trials, [""] * len(trials), boat, vessel, each=False)
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
    vessel, settings = file or boat.name, settings or IdentifySettings()
    if settings.sizes_are_free and trials and runs_without_thrust(trials, boat):
        raise BadInput(
            f"{names}: no thruster of the vessel was commanded in the usable time: motion alone "
            f"tells no force from a mass; record with motors running, or hold the masses "
            f"({' '.join(f'--fix {name}' for name in MASSES)})"
        )
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
    common: dict[str, Any] = {
        "recording": listed(trial.name for trial in trials),
        "date": date_of(trials[0]),
        "version": version("shadow-gateway"),
        "fit": f"shadow identify, {fit}",
    }
    out = {
        f"dynamics.{e.name}" if e.name in DynamicsTable.model_fields else e.name: Provenance(
            **common | ({} if e.trial is None else {"recording": e.trial}),
            value=e.value,
            ci95=e.ci95,
            says=listed(filter(None, (e.doubt, *_on_other_recordings(e, estimates))), "; "),
        )
        for e in estimates
        if e.trial in (None, trials[0].name) and e.name not in AREAS
    }
    areas = [e for e in estimates if e.name in AREAS]
    if areas:  # the file has both under one key
        says = of_fitted_areas({e.name: e.ci95 for e in areas}, [e.doubt for e in areas])
        out[AREAS_KEY] = Provenance(**common, says=says)
    return out


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
        drawn = identification_figures(trial, was, now, ruler.longest_run(trial.dt))
        figures |= {f"{trial.name} {title}": figure for title, figure in drawn.items()}
    return figures


FITS = ("shooting", "simulation")


def boats_of(texts: Iterable[str]) -> dict[str, str]:
    """`NAME=PATTERN` texts -> pattern -> name; BadInput where one is none of these."""
    out = {}
    for text in texts:
        name, found, pattern = text.partition("=")
        if not (found and name and pattern):
            raise BadInput(f"--boat {text}: expected NAME=PATTERN, as in heron=heron/*")
        check_name(name, f"--boat {text}: the name")  # a part of the vessel file's name
        out[pattern] = name
    return out


def boat_of(log: str | Path, boats: Mapping[str, str]) -> str:
    """Whose recording it is; BadInput where no pattern fits."""
    for pattern, name in boats.items():
        if fnmatch(str(log), pattern) or fnmatch(str(log), f"*/{pattern}"):
            return name
    raise BadInput(f"{log}: fits none of --boat {', '.join(boats)}")


def files_of(out: Path, boats: Mapping[str, str]) -> dict[str, Path]:
    """Boat -> the vessel file to write for it."""
    names = list(dict.fromkeys(boats.values())) or [""]
    if len(names) == 1:
        return {names[0]: out}
    return {name: out.with_name(f"{out.stem}-{name}{out.suffix}") for name in names}


def identify_logs_by_recording(
    logs: Sequence[str | Path],
    vessel: str | Path,
    out: Path | None = None,
    settings: IdentifySettings | None = None,
    *,
    boats: Mapping[str, str] | None = None,
    options: TrialOptions = DEFAULT_TRIALS,
    effects: Iterable[Effect] = (),
    progress: Progress = lambda text: None,
) -> ByRecording:
    """Fit and put together; write the vessel file of each boat beside `out` (`files_of`)."""
    settings, patterns = settings or IdentifySettings(), boats or {}
    if settings.method not in FITS:
        raise BadInput(f"--by-recording goes with --method {' or '.join(FITS)}")
    check_each_once(logs)
    options = options.with_all(logs)
    boat, names = load_vessel(vessel, tuple(effects)), ", ".join(str(log) for log in logs)
    whose, trials = list[str](), []
    for log in logs:
        read = usable_trials([log], options, progress)
        trials += read
        whose += [boat_of(log, patterns) if patterns else ""] * len(read)
    if not options.anyway:
        _require_wiring(trials, whose, boat, vessel)
    try:
        with numerical_errors(names, vessel, ADVICE):
            found = identify_by_recording(trials, boat, settings, whose, progress)
    except (UnknownNameError, DivergedError) as error:
        raise BadInput(f"{vessel}: {error}") from None
    except NoUsableTimeError as error:
        raise BadInput(f"{names}: {error}") from None
    found = replace(found, notices=(*found.notices, *notices_of(trials, boat)))
    if out is None:
        return found
    old, odd = read_vessel_file(vessel), {one.recording for one in found.disagreements}
    fitted = {fit.recording for fit in found.fits} - odd
    for name, file in files_of(out, patterns).items():
        pairs = zip(trials, whose, strict=True)
        kept = [t for t, own in pairs if t.name in fitted and own == name] or trials[:1]
        estimates = [_estimate(one) for one in found.numbers if one.boat in ("", name)]
        origins = provenance(estimates, kept, f"each of {len(found.fits)} recordings alone")
        sources = listed(trial.name for trial in trials if trial.name in fitted)
        history = revised(old, boat, found.vessels[name], "shadow identify --by-recording", sources)
        text = dump_vessel(found.vessels[name], old.provenance | origins, history)
        write_whole(file, text.encode(), "the vessel file")
    return found


def _require_wiring(
    trials: Sequence[Trial], whose: Sequence[str], boat: Vessel, file: str | Path,
    each: bool = True,
) -> None:  # fmt: skip
    """BadInput where a boat does not go where it is commanded: every fit would be of nonsense.

    `whose`: of each trial its boat's name; `each`: one without a pulse on an output is enough, for
    it is fitted alone.
    """
    for name in dict.fromkeys(whose):
        own = [trial for trial, boats in zip(trials, whose, strict=True) if boats == name]
        found = wiring_of(own, boat)
        if not each:
            never = [one for one in found.undriven if len(one.runs) == len(own)]
            found = replace(found, undriven=tuple(never))
        wrong = wiring_notices(found, boat)
        if wrong:
            label = f" ({name})" if name else ""
            raise BadInput(
                f"{file}{label}: {'; '.join(wrong)}. Set that first: the numbers would be those of "
                "a boat with other motors (on the command line --anyway fits all the same)"
            )


def _estimate(one: PooledNumber) -> Estimate:
    return Estimate(one.name, one.unit, one.before, one.value, one.ci95, True)
