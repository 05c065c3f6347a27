"""`shadow diagnose`: recordings and a vessel file -> what is missing from the vessel.

read → diagnose → diagnosis.json, the better vessel file, pictures, the next command lines
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, numerical_errors, shell_path
from gateway.figures.diagnosis import diagnosis_figures
from gateway.figures.matplotlib_draw import save_figures
from gateway.files import write_whole
from gateway.kernels_ahead import compiled_ahead
from gateway.offline.add import DiagnosisFile, add_from_diagnosis
from gateway.offline.concentrated import concentrated_error
from gateway.offline.notices import notices_of
from gateway.offline.trials import TrialOptions, date_of, usable_trials
from gateway.offline.usable_time import runs_without_thrust
from gateway.result_json import result_json
from gateway.user_effects import known_effects
from gateway.vessel_file import load_vessel, read_vessel_file
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.diagnosis.fit_problem import kernels_of_a_diagnosis
from sim.diagnosis.more_room import numbers_at_limit
from sim.diagnosis.next_experiment import separations
from sim.diagnosis.thresholds import GUESSED_PRIOR
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Scope, Separation
from sim.excitation.catalogue import BY_NAME
from sim.model import parameters_of
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from sim.state import Progress
from sim.trial import Trial
from sim.vessel import Vessel

# A diagnosis compares means over 0.4 s: a finer grid costs three times as much and tells no more.
DIAGNOSIS_TRIALS = TrialOptions(rate_hz=5.0)
WORKERS = 2  # threads; the compiled kernels release the interpreter lock
SPIN = "spin"  # an excitation on the spot
DEFAULT_PATTERN = "always"  # of `Effect.pattern_for`: the pattern where no other is declared


@dataclass(frozen=True)
class DiagnosisResult:
    """The diagnosis, the vessel as it was given, and the recordings.

    effect_files  with effects of one's own that were tried too
    flags         of the command line that the recordings were read with, each after a space
    """

    diagnosis: Diagnosis
    before: Vessel
    trials: tuple[Trial, ...]
    logs: tuple[str, ...]
    vessel_file: str
    notices: tuple[str, ...] = ()
    effect_files: tuple[str, ...] = ()
    flags: str = ""

    @property
    def at_limit(self) -> list[str]:
        """Names of base numbers that went as far as they were allowed to."""
        return numbers_at_limit(self.diagnosis.ladder[-1], self.diagnosis.prior)

    @property
    def contradicted(self) -> bool:
        """Whether sensors contradict one another: no effect of one's own mends that."""
        return any(trial.contradictions for trial in self.trials)

    @property
    def _can_identify(self) -> bool:
        """Whether it is of use to fit the numbers: they had to move, and these data tell them."""
        return self._base_is_off and not runs_without_thrust(self.trials, self.before)

    @property
    def _base_is_off(self) -> bool:
        """Whether the numbers of the file had to move."""
        return self.diagnosis.base_changed and not self.diagnosis.base_may_hold

    @property
    def found_beside(self) -> list[str]:
        """Effects found that alone are not among the most promising: only beside another."""
        ranked = {row.effect for row in self.diagnosis.ranking}
        return [name for name in self.diagnosis.effects if name not in ranked]

    @property
    def rivals(self) -> list[str]:
        """Effects that are confounded with one another and one that was chosen, that one first."""
        if self.diagnosis.verdict is not Verdict.CONFOUNDED:
            return []
        found = {*self.diagnosis.effects}
        rows = [
            c for c in self.diagnosis.ranking
            if c.confounded_with and found.intersection((c.effect, *c.confounded_with))
        ]  # fmt: skip
        unshown = (name for c in rows for name in c.confounded_with)
        return list(dict.fromkeys((*(c.effect for c in rows), *unshown)))

    @property
    def separations(self) -> dict[tuple[str, str], Separation]:
        """What would separate the rivals, pair by pair."""
        return separations(self.rivals)

    @property
    def improves(self) -> bool:
        """Whether there is a vessel to write that is better than the one given."""
        return bool(self.diagnosis.best.effects) or self._base_is_off

    @property
    def voyage_effects(self) -> list[str]:
        """Effects found that mean nothing on another day."""
        added = self.diagnosis.vessel.effects
        return [a.effect.name for a in added if a.effect.scope is Scope.VOYAGE]

    def to_dict(self) -> dict[str, Any]:
        """What `shadow diagnose --json` prints and `shadow add --from` reads."""
        answer = self.diagnosis.to_dict()
        steps = (*self.diagnosis.ladder, *self.diagnosis.alternatives)
        for step, entry in zip(steps, answer["ladder"] + answer["alternatives"], strict=True):
            entry |= _parameters_by_recording(step, self.trials) | self._own_parameters(step)
        if answer["next_manoeuvre"] is None and self.separations:
            answer["next_manoeuvre"] = next(iter(self.separations.values())).description
        return answer | {
            "vessel_file": self.vessel_file,
            "vessel_numbers": parameters_of(self.before),
            "recordings": [_recording(trial) for trial in self.trials],
            "date": datetime.now(UTC).date().isoformat(),
            "version": version("shadow-gateway"),
        } | ({"notices": list(self.notices)} if self.notices else {})  # fmt: skip

    def _own_parameters(self, step: LadderStep) -> dict[str, Any]:
        """Numbers of effects that the vessel had already, fitted along."""
        names = {a.effect.name for a in self.before.effects}
        own = {a.effect.name: dict(a.values) for a in step.vessel.effects if a.effect.name in names}
        return {"own_parameters": own} if own else {}

    def next_steps(self, saved: str | None, out: str | None) -> list[str]:
        """Command lines to go on with, the likeliest first.

        saved, out: where the answer and the better vessel file were written; None: they were not
        """
        if self.contradicted:
            return self._steps_to_sensors(saved)
        written = out is not None or not self.diagnosis.best.effects
        kept = saved is not None or (written and self.diagnosis.formula is None)
        save = [] if kept else [f"{self._again} --save diagnosis.json"]
        better, beyond = self._steps_to_better(saved, out), self._steps_beyond_catalogue(saved)
        return [*save, *better, *self._steps_to_more, *beyond]

    @property
    def _vessel(self) -> str:
        return shell_path(self.vessel_file)

    @property
    def _own(self) -> str:
        """The files of effects of one's own, as options."""
        return "".join(f" --effects {shell_path(file)}" for file in self.effect_files)

    @property
    def _again(self) -> str:
        """The same diagnosis once more."""
        return self._again_with()

    def _again_with(self, *more: str) -> str:
        logs = " ".join([*map(shell_path, self.logs), *more])
        return f"shadow diagnose {logs} --vessel {self._vessel}{self.flags}{self._own}"

    @property
    def _steps_to_more(self) -> list[str]:
        """Manoeuvres that would tell more, and the diagnosis with what they bring."""
        manoeuvre = (self.diagnosis.next_manoeuvre or "").partition(",")[0]
        excitations = [manoeuvre] if manoeuvre in BY_NAME else []
        excitations += [s.excitation for s in self.separations.values()]
        plan = f"shadow plan --vessel {self._vessel}{self._own}"
        able = [n for n in dict.fromkeys(excitations) if n != SPIN or self.before.turns_on_the_spot]
        plans = [f"{plan} --excitation {name}" for name in able]
        return [*plans, self._again_with("THE_NEW_LOG")] if plans else []

    def _add(self, names: Sequence[str], saved: str | None, out: str) -> str:
        """What puts effects into a vessel file."""
        source = shell_path(saved or "diagnosis.json")
        return (f"shadow add {' '.join(names)} --vessel {self._vessel} --from {source} "
                f"--out {out}{self._own}")  # fmt: skip

    @property
    def _better(self) -> str:
        """The vessel file that is suggested, with what predicts best."""
        kind = "better" if self.diagnosis.curve is None else "curve"
        return f"{Path(self.vessel_file).stem}-{kind}.toml"

    def _steps_to_sensors(self, saved: str | None) -> list[str]:
        """Where sensors contradict one another: no effect of the boat's is told, but what such a
        sensor does.
        """
        curve = self.diagnosis.curve
        steps = [f"shadow info {shell_path(log)}{self.flags}" for log in self.logs]
        if curve is None:
            return steps
        save = [] if saved else [f"{self._again} --save diagnosis.json"]
        return [*steps, *save, self._add(curve.effects[-1:], saved, shell_path(self._better))]

    def _steps_to_better(self, saved: str | None, out: str | None) -> list[str]:
        """From what predicts best to a better vessel file, and to the proof on another recording.

        Where that is a curve, effects which help, but not enough, are in it, or are not offered.
        """
        better = shell_path(out or self._better)
        steps, effects = [], self.diagnosis.best.effects
        if effects and not out:
            steps.append(self._add(effects, saved, better))
        if effects or (out and self.improves):
            refit = " --refit voyage" if self.voyage_effects else ""
            both = f"--vessel {self._vessel} --vessel {better}"
            steps.append(f"shadow compare ANOTHER_LOG {both}{refit}{self.flags}{self._own}")
        elif self._can_identify and not out:
            logs = " ".join(map(shell_path, self.logs))
            fit = f"shadow identify {logs} --vessel {self._vessel} --out {better}"
            steps.append(f"{fit}{self.flags}{self._own}")
        return steps

    def _steps_beyond_catalogue(self, saved: str | None) -> list[str]:
        """The file of an effect of one's own, for what the catalogue does not hold."""
        curve, steps = self.diagnosis.curve, []
        if curve is not None and self.diagnosis.formula is not None:
            source = shell_path(saved or "diagnosis.json")
            steps.append(f"shadow effects {curve.effects[-1]} --write own.py --from {source}")
        elif self.diagnosis.verdict is Verdict.UNKNOWN:
            on = next((d.on for d in self.diagnosis.depends_on), "")
            like = curve.vessel.effects[-1].effect.pattern if curve is not None else ""
            pattern = like or pattern_for(on)
            steps.append(f"shadow effects {pattern} --write own.py  # a pattern: put your law in")
        else:
            return steps
        return [*steps, f"{self._again} --effects own.py"]


def pattern_for(depends_on: str) -> str:
    """Name of the effect whose file is the pattern for one that depends on this variable."""
    patterns = {on: effect.name for effect in EFFECTS for on in effect.pattern_for}
    return patterns.get(depends_on, patterns[DEFAULT_PATTERN])


def _parameters_by_recording(step: LadderStep, trials: Sequence[Trial]) -> dict[str, Any]:
    """Parameters of a step; of those that each recording has for itself, the first one's apart."""
    parameters: dict[str, dict[str, Any]] = {}
    others: dict[str, dict[str, Any]] = {}
    for effect, estimates in step.parameters.items():
        for e in estimates:
            key = e.name.rpartition(".")[2]
            entry = {"value": e.value, "ci95": list(e.ci95), "unit": e.unit}
            if e.trial in (None, trials[0].name):
                doubt = {"doubt": e.doubt} if e.doubt else {}
                parameters.setdefault(effect, {}).setdefault(key, entry | doubt)
            else:
                others.setdefault(e.trial, {})[e.name] = entry
    return {"parameters": parameters} | ({"parameters_of_recordings": others} if others else {})


def _recording(trial: Trial) -> dict[str, Any]:
    day = date_of(trial)
    return {
        "name": trial.name,
        **({"date": day} if day else {}),
        "seconds": float(trial.usable.sum()) * trial.dt,
    }


def diagnose_logs(
    logs: Sequence[str | Path],
    vessel: str | Path,
    *,
    improve: bool = True,
    prior: float | None = None,
    settings: DiagnoseSettings | None = None,
    options: TrialOptions = DIAGNOSIS_TRIALS,
    effects: Iterable[Effect] = (),
    chosen: Callable[[Trial], Trial] = lambda trial: trial,
    progress: Progress = lambda text: None,
) -> DiagnosisResult:
    """Diagnose all recordings at once; `improve` adds effects until no further one is justified.

    `chosen`: what of each trial is to be usable. `prior`: share by which the base numbers may be
    off; None: `GUESSED_PRIOR` where the vessel file says that they were guessed, else that of the
    settings.
    """
    settings = settings or DiagnoseSettings(effects=known_effects())
    more = tuple(effects)
    settings = replace(settings, effects=(*settings.effects, *more))
    guessed = prior is None and read_vessel_file(vessel).guessed
    if prior is not None:
        settings = replace(settings, prior=prior, trusted=True)
    elif guessed:
        settings = replace(settings, prior=GUESSED_PRIOR)
    if not improve:
        settings = replace(settings, most=1)
    boat = load_vessel(vessel, more)
    trials, diagnosis = diagnose_trials(
        logs, boat, settings, file=vessel, options=options, chosen=chosen, progress=progress
    )
    notice = (
        f"{Path(vessel).name}: its base numbers were guessed: they may be off by as much again "
        "(--prior says else)"
    )
    notices = (
        *([notice] if guessed else []), *notices_of(trials, boat),
        *concentrated_error(diagnosis, trials),
    )  # fmt: skip
    return DiagnosisResult(
        diagnosis, boat, tuple(trials), tuple(map(str, logs)), str(vessel), notices,
        flags=options.flags,
    )  # fmt: skip


def diagnose_trials(
    logs: Sequence[str | Path],
    boat: Vessel,
    settings: DiagnoseSettings,
    *,
    file: str | Path | None = None,
    options: TrialOptions = DIAGNOSIS_TRIALS,
    chosen: Callable[[Trial], Trial] = lambda trial: trial,
    progress: Progress = lambda text: None,
) -> tuple[list[Trial], Diagnosis]:
    """Trials with usable time, and their diagnosis; BadInput where there can be none.

    `file`: where the vessel was read from; `chosen`: see `diagnose_logs`.
    """
    names = ", ".join(str(log) for log in logs)
    with compiled_ahead(kernels_of_a_diagnosis(boat, settings.effects)):
        trials = [chosen(trial) for trial in usable_trials(logs, options, progress)]
        return trials, diagnosed_trials(trials, boat, settings, names, progress, file)


def diagnosed_trials(
    trials: Sequence[Trial],
    boat: Vessel,
    settings: DiagnoseSettings,
    names: str,
    progress: Progress = lambda text: None,
    file: str | Path | None = None,
) -> Diagnosis:
    """The diagnosis of trials; BadInput, which begins with `names`, where there can be none."""
    try:
        with numerical_errors(names, file or boat.name), ThreadPoolExecutor(WORKERS) as pool:
            return diagnose(trials, boat, settings, progress, pool.map)
    except NoUsableTimeError as error:
        raise BadInput(f"{names}: {error}") from None
    except DivergedError as error:
        raise BadInput(f"{file or names}: {error}") from None


def save_diagnosis(
    found: DiagnosisResult,
    *,
    save: Path | None = None,
    out: Path | None = None,
    pictures: Path | None = None,
    effects: Iterable[Effect] = (),
    progress: Progress = lambda text: None,
) -> None:
    """Write what is named; no vessel file where there is nothing better to write."""
    if save is not None:
        save_json(found.to_dict(), save)
    if pictures is not None:
        progress("pictures")
        save_figures(diagnosis_figures(found.diagnosis, found.trials), pictures)
    if out is not None and found.improves:
        diagnosis = DiagnosisFile.model_validate(found.to_dict())
        names, source = found.diagnosis.best.effects, save or "the diagnosis"
        add_from_diagnosis(names, found.vessel_file, diagnosis, source, out, effects)


def save_json(diagnosis: Mapping[str, Any], path: str | Path) -> None:
    """Write diagnosis.json, whole or not at all."""
    write_whole(Path(path), result_json(diagnosis), "the diagnosis")
