"""`shadow identify --by-recording`: many recordings, each fitted alone, put together as one boat.

Recordings of boats of one type may stand beside each other: hull numbers are then shared, thrusters
are each boat's own. The boat of a recording is the name of the first pattern that it matches.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

from gateway.errors import BadInput, numerical_errors
from gateway.files import write_whole
from gateway.offline.identify import ADVICE, provenance
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, usable_trials
from gateway.offline.usable_time import notices_of
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file, revised
from sim.effects.effect import Effect
from sim.identification.by_recording import ByRecording, PooledNumber, identify_by_recording
from sim.identification.intervals import Estimate
from sim.identification.parameters import UnknownNameError
from sim.identification.settings import IdentifySettings
from sim.identification.wiring import wiring_notices, wiring_of
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from sim.state import Progress
from sim.trial import Trial
from sim.vessel import Vessel

FITS = ("shooting", "simulation")


def boats_of(texts: Iterable[str]) -> dict[str, str]:
    """`NAME=PATTERN` texts -> pattern -> name; BadInput where one is none of these."""
    out = {}
    for text in texts:
        name, found, pattern = text.partition("=")
        if not (found and name and pattern):
            raise BadInput(f"--boat {text}: expected NAME=PATTERN, as in heron=heron/*")
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
        sources = ", ".join(trial.name for trial in trials if trial.name in fitted)
        history = revised(old, boat, found.vessels[name], "shadow identify --by-recording", sources)
        text = dump_vessel(found.vessels[name], old.provenance | origins, history)
        write_whole(file, text.encode(), "the vessel file")
    return found


def _require_wiring(
    trials: Sequence[Trial], whose: Sequence[str], boat: Vessel, file: str | Path
) -> None:
    """BadInput where a boat does not go where it is commanded: every fit would be of nonsense."""
    for name in dict.fromkeys(whose):
        own = [trial for trial, each in zip(trials, whose, strict=True) if each == name]
        wrong = wiring_notices(wiring_of(own, boat), boat)
        if wrong:
            label = f" ({name})" if name else ""
            raise BadInput(
                f"{file}{label}: {'; '.join(wrong)}. Set that first: each recording would be "
                "fitted to motors that it does not have (--anyway fits all the same)"
            )


def _estimate(one: PooledNumber) -> Estimate:
    return Estimate(one.name, one.unit, one.before, one.value, one.ci95, True)
