"""Recordings and a vessel file -> what is missing from the vessel, kept as JSON, vessel, pictures.

read → diagnose → diagnosis.json, the better vessel file, pictures
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from gateway.effect_files import known_effects
from gateway.errors import BadInput
from gateway.pipelines.diagnosed import Diagnosed
from gateway.pipelines.notices import notices_of
from gateway.pipelines.trials import TrialOptions, usable_trials
from gateway.vessel_file import load_vessel, read_vessel_file
from sim.diagnosis.answer import Diagnosis
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.effects.effect import Effect
from sim.prediction.free_runs import DivergedError
from sim.prediction.segments import NoUsableTimeError
from sim.trial import Trial
from sim.vessel import Vessel

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
        with ThreadPoolExecutor(WORKERS) as pool:
            return trials, diagnose(trials, boat, settings, tell, pool.map)
    except NoUsableTimeError as problem:
        raise BadInput(f"{names}: {problem}") from None
    except DivergedError as problem:
        raise BadInput(f"{file or names}: {problem}") from None
