"""What it takes to judge one answer: fits by somebody who knows, and errors on another voyage.

    DIR/oracle/NAME.json      depends on the case alone
    DIR/judged/BY/NAME.json   depends on what the diagnosis said

`score` makes tables of them.
"""

import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.hidden.cases import COMPLETE, LOG, VESSEL
from benchmarks.hidden.oracle import armed_at, fitted, nrmse, shifted, with_effects
from benchmarks.hidden.run import (
    DIAGNOSIS,
    Tell,
    in_workers,
    label,
    read_json,
    result_of,
    twin_of,
    write_json,
)
from benchmarks.hidden.twins import on_another_day
from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import named
from sim.identification import updated_vessel
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel


def judge(names: Sequence[str], out: Path, workers: int, tell: Tell, by: str = DIAGNOSIS) -> None:
    """All that has a result and is not judged yet."""
    ready = [name for name in names if result_of(name, out, by).exists()]
    oracles = [n for n in ready if not (out / "oracle" / f"{n}.json").exists()]
    in_workers(known, [(name, out) for name in oracles], workers, tell)
    todo = [n for n in ready if not judgement_of(n, out, by).exists()]
    in_workers(judged, [(name, out, by) for name in todo], workers, tell)


def judgement_of(name: str, out: Path, by: str = DIAGNOSIS) -> Path:
    """Where a judgement is kept."""
    return out / "judged" / label(by) / f"{name}.json"


def known(name: str, out: Path) -> str:
    """Errors and numbers that somebody reaches who knows what is hidden."""
    answer, (trial, plain) = read_json(out / "answers" / f"{name}.json"), question(name, out)
    try:
        without = out / "answers" / name / COMPLETE
        complete = load_trials(without)[0] if without.exists() else None
        said = oracle_of(answer, trial, plain, complete)
    except Exception:  # counted in the table, and the others go on
        said = {"error": traceback.format_exc()}
    write_json(out / "oracle" / f"{name}.json", said)
    return f"{name} fitted by who knows: gain {said.get('gain', float('nan')):.2f}"


def oracle_of(
    answer: Mapping[str, Any], trial: Trial, plain: Vessel, complete: Trial | None = None
) -> dict[str, Any]:
    """Errors of the plain vessel, of its re-fit, and with the true effects; what each is worth.

    `complete` is the same voyage without a stranger: what is left there is noise.
    """
    refit = fitted(trial, plain).vessel
    before, left = nrmse(trial, [plain, refit])
    said: dict[str, Any] = {"plain": before, "refit": left, "armed_s": armed_at(trial)}
    if complete is not None:
        said["complete"] = nrmse(complete, [plain, fitted(complete, plain).vessel])[1]
    if answer["unknown"] or not answer["effects"]:
        return {**said, "refit_vessel": numbers_of(refit)}
    true = fitted(trial, with_effects(plain, answer["values"], trial))
    best = nrmse(trial, [plain, true.vessel])[1]
    said |= {
        "oracle": best,
        "gain": left / best,
        "parameters": {e.name: {"value": e.value, "ci95": list(e.ci95)} for e in true.estimates},
        "truth": {item["type"]: _truth(item, trial) for item in answer["values"]},
        "refit_vessel": numbers_of(true.vessel),
    }
    if len(answer["values"]) > 1:  # what each is worth on top of the others
        without = {
            item["type"]: [other for other in answer["values"] if other is not item]
            for item in answer["values"]
        }
        said["worth"] = {
            name: nrmse(trial, [plain, fitted(trial, with_effects(plain, rest, trial)).vessel])[1]
            / best
            for name, rest in without.items()
        }
    return said


def judged(name: str, out: Path, by: str) -> str:
    """Errors on the other voyage: the vessel as given, as found, and by who knew."""
    answer, result = (
        read_json(out / "answers" / f"{name}.json"),
        read_json(result_of(name, out, by)),
    )
    oracle, plain = read_json(out / "oracle" / f"{name}.json"), question(name, out)[1]
    said: dict[str, Any] = {}
    try:
        if "diagnosis" in result and "error" not in oracle:
            found = improved(plain, result["diagnosis"])
            knew = with_numbers(plain, oracle["refit_vessel"])
            twin = load_trials(twin_of(name, out))[0]
            errors = on_another_day(twin, [plain, found, knew], answer["twin_values"])
            said = dict(zip(("before", "after", "oracle"), errors, strict=True))
    except Exception:  # counted in the table, and the others go on
        said = {"error": traceback.format_exc()}
    write_json(judgement_of(name, out, by), said)
    return f"{name} judged"


def question(name: str, out: Path) -> tuple[Trial, Vessel]:
    """The diagnosed voyage and the vessel file that came with it."""
    folder = out / "questions" / name
    return load_trials(folder / LOG)[0], load_vessel(folder / VESSEL)


def improved(vessel: Vessel, diagnosis: Mapping[str, Any]) -> Vessel:
    """The vessel that a diagnosis ends with: the last step of its ladder that it stands by."""
    named_effects = set(diagnosis["effects"])
    steps = [s for s in diagnosis["ladder"] if set(s["effects"]) == named_effects]
    if not steps:
        return vessel
    step = steps[-1]
    if not step["effects"] and not diagnosis.get("base_changed"):
        return vessel
    base = {k: v["value"] for k, v in step.get("base_parameters", {}).items()}
    effects = {
        effect: {k: v["value"] for k, v in values.items()}
        for effect, values in step.get("parameters", {}).items()
    }
    return with_numbers(vessel, {"base": base, "effects": effects})


def with_numbers(vessel: Vessel, numbers: Mapping[str, Any]) -> Vessel:
    """Base parameters by name, effects by type."""
    added = [AddedEffect(named(name), values) for name, values in numbers["effects"].items()]
    return updated_vessel(vessel, numbers["base"]).with_effects(*added)


def numbers_of(vessel: Vessel) -> dict[str, Any]:
    """The other way round."""
    return {
        "base": {k: v for k, v in vars(vessel.dynamics).items() if v},
        "effects": {added.effect.name: dict(added.values) for added in vessel.effects},
    }


def _truth(item: Mapping[str, Any], trial: Trial) -> dict[str, float]:
    """True parameters in the trial's own time."""
    values = {key: float(value) for key, value in item.items() if key != "type"}
    return shifted(values, armed_at(trial))
