"""Effects from diagnosis.json into a vessel file, with the base that was fitted along with them."""

import inspect
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gateway.atomic_file import write_whole
from gateway.errors import BadInput
from gateway.user_effects import known_effects
from gateway.vessel_file import (
    Provenance,
    VesselFile,
    explain,
    load_vessel,
    read_vessel_file,
    vessel_tables,
)
from sim.effects.effect import Effect
from sim.identification.vessel_update import applied
from sim.vessel import AddedEffect, Vessel


class Loose(BaseModel):
    """What is asked of diagnosis.json; whatever else it holds is its own business."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class Number(Loose):
    """A parameter with its interval."""

    value: float
    ci95: tuple[float, float]
    unit: str = ""
    doubt: str = ""


class Step(Loose):
    """One rung of the ladder."""

    effects: tuple[str, ...]
    base: str
    heldout_nrmse: float
    base_parameters: dict[str, Number] = Field(default_factory=dict)
    parameters: dict[str, dict[str, Number]] = Field(default_factory=dict)
    own_parameters: dict[str, dict[str, float]] = Field(default_factory=dict)


class Recorded(Loose):
    """A recording that the diagnosis was made from."""

    name: str
    date: str = ""


class DiagnosisFile(Loose):
    """diagnosis.json, as `shadow diagnose --save` (or --json) writes it."""

    vessel: str
    effects: tuple[str, ...]
    ladder: tuple[Step, ...] = Field(min_length=1)
    alternatives: tuple[Step, ...] = ()
    recordings: tuple[Recorded, ...] = ()
    version: str = ""


@dataclass(frozen=True)
class Added:
    """The better vessel, the numbers that are new in it, and the error before and after."""

    vessel: Vessel
    effects: Mapping[str, Mapping[str, Number]]
    before: float
    after: float
    recordings: tuple[str, ...]


def add_effects(
    names: Sequence[str],
    vessel: str | Path,
    source: str | Path,
    out: str | Path,
    more: Iterable[Effect] = (),
) -> Added:
    """The vessel with these effects and numbers as on the ladder's rung of exactly these.

    Or as in the alternative of exactly these: what was ranked, but not chosen.
    """
    return added(names, vessel, read_diagnosis(source), source, out, more)


def added(
    names: Sequence[str],
    vessel: str | Path,
    told: DiagnosisFile,
    source: str | Path,
    out: str | Path,
    more: Iterable[Effect] = (),
) -> Added:
    """The same from a diagnosis that is read already; without names: the re-fitted base alone."""
    own = tuple(more)
    boat, file = load_vessel(vessel, own), read_vessel_file(vessel)
    if told.vessel != boat.name:
        raise BadInput(
            f"{source}: it is about {told.vessel}, {vessel} is {boat.name}: give the vessel file "
            "that was diagnosed"
        )
    known = {effect.name: effect for effect in (*known_effects(), *own)}
    step = _rung(names, told, source, known)
    better = _improved(boat, step, known, vessel)
    origin = file.provenance | _provenance(step, told)
    _write(Path(out), better, origin, _files_of(file, own, Path(vessel), Path(out)))
    recordings = tuple(r.name for r in told.recordings)
    return Added(better, step.parameters, told.ladder[0].heldout_nrmse, step.heldout_nrmse,
                 recordings)  # fmt: skip


def read_diagnosis(source: str | Path) -> DiagnosisFile:
    """diagnosis.json, checked; BadInput with one line where it is none."""
    try:
        return DiagnosisFile.model_validate_json(Path(source).read_bytes())
    except OSError as error:
        raise BadInput(f"{source}: cannot read the diagnosis: {error.strerror}") from None
    except ValidationError as error:
        kinds = {mistake["type"] for mistake in error.errors()}
        says = "not JSON" if "json_invalid" in kinds else explain(error)
        raise BadInput(
            f"{source}: {says}: expected what `shadow diagnose LOG --vessel V --save FILE` writes"
        ) from None


def _rung(
    names: Sequence[str], told: DiagnosisFile, source: str | Path, known: Mapping[str, Effect]
) -> Step:
    """The last step with exactly these effects, or the alternative; one line if there is none."""
    for name in names:
        if name not in known:
            raise BadInput(
                f"no effect named {name!r}: `shadow effects` lists those there are; one of your "
                "own needs --effects FILE"
            )
    every = (*told.alternatives, *told.ladder)
    steps = [s for s in every if set(s.effects) == set(names) and s.base == "refitted"]
    if steps:
        return steps[-1]
    there = [" ".join(s.effects) for s in reversed(every) if s.effects]
    kept = " or ".join(f"`{one}`" for one in dict.fromkeys(there)) or "no effect at all"
    free = " ".join(f"--free '{name}.*'" for name in names)
    raise BadInput(
        f"{source}: it holds no numbers of {' with '.join(names)} (those it holds: {kept}): "
        f"put it into the vessel file as `shadow effects {names[0]}` shows, then "
        f"shadow identify LOG --vessel V {free} --out V2"
    )


def _improved(boat: Vessel, step: Step, known: Mapping[str, Effect], vessel: str | Path) -> Vessel:
    """The vessel with the numbers of a rung."""
    there = {added.effect.name for added in boat.effects}
    twice = there & set(step.effects)
    if twice:
        raise BadInput(f"{vessel}: has {', '.join(sorted(twice))} already: diagnose it as it is")
    values = {name: number.value for name, number in step.base_parameters.items()}
    values |= {f"{e}.{key}": v for e, own in step.own_parameters.items() for key, v in own.items()}
    try:
        added = [
            AddedEffect(known[name], {k: n.value for k, n in step.parameters[name].items()})
            for name in step.effects
        ]
        return applied(boat, values).with_effects(*added)
    except (KeyError, ValueError, TypeError) as error:
        says = f"no numbers for {error}" if isinstance(error, KeyError) else str(error)
        raise BadInput(f"{vessel}: the diagnosis does not fit this vessel: {says}") from None


def _provenance(step: Step, told: DiagnosisFile) -> dict[str, Provenance]:
    """Where each number came from: recordings, date, version, interval, doubt."""
    common = {
        "recording": ", ".join(r.name for r in told.recordings),
        "date": told.recordings[0].date if told.recordings else "",
        "version": told.version,
    }
    numbers = {f"dynamics.{name}": n for name, n in step.base_parameters.items()}
    numbers |= {f"{e}.{key}": n for e, own in step.parameters.items() for key, n in own.items()}
    return {key: Provenance(**common, ci95=n.ci95, says=n.doubt) for key, n in numbers.items()}


def _files_of(file: VesselFile, own: Iterable[Effect], vessel: Path, out: Path) -> dict[str, str]:
    """Effects that come from a Python file -> its path from the new vessel file."""
    paths = {
        str(entry["type"]): vessel.parent / str(entry["file"])
        for entry in file.effects
        if "file" in entry
    }
    paths |= {e.name: Path(inspect.getfile(next(iter(e.laws.values())))) for e in own}
    folder = out.resolve().parent
    return {name: os.path.relpath(path.resolve(), folder) for name, path in paths.items()}


def _write(
    out: Path, vessel: Vessel, origin: dict[str, Provenance], files: Mapping[str, str]
) -> None:
    tables = vessel_tables(vessel, origin)
    for entry in tables.get("effects", ()):
        if entry["type"] in files:
            entry["file"] = files[entry["type"]]
    write_whole(out, tomli_w.dumps(tables).encode(), "the vessel file")
