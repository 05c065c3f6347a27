"""One recording of a fleet -> its row and its estimates: the task that runs on a worker.

    read → survey → trials → compare → identify → diagnose, as asked

The steps are those of the single commands. What one step cannot do costs the row that step alone.
"""

import resource
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import BadInput, ShadowError
from gateway.fleet import Boat, local_file
from gateway.ingest.log import choose_floating
from gateway.ingest.mapping import moment_of
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from gateway.offline.compare import compare_models
from gateway.offline.diagnose import DIAGNOSIS_TRIALS, diagnosed_trials
from gateway.offline.identify import identify_settings, identify_trials
from gateway.offline.trials import TrialOptions, trials_of
from gateway.offline.usable_time import excluded_summary
from gateway.user_effects import known_effects, load_effects
from gateway.vessel_file import load_vessel, read_vessel_file
from sim.comparison.compare import Comparison
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.thresholds import GUESSED_PRIOR
from sim.identification import MASSES
from sim.identification.intervals import Estimate
from sim.model import Model
from sim.near_names import did_you_mean
from sim.state import Nu
from sim.trial import Trial
from sim.vessel import Vessel

STEPS = ("compare", "identify", "diagnose")
DONE, PARTLY, FAILED, DUPLICATE = "done", "partly", "failed", "duplicate"
LASTING = (DONE, PARTLY, FAILED)  # states that the same recording and settings would have again
FAULT = "fault"  # of the program or its machine: tried again on the next run
DAY_S = 86400.0
CLOCK_OFF_S = DAY_S  # further from the boat's, a recording's clock was not set; chosen
Row = dict[str, Any]


@dataclass(frozen=True)
class AnalysisSettings:
    """What is asked of every recording; `free`, `fix` and `prior` as those of `shadow identify`.

    Without `free` and `fix`, the thrust ahead of every thruster is fitted and the inertia is held:
    both at once cannot be told from motion, and thrust is what wears.
    """

    steps: tuple[str, ...] = ("compare", "identify")
    free: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()  # Python files with effects of one's own
    anyway: bool = False

    def __post_init__(self) -> None:
        unknown = sorted(set(self.steps) - set(STEPS))
        if unknown:
            meant = did_you_mean(unknown[0], STEPS)
            raise BadInput(
                f"--steps {', '.join(unknown)}: {meant}expected some of {', '.join(STEPS)}"
            )
        identify_settings(self.free, self.fix, self.prior, "shooting")  # mistakes, before the work

    def fit_of(self, vessel: Vessel) -> tuple[Sequence[str], Sequence[str]]:
        """Parameters to free and to fix on a vessel."""
        if self.free or self.fix:
            return self.free, self.fix
        return [f"{thruster.name}.ahead" for thruster in vessel.thrusters], MASSES


@dataclass(frozen=True)
class Task:
    """One recording, its boat and what is asked: all that travels to a worker."""

    recording: str
    boat: Boat
    settings: AnalysisSettings


@dataclass(frozen=True)
class Analysis:
    """What came of one recording: values of columns of `gateway.fleet.table`, by their names."""

    row: Row
    estimates: tuple[Row, ...] = ()


def analyse(task: Task) -> Analysis:
    """Run a task; whatever goes wrong ends in a row that says why."""
    begun = time.monotonic()
    try:
        with local_file(task.recording) as file:
            found = _analysed(file, task)
    except ShadowError as error:
        found = Analysis({"state": FAILED, "why": str(error)})
    except Exception as error:  # the outermost loop of a task: the row tells it
        found = Analysis({"state": FAULT, "why": f"{type(error).__name__}: {error}"})
    work = {
        "seconds_of_work": time.monotonic() - begun,
        "peak_memory_mb": _peak_memory_mb(),
        "analysed": datetime.now(UTC).isoformat(),
        "version": version("shadow-gateway"),
    }
    return replace(found, row=work | found.row)


def _peak_memory_mb() -> float:
    """The most that this worker has held so far."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # of ru_maxrss [bytes]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _analysed(file: Path, task: Task) -> Analysis:
    """The steps that were asked for, one after the other."""
    effects = [effect for name in task.settings.effects for effect in load_effects(name)]
    vessel = load_vessel(task.boat.vessel_file, effects)
    log = open_log(file, task.boat.mapping)
    options = TrialOptions(system=task.boat.system, anyway=task.settings.anyway)
    trials = trials_of(log, options)
    sailed = survey(log, choose_floating(log, options.system, options.anyway).system).boats[0]
    row: Row = {"format": log.kind, "state": DONE, "good_for": list(sailed.good_for)}
    row |= summary_of(trials, sailed.unix_ahead_s or 0.0)
    usable, estimates, problems = [t for t in trials if t.usable.any()], list[Row](), list[str]()

    def identify() -> Row:
        free, fix = task.settings.fit_of(vessel)
        settings = identify_settings(free, fix, task.settings.prior, "shooting")
        found = identify_trials(usable, vessel, settings, names=file.name)
        estimates.extend(estimate_row(e, "parameter", "identify") for e in found.estimates)
        return {"not_identifiable": list(found.unconfirmed)}

    def diagnose() -> Row:
        coarse = replace(DIAGNOSIS_TRIALS, system=options.system, anyway=options.anyway)
        guessed = read_vessel_file(task.boat.vessel_file).guessed
        settings = DiagnoseSettings(effects=(*known_effects(), *effects))
        settings = replace(settings, prior=GUESSED_PRIOR) if guessed else settings
        read = [t for t in trials_of(log, coarse) if t.usable.any()]
        found = diagnosed_trials(read, vessel, settings, file.name)
        last = found.ladder[-1]
        for effect, numbers in last.parameters.items():
            estimates.extend(estimate_row(e, "effect", "diagnose", effect) for e in numbers)
        base = last.base_parameters
        estimates.extend(estimate_row(e, "parameter", "diagnose") for e in base)
        return {
            "verdict": str(found.verdict), "effects": list(found.effects),
            "diagnosis": found.summary, "heldout_nrmse_before": found.ladder[0].heldout.nrmse,
            "heldout_nrmse_after": last.heldout.nrmse,
        }  # fmt: skip

    steps: dict[str, Callable[[], Row]] = {
        "compare": lambda: _compared(usable, vessel), "identify": identify, "diagnose": diagnose,
    }  # fmt: skip
    for name in (step for step in STEPS if step in task.settings.steps):
        try:
            row |= steps[name]()
        except ShadowError as error:
            problems.append(f"{name}: {error}")
    if problems:
        row |= {"state": PARTLY, "why": "; ".join(problems)}
    return Analysis(row, tuple(estimates))


def summary_of(trials: Sequence[Trial], ahead_s: float = 0.0) -> Row:
    """When, where, how long, how far and how fast: of the time that is usable.

    ahead_s  by how much the boat's own time of day is ahead of the recording's
    """
    first = min(trials, key=lambda t: t.start_time_ns)
    off = ahead_s if abs(ahead_s) > CLOCK_OFF_S else 0.0
    notices = list(dict.fromkeys(n for t in trials for n in t.notices))
    if off:
        notices.append(
            f"its clock is {abs(off) / DAY_S:.0f} days {'behind' if off > 0.0 else 'ahead of'} "
            "the boat's: dated by the boat's"
        )
    speed = [np.hypot(t.nu[:, Nu.U], t.nu[:, Nu.V])[t.usable] for t in trials]
    lengths = [float(s.sum()) * t.dt for s, t in zip(speed, trials, strict=True)]
    latitude, longitude = first.origin_deg or (None, None)
    began = moment_of(first.start_time_ns * 1e-9 + off)
    return {
        "started": None if began is None else began.isoformat(),
        "seconds": sum(float(t.time[-1]) for t in trials),
        "usable_s": sum(float(t.usable.sum()) * t.dt for t in trials),
        "stretches": len(trials), "excluded": excluded_summary(trials),
        "latitude_deg": latitude, "longitude_deg": longitude,
        "distance_m": sum(lengths),
        "top_speed_mps": max((float(s.max()) for s in speed if len(s)), default=None),
        "notices": notices,
    }  # fmt: skip


def _compared(trials: Iterable[Trial], vessel: Vessel) -> Row:
    """Errors over all stretches, each weighted by its time."""
    model = Model.of(vessel)
    left_out: list[str] = []
    found = [
        comparison
        for trial in trials
        for one in compare_models(trial, [model], None, left_out.append)
        for comparison in one.comparisons
    ]
    if not found:
        raise BadInput("; ".join(left_out) or "no stretch that can be compared over")
    return {
        "nrmse": _mean([c.nrmse for c in found], found),
        "noise_floor_nrmse": _mean([c.noise_floor_nrmse for c in found], found),
        "rmse_surge_mps": _mean([c.scores.rmse["u"] for c in found], found),
        "rmse_sway_mps": _mean([c.scores.rmse["v"] for c in found], found),
        "rmse_yaw_rate_radps": _mean([c.scores.rmse["r"] for c in found], found),
    }


def _mean(values: Sequence[float], comparisons: Sequence[Comparison]) -> float:
    """Root of the mean square, weighted by seconds."""
    return float(np.sqrt(np.average(np.square(values), weights=[c.seconds for c in comparisons])))


def estimate_row(one: Estimate, kind: str, origin: str, effect: str | None = None) -> Row:
    """A parameter, or a number of an effect that was found, with its interval."""
    return {
        "kind": kind, "origin": origin, "effect": effect, "name": one.name,
        "value": one.value, "low": one.ci95[0], "high": one.ci95[1], "unit": one.unit,
        "before": one.before, "identifiable": one.identifiable, "stretch": one.trial,
        "doubt": one.doubt,
    }  # fmt: skip
