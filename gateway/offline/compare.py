"""`shadow compare`: recordings and vessel files -> comparisons and their pictures."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, numerical_errors, printable
from gateway.figures.comparison import comparison_figures
from gateway.figures.matplotlib_draw import save_figures
from gateway.ingest.open import check_each_once
from gateway.offline.notices import notices_of
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions, load_trials
from gateway.offline.usable_time import excluded_summary
from gateway.vessel_file import load_vessel
from sim.comparison.compare import Comparison, compare
from sim.comparison.improvement import improvements
from sim.comparison.refit import TooShortError, compare_refitted
from sim.effects.effect import Effect
from sim.model import Model
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import CompareSettings, NoUsableTimeError
from sim.state import Progress
from sim.trial import Trial
from sim.vessel import Vessel


@dataclass(frozen=True)
class TrialComparison:
    """One trial and its comparisons, one per vessel, all by one ruler."""

    trial: Trial
    comparisons: tuple[Comparison, ...]

    @property
    def notices(self) -> tuple[str, ...]:
        """What is to be known before the numbers are read, a sentence each, each once."""
        told = (text for one in self.comparisons for text in (*one.notices, one.cut_text))
        return tuple(text for text in dict.fromkeys(told) if text)

    def with_notice(self, text: str) -> "TrialComparison":
        """The same, each comparison with one notice more."""
        told = (replace(one, notices=(*one.notices, text)) for one in self.comparisons)
        return replace(self, comparisons=tuple(told))


def compare_logs(
    logs: Sequence[str | Path],
    vessels: Sequence[str | Path | Vessel],
    settings: CompareSettings | None = None,
    *,
    options: TrialOptions = DEFAULT_TRIALS,
    effects: Iterable[Effect] = (),
    pictures: str | Path | None = None,
    progress: Progress = lambda text: None,
    refit: bool = False,
) -> list[Comparison]:
    """Every trial of every log against every vessel; `refit` as in `compare_by_trial`.

    Trials without usable time are left out; a log of nothing else is bad input. `pictures` names
    a folder that gets all pictures.
    """
    if not logs:
        raise BadInput("nothing to compare: give at least one recording and one vessel file")
    check_each_once(logs)
    options = options.with_all(logs)
    named = distinct_vessels(vessels, tuple(effects))
    out: list[Comparison] = []
    for log in logs:
        for one in compare_by_trial(
            [log], named, settings=settings, options=options, refit=refit, progress=progress
        ):
            if pictures is not None:
                progress(f"{one.trial.name}: pictures")
                figures = comparison_figures(one.trial, one.comparisons)
                save_figures({f"{one.trial.name} {k}": v for k, v in figures.items()}, pictures)
            out += one.comparisons
    return out


def compare_by_trial(
    logs: Sequence[str | Path],
    vessels: Sequence[Vessel],
    *,
    settings: CompareSettings | None = None,
    options: TrialOptions = DEFAULT_TRIALS,
    refit: bool = False,
    progress: Progress = lambda text: None,
) -> list[TrialComparison]:
    """Every trial with usable time of every log; BadInput where there is none at all.

    `refit`: effects that belong to one voyage are estimated anew, on blocks of time that they are
    not scored on.
    """
    if not logs or not vessels:
        raise BadInput("nothing to compare: give at least one recording and one vessel file")
    check_each_once(logs)
    options = options.with_all(logs)
    models = [Model.of(vessel) for vessel in vessels]
    out: list[TrialComparison] = []
    trials: list[Trial] = []
    for log in logs:
        progress(f"reading {Path(log).name}")
        read = load_trials(log, None, options)
        for trial in read:
            out += compare_models(trial, models, settings, progress, refit)
        trials += read
    if not out:
        names = ", ".join(str(log) for log in logs)
        why = excluded_summary(trials) or "all are too short"
        raise BadInput(f"{names}: no stretch that can be compared over: {why}")
    return out


def compare_models(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None,
    progress: Progress,
    refit: bool = False,
) -> list[TrialComparison]:
    """All models on one trial, as a list of one; an empty list where no time can be used.

    A trial too short to estimate on one half what is scored on the other is compared without, and
    says so.
    """
    how = compare_refitted if refit else compare
    try:
        with numerical_errors(trial.name, ", ".join(model.vessel.name for model in models)):
            found = how(trial, models, settings, lambda name: progress(f"{trial.name}: {name}"))
    except TooShortError as error:
        return [
            one.with_notice(f"not re-estimated for this voyage: {error}")
            for one in compare_models(trial, models, settings, progress)
        ]
    except DivergedError as error:
        raise BadInput(f"{trial.name}: {error}") from None
    except NoUsableTimeError as error:
        progress(f"left out, {error}")
        return []
    comparisons = tuple(
        replace(one, notices=notices_of([trial], model.vessel))
        for one, model in zip(found, models, strict=True)
    )
    return [TrialComparison(trial, comparisons)]


def distinct_vessels(
    vessels: Sequence[str | Path | Vessel], effects: Sequence[Effect] = ()
) -> list[Vessel]:
    """Vessels or their files -> vessels with distinct names: old and new often share one."""
    read = [v if isinstance(v, Vessel) else load_vessel(v, effects) for v in vessels]
    names = [v.name for v in read]
    out = []
    for i, (given, vessel) in enumerate(zip(vessels, read, strict=True)):
        mark = f"#{i + 1}" if isinstance(given, Vessel) else printable(Path(given).name)
        shared = names.count(vessel.name) > 1
        out.append(replace(vessel, name=f"{vessel.name} ({mark})") if shared else vessel)
    return out


def as_json(comparisons: Iterable[Comparison]) -> dict[str, Any]:
    """What `shadow compare --json` prints."""
    found = list(comparisons)
    better = [one.to_dict() for one in improvements(found)]
    trials = [comparison.to_dict() for comparison in found]
    return {"trials": trials, **({"improvements": better} if better else {})}
