"""`shadow add`: effects of a diagnosis into a vessel file, with the base fitted along with them."""

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.toml_file import explain
from gateway.user_effects import known_effects
from gateway.vessel_file import (
    listed,
    load_vessel,
    of_fitted_areas,
    read_vessel_file,
    revised,
    same_number,
    vessel_tables,
    which_effect,
)
from gateway.vessel_tables import AREAS_KEY, Listed, Provenance, VesselFile, Word
from sim.diagnosis.answer import Verdict
from sim.effects.effect import Effect
from sim.effects.tables import Formula
from sim.identification import AREAS, updated_vessel
from sim.model import parameters_of
from sim.vessel import AddedEffect, Vessel

MOST_TOLD = 3  # numbers that differ


class Entry(BaseModel):
    """A part of diagnosis.json that is read here; its other keys are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class NumberEntry(Entry):
    """A parameter with its interval."""

    value: float
    ci95: tuple[float, float]
    unit: str = ""
    doubt: Listed = ""


class StepEntry(Entry):
    """One step of the ladder, or an alternative to it."""

    effects: tuple[str, ...]
    base: str
    heldout_nrmse: float
    left_out_nrmse: float | None = None
    alike: tuple[str, ...] = ()
    base_parameters: dict[str, NumberEntry] = Field(default_factory=dict)
    parameters: dict[str, dict[str, NumberEntry]] = Field(default_factory=dict)
    own_parameters: dict[str, dict[str, float]] = Field(default_factory=dict)


class RecordingEntry(Entry):
    """A recording that the diagnosis was made from."""

    name: str
    date: Word = ""


class FormulaEntry(Entry):
    """A short law that does as well as the curve of what no effect explains."""

    form: str
    text: str
    numbers: dict[str, float]
    table: dict[str, float]


class DiagnosisFile(Entry):
    """diagnosis.json, as `shadow diagnose --save` (or --json) writes it.

    vessel_numbers  of the vessel as it was diagnosed; files of older versions have none
    """

    vessel: str
    verdict: Word = ""
    vessel_numbers: dict[str, float] = Field(default_factory=dict)
    effects: tuple[str, ...]
    ladder: tuple[StepEntry, ...] = Field(min_length=1)
    alternatives: tuple[StepEntry, ...] = ()
    curve: StepEntry | None = None
    formula: FormulaEntry | None = None
    recordings: tuple[RecordingEntry, ...] = ()
    version: Word = ""


@dataclass(frozen=True)
class AdditionResult:
    """The better vessel, the numbers that are new in it, and the error before and after.

    left_out  error on each recording by a fit without it; None of fewer than three
    not_enough  the answer was that nothing in the catalogue is it, and these are of the catalogue
    """

    vessel: Vessel
    effects: Mapping[str, Mapping[str, NumberEntry]]
    before: float
    after: float
    recordings: tuple[str, ...]
    left_out: float | None = None
    not_enough: bool = False

    def to_dict(self) -> dict[str, object]:
        """The new numbers with their intervals, errors on unseen time before and after."""
        return {
            "vessel": self.vessel.name,
            "effects": {
                effect: {key: entry.model_dump() for key, entry in numbers.items()}
                for effect, numbers in self.effects.items()
            },
            "heldout_nrmse_before": self.before,
            "heldout_nrmse_after": self.after,
            "recordings": list(self.recordings),
        } | ({} if self.left_out is None else {"left_out_nrmse": self.left_out})


def add_effects(
    names: Sequence[str],
    vessel: str | Path,
    source: str | Path,
    out: str | Path,
    more: Iterable[Effect] = (),
) -> AdditionResult:
    """Write the vessel with these effects, as fitted on the ladder or in an alternative."""
    return add_from_diagnosis(names, vessel, read_diagnosis(source), source, out, more)


def add_from_diagnosis(
    names: Sequence[str],
    vessel: str | Path,
    diagnosis: DiagnosisFile,
    source: str | Path,
    out: str | Path,
    more: Iterable[Effect] = (),
) -> AdditionResult:
    """The same from a diagnosis that is read already; without names: the re-fitted base alone."""
    own = tuple(more)
    boat, file = load_vessel(vessel, own), read_vessel_file(vessel)
    if differs := _another_vessel(diagnosis, boat):
        raise BadInput(
            f"{source}: it is about {diagnosis.vessel}, {vessel} {differs}: give the vessel file "
            "that was diagnosed"
        )
    known = {effect.name: effect for effect in (*known_effects(), *own)}
    step = _step_with(names, diagnosis, source, known)
    better = _with_numbers(boat, step, known, vessel)
    recordings = listed(r.name for r in diagnosis.recordings)
    history = revised(file, boat, better, "shadow add", recordings)
    tables = vessel_tables(better, file.provenance | _provenance(step, diagnosis), history)
    files = _effect_files(file, own, Path(vessel), Path(out))
    for entry in tables.get("effects", ()):
        if entry["type"] in files:
            entry["file"] = files[entry["type"]]
    write_whole(Path(out), tomli_w.dumps(tables).encode(), "the vessel file")
    return AdditionResult(
        better, step.parameters, diagnosis.ladder[0].heldout_nrmse, step.heldout_nrmse,
        tuple(r.name for r in diagnosis.recordings), step.left_out_nrmse,
        diagnosis.verdict == Verdict.UNKNOWN and not any(known[n].is_curve for n in names),
    )  # fmt: skip


def _another_vessel(diagnosis: DiagnosisFile, boat: Vessel) -> str:
    """What tells that a vessel is not the one that was diagnosed; empty: nothing.

    Effects that it has beside the diagnosed vessel's are its owner's.
    """
    if diagnosis.vessel != boat.name:
        return f"is {boat.name}"
    numbers = parameters_of(boat)
    other = [
        f"{name} {numbers[name]:g} instead of {value:g}" if name in numbers else f"no {name}"
        for name, value in diagnosis.vessel_numbers.items()
        if name not in numbers or not same_number(numbers[name], value)
    ]
    more = f" and {len(other) - MOST_TOLD} more" if len(other) > MOST_TOLD else ""
    return f"has {', '.join(other[:MOST_TOLD])}{more}" if other else ""


def read_diagnosis(source: str | Path) -> DiagnosisFile:
    """diagnosis.json, checked; BadInput with one line where it is none."""
    try:
        return DiagnosisFile.model_validate_json(Path(source).read_bytes())
    except OSError as error:
        raise BadInput(f"{source}: cannot read the diagnosis: {error.strerror}") from None
    except ValidationError as error:
        kinds = {mistake["type"] for mistake in error.errors()}
        mistake = "not JSON" if "json_invalid" in kinds else explain(error)
        raise BadInput(
            f"{source}: {mistake}: expected what `shadow diagnose LOG --vessel V --save FILE` "
            "writes"
        ) from None


def formula_in(source: str | Path) -> tuple[Mapping[str, float], Formula]:
    """The table and the formula of a diagnosis; BadInput where it holds none."""
    found = read_diagnosis(source).formula
    if found is None:
        raise BadInput(
            f"{source}: holds no formula: no short law did as well as the curve, or none was "
            "needed; leave out --from for a pattern"
        )
    return found.table, Formula(found.form, found.text, found.numbers, found.table)


def _step_with(
    names: Sequence[str],
    diagnosis: DiagnosisFile,
    source: str | Path,
    known: Mapping[str, Effect],
) -> StepEntry:
    """The last step with exactly these effects, or the alternative; BadInput if there is none."""
    for name in names:
        if name not in known:
            raise BadInput(
                f"no effect named {name!r}: {which_effect(name, known)}; one of your own needs "
                "--effects FILE"
            )
    every = (*diagnosis.alternatives, *diagnosis.ladder)
    if not names and all(s.base != "refitted" for s in every if not s.effects):
        raise BadInput(f"{source}: it kept the base as it is: there is nothing to add")
    steps = [s for s in every if set(s.effects) == set(names) and s.base == "refitted"]
    if steps:
        return steps[-1]
    fitted = dict.fromkeys(" ".join(s.effects) for s in reversed(every) if s.effects)
    listed = " or ".join(f"`{effects}`" for effects in fitted) or "no effect at all"
    free = " ".join(f"--free '{name}.*'" for name in names)
    raise BadInput(
        f"{source}: it holds no numbers of {' with '.join(names)} (those it holds: {listed}): "
        f"put it into the vessel file as `shadow effects {names[0]}` shows, then "
        f"shadow identify LOG --vessel V {free} --out V2"
    )


def _with_numbers(
    boat: Vessel, step: StepEntry, known: Mapping[str, Effect], vessel: str | Path
) -> Vessel:
    """The vessel with the effects and numbers of a step."""
    twice = {added.effect.name for added in boat.effects} & set(step.effects)
    if twice:
        raise BadInput(f"{vessel}: has {', '.join(sorted(twice))} already: diagnose it as it is")
    values = {name: number.value for name, number in step.base_parameters.items()}
    values |= {f"{e}.{key}": v for e, own in step.own_parameters.items() for key, v in own.items()}
    try:
        effects = [
            AddedEffect(
                known[name].of_the_boat if name in step.alike else known[name],
                {k: n.value for k, n in step.parameters[name].items()},
            )
            for name in step.effects
        ]
        return updated_vessel(boat, values).with_effects(*effects)
    except (KeyError, ValueError, TypeError) as error:
        reason = f"no numbers for {error}" if isinstance(error, KeyError) else str(error)
        raise BadInput(f"{vessel}: the diagnosis does not fit this vessel: {reason}") from None


def _provenance(step: StepEntry, diagnosis: DiagnosisFile) -> dict[str, Provenance]:
    """Where each number came from: recordings, date, version, interval, doubt."""
    common: dict[str, Any] = {
        "recording": listed(r.name for r in diagnosis.recordings),
        "date": diagnosis.recordings[0].date if diagnosis.recordings else "",
        "version": diagnosis.version,
        "fit": " ".join(["shadow diagnose", *step.effects]),
    }
    base = dict(step.base_parameters)
    areas = {name: base.pop(name) for name in AREAS if name in base}
    numbers = {f"dynamics.{name}": n for name, n in base.items()}
    numbers |= {f"{e}.{key}": n for e, own in step.parameters.items() for key, n in own.items()}
    out = {
        key: Provenance(**common, value=n.value, ci95=n.ci95, says=n.doubt)
        for key, n in numbers.items()
    }
    if areas:
        intervals, doubts = {k: n.ci95 for k, n in areas.items()}, [n.doubt for n in areas.values()]
        out[AREAS_KEY] = Provenance(**common, says=of_fitted_areas(intervals, doubts))
    return out


def _effect_files(
    file: VesselFile, own: Iterable[Effect], vessel: Path, out: Path
) -> dict[str, str]:
    """Effects that come from a Python file -> its path as seen from the new vessel file.

    Files outside of its folder are left out: a vessel file cannot name them.
    """
    paths = {
        str(entry["type"]): vessel.parent / str(entry["file"])
        for entry in file.effects
        if "file" in entry
    }
    paths |= {e.name: Path(inspect.getfile(next(iter(e.laws.values())))) for e in own}
    folder = out.resolve().parent
    return {
        name: str(path.resolve().relative_to(folder))
        for name, path in paths.items()
        if path.resolve().is_relative_to(folder)
    }
