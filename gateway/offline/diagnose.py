"""A diagnosis with what it was made from: as JSON, as a vessel file, as the next command lines.

Recordings and a vessel file -> what is missing from the vessel, kept as JSON, vessel, pictures.

read → diagnose → diagnosis.json, the better vessel file, pictures

What is kept of a diagnosis: its JSON, the better vessel file, its pictures.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from shlex import quote
from typing import Any

import orjson

from gateway.atomic_file import write_whole
from gateway.errors import BadInput, numerical_errors
from gateway.figures.diagnosis import diagnosis_figures
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.add import DiagnosisFile, added
from gateway.offline.compare import PICTURE, file_name
from gateway.offline.trials import TrialOptions, usable_trials
from gateway.offline.usable import notices_of
from gateway.user_effects import known_effects
from gateway.vessel_file import load_vessel, read_vessel_file
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.diagnosis.next_experiment import separations
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Scope, Separation
from sim.excitation.catalogue import BY_NAME
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel

ANYTHING = "always"  # the group of terms whose pattern serves where no other is declared


@dataclass(frozen=True)
class Diagnosed:
    """The answer, the vessel as it was given, and the recordings."""

    diagnosis: Diagnosis
    before: Vessel
    trials: tuple[Trial, ...]
    logs: tuple[str, ...]
    vessel_file: str
    notices: tuple[str, ...] = ()

    @property
    def rivals(self) -> list[str]:
        """All effects that take part in a confusion, the chosen ones first."""
        tied = [c.effect for c in self.diagnosis.ranking if c.confounded_with]
        return tied if self.diagnosis.verdict is Verdict.CONFOUNDED else []

    @property
    def separations(self) -> dict[tuple[str, str], Separation]:
        """What would tell these apart, pair by pair."""
        return separations(self.rivals)

    @property
    def improves(self) -> bool:
        """Whether there is a vessel to write that is better than the one given."""
        return bool(self.diagnosis.effects) or self.diagnosis.base_changed

    @property
    def of_voyages(self) -> list[str]:
        """Effects found that mean nothing on another day."""
        added = self.diagnosis.vessel.effects
        return [a.effect.name for a in added if a.effect.scope is Scope.VOYAGE]

    def to_dict(self) -> dict[str, Any]:
        """What `shadow diagnose --json` prints and `shadow add --from` reads."""
        answer = self.diagnosis.to_dict()
        rungs = (*self.diagnosis.ladder, *self.diagnosis.alternatives)
        for rung, told in zip(rungs, answer["ladder"] + answer["alternatives"], strict=True):
            told |= _first_recording(rung, self.trials) | self._own(rung)
        if answer["next_manoeuvre"] is None and self.separations:
            answer["next_manoeuvre"] = next(iter(self.separations.values())).says
        return answer | {
            "vessel_file": self.vessel_file,
            "recordings": [_recording(trial) for trial in self.trials],
            "date": datetime.now(UTC).date().isoformat(),
            "version": version("shadow-gateway"),
        } | ({"notices": list(self.notices)} if self.notices else {})  # fmt: skip

    def _own(self, rung: LadderStep) -> dict[str, Any]:
        """Numbers of effects that the vessel had already, fitted along."""
        had = {a.effect.name for a in self.before.effects}
        own = {a.effect.name: dict(a.values) for a in rung.vessel.effects if a.effect.name in had}
        return {"own_parameters": own} if own else {}

    @property
    def _excitations(self) -> list[str]:
        """Manoeuvres of `shadow plan` that would tell more, the best first."""
        said = (self.diagnosis.next_manoeuvre or "").partition(",")[0]
        return [*([said] if said in BY_NAME else []),
                *(s.excitation for s in self.separations.values())]  # fmt: skip

    def next_steps(self, saved: str | None, out: str | None) -> list[str]:
        """Command lines to go on with, the likeliest first."""
        vessel, logs = quote(self.vessel_file), " ".join(map(quote, self.logs))
        better = quote(out or _better(self.vessel_file))
        plan = [f"shadow plan --vessel {vessel} --excitation {name}" for name in self._excitations]
        found, steps = self.diagnosis.effects, []
        if found and not out:
            if saved is None:
                steps.append(f"shadow diagnose {logs} --vessel {vessel} --save diagnosis.json")
            source = quote(saved or "diagnosis.json")
            steps.append(f"shadow add {' '.join(found)} --vessel {vessel} --from {source} "
                         f"--out {better}")  # fmt: skip
        if found:
            refit = " --refit voyage" if self.of_voyages else ""
            steps.append(f"shadow compare ANOTHER_LOG --vessel {vessel} --vessel {better}{refit}")
        elif self.diagnosis.base_changed and not out:
            steps.append(f"shadow identify {logs} --vessel {vessel} --out {better}")
        if self.diagnosis.verdict is Verdict.UNKNOWN:
            on = next((d.on for d in self.diagnosis.depends_on), "")
            steps.append(f"shadow effects {pattern_for(on)} --write own.py")
            steps.append(f"shadow diagnose {logs} --vessel {vessel} --effects own.py")
        return [*dict.fromkeys(plan), *steps]


def pattern_for(depends_on: str) -> str:
    """Name of the effect whose file is the pattern for one that depends on this (one of `SAYS`)."""
    found = {on: effect.name for effect in EFFECTS for on in effect.pattern_for}
    return found.get(depends_on, found[ANYTHING])


def save_json(found: Mapping[str, Any], path: str | Path) -> None:
    """Write diagnosis.json; one line where that cannot be."""
    options = orjson.OPT_INDENT_2 | orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE
    write_whole(Path(path), orjson.dumps(found, option=options), "the diagnosis")


def check_folders(*files: Path | None) -> None:
    """Long work must not end at a folder that is not there."""
    for file in files:
        if file is not None and not file.resolve().parent.is_dir():
            raise BadInput(f"{file}: no such folder: {file.resolve().parent}")


def _first_recording(rung: LadderStep, trials: Sequence[Trial]) -> dict[str, Any]:
    """Of a number that each recording has for itself, the vessel holds that of the first."""
    kept: dict[str, dict[str, Any]] = {}
    others: dict[str, dict[str, Any]] = {}
    for effect, numbers in rung.parameters.items():
        for e in numbers:
            key = e.name.rpartition(".")[2]
            told = {"value": e.value, "ci95": list(e.ci95), "unit": e.unit}
            if e.trial in (None, trials[0].name):
                doubt = {"doubt": e.doubt} if e.doubt else {}
                kept.setdefault(effect, {}).setdefault(key, told | doubt)
            else:
                others.setdefault(e.trial, {})[e.name] = told
    return {"parameters": kept} | ({"parameters_of_recordings": others} if others else {})


def _recording(trial: Trial) -> dict[str, Any]:
    day = datetime.fromtimestamp(trial.start_time_ns * 1e-9, UTC).date().isoformat()
    return {"name": trial.name, "date": day, "seconds": float(trial.usable.sum()) * trial.dt}


def _better(vessel_file: str) -> str:
    """boat.toml -> boat-better.toml, where the user is."""
    return f"{Path(vessel_file).stem}-better.toml"


Tell = Callable[[str], None]

# Means over 0.4 s are compared: a finer grid costs three times as much and tells no more.
COARSE = TrialOptions(rate_hz=5.0)
WILD = 1.0  # share that base numbers which were guessed may be off by
WORKERS = 2  # the compiled kernels leave the interpreter to others


def diagnosed(
    logs: Sequence[str | Path],
    vessel: str | Path,
    *,
    improve: bool = True,
    prior: float | None = None,
    settings: DiagnoseSettings | None = None,
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    effects: Iterable[Effect] = (),
    tell: Tell = lambda _: None,
) -> Diagnosed:
    """All recordings at once; `improve` climbs until nothing more is justified, else one step.

    `prior`: share that the base numbers may be off by; None: as much again where the vessel file
    says that they were guessed, else that of the settings. The answer comes with what it was made
    from: for pictures, files and command lines to go on.
    """
    settings = settings or DiagnoseSettings(effects=known_effects())
    more = tuple(effects)
    settings = replace(settings, effects=(*settings.effects, *more))
    guessed = prior is None and read_vessel_file(vessel).guessed
    if prior is not None or guessed:
        settings = replace(settings, prior=WILD if prior is None else prior)
    if not improve:
        settings = replace(settings, most=1)
    boat = load_vessel(vessel, more)
    trials, found = answered(
        logs, boat, settings, file=vessel, system=system, options=options, mapping=mapping,
        tell=tell,
    )  # fmt: skip
    says = f"{Path(vessel).name}: its base numbers were guessed: they may be off by as much again"
    notices = (*([f"{says} (--prior says else)"] if guessed else []), *notices_of(trials, boat))
    return Diagnosed(found, boat, tuple(trials), tuple(map(str, logs)), str(vessel), notices)


def answered(
    logs: Sequence[str | Path],
    boat: Vessel,
    settings: DiagnoseSettings,
    *,
    file: str | Path | None = None,
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
    tell: Tell = lambda _: None,
) -> tuple[list[Trial], Diagnosis]:
    """Trials with usable time, and the answer; BadInput where there can be none.

    `file`: where the vessel was read from.
    """
    names = ", ".join(str(log) for log in logs)
    trials = usable_trials(logs, system, options or COARSE, mapping, tell)
    try:
        with numerical_errors(names, file or boat.name), ThreadPoolExecutor(WORKERS) as pool:
            return trials, diagnose(trials, boat, settings, tell, pool.map)
    except NoUsableTimeError as problem:
        raise BadInput(f"{names}: {problem}") from None
    except DivergedError as problem:
        raise BadInput(f"{file or names}: {problem}") from None


def kept(
    found: Diagnosed,
    *,
    save: Path | None = None,
    out: Path | None = None,
    pictures: Path | None = None,
    effects: Iterable[Effect] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> None:
    """Write what was asked for; no vessel file where there is nothing better to write."""
    if save is not None:
        save_json(found.to_dict(), save)
    if pictures is not None:
        tell("pictures")
        save_pictures(found, pictures)
    if out is not None and found.improves:
        told = DiagnosisFile.model_validate(found.to_dict())
        names = found.diagnosis.effects
        added(names, found.vessel_file, told, save or "the diagnosis", out, effects)


def save_pictures(found: Diagnosed, folder: Path) -> list[Path]:
    """All pictures into a folder."""
    pictures = diagnosis_figures(found.diagnosis, found.trials)
    return [
        save_figure(figure, folder / f"{file_name(name)}{PICTURE}")
        for name, figure in pictures.items()
    ]
