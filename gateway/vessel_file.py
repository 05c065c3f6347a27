"""Vessel files: TOML → validated tables → `sim.vessel.Vessel`, and back.

docs/vessel.md describes the format. Every mistake is one line: file, key, what was expected.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite, radians
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from gateway.errors import BadInput
from gateway.files import vessel_names, vessel_path
from gateway.toml_file import explain, read_toml, shortened, validated
from gateway.user_effects import effect_file_beside, known_effects, load_trusted_effects
from gateway.vessel_tables import (
    AREAS_KEY,
    ASSUMED_AREAS,
    DynamicsTable,
    HullTable,
    Provenance,
    RudderTable,
    SensorsTable,
    ThrusterTable,
    VesselFile,
    check_tables,
)
from sim.effects.effect import Effect, Kind, Parameter
from sim.vessel import (
    AddedEffect,
    Dynamics,
    Hull,
    Rudder,
    Sensors,
    Servo,
    Thruster,
    Vessel,
)

_VESSEL_FILE = TypeAdapter(VesselFile)


def load_vessel(path: str | Path, more_effects: Iterable[Effect] = ()) -> Vessel:
    """The vessel of a vessel file, or a shipped vessel by its name (`otter`).

    `more_effects` are known beside the catalogue's.
    """
    file = vessel_path(path)
    read = read_vessel_file(file)
    check_tables(file, read)
    given = {effect.name: effect for effect in more_effects}
    try:
        return Vessel(
            name=read.name,
            source=read.source,
            hull=_hull(read),
            dynamics=Dynamics(**dict(read.dynamics)),
            thrusters=tuple(Thruster(**_actuator(t)) for t in read.thrusters),
            rudders=tuple(Rudder(**_actuator(r)) for r in read.rudders),
            sensors=Sensors(**dict(read.sensors)),
            effects=tuple(
                _effect(file, f"effects[{i}]", entry, given) for i, entry in enumerate(read.effects)
            ),
        )
    except ValueError as error:  # an effect that cannot act on this vessel
        raise BadInput(f"{file}: {error}") from None


def read_vessel_file(path: str | Path) -> VesselFile:
    """The validated tables of a vessel file; BadInput with one line where it is wrong."""
    file = vessel_path(path)
    if not file.suffix and not file.exists():
        raise BadInput(
            f"{file}: cannot read the vessel file: there is no such file; vessels that ship: "
            f"{', '.join(vessel_names())}"
        )
    try:
        return validated(_VESSEL_FILE, read_toml(file, "the vessel file"))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None


def _hull(read: VesselFile) -> Hull:
    """The hull; areas that the file says were assumed, and that are as assumed, are not known."""
    hull, note = Hull(**dict(read.hull)), read.provenance.get(AREAS_KEY)
    bare = replace(hull, wind_area=(0.0, 0.0))
    assumed = note is not None and note.says == ASSUMED_AREAS
    return bare if assumed and bare.areas == hull.wind_area else hull


def _actuator(table: ThrusterTable | RudderTable) -> dict[str, Any]:
    """The members of a Thruster or Rudder."""
    values = dict(table)
    servo = Servo(values.pop("channel"), values.pop("pwm"), values.pop("reversed"))
    return {**values, "servo": servo}


def _effect(file: Path, key: str, entry: dict[str, Any], given: dict[str, Effect]) -> AddedEffect:
    """One entry as an effect; of those `given` no file has to run."""
    values, known = dict(entry), {e.name: e for e in known_effects()} | given
    name, source = values.pop("type", None), values.pop("file", None)
    if name is None:
        raise BadInput(
            f"{file}: missing key {key}.type: expected one of {', '.join(sorted(known))}"
        )
    if source is not None and name not in given:
        known = known | {e.name: e for e in _effects_in(file, f"{key}.file", source)}
    if name not in known:
        where = f"{file}: {key}.type = {shortened(repr(name))}"
        raise BadInput(f"{where}: expected one of {', '.join(sorted(known))}")
    effect = known[str(name)]
    for parameter, value in values.items():
        if not _is_number(value):
            where = f"{file}: {key}.{shortened(parameter)} = {shortened(repr(value))}"
            raise BadInput(f"{where}: expected a number")
    try:
        added = AddedEffect(effect, {k: float(v) for k, v in values.items()})
    except ValueError as error:
        raise BadInput(f"{file}: {key}: {error}") from None

    _check_effect(f"{file}: {key}", effect.parameters, added.values)
    return added


def _is_number(value: Any) -> bool:
    """Whether a value of a TOML table is a finite number."""
    whole = isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63
    return whole or (isinstance(value, float) and isfinite(value))


def _check_effect(where: str, known: Sequence[Parameter], values: Mapping[str, float]) -> None:
    """BadInput where a number is far beyond what its effect declares: mostly degrees."""
    for p in known:
        room = 0.0 if p.kind is Kind.CIRCLE else p.upper - p.lower
        value = values[p.name]
        if not p.lower - room <= value <= p.upper + room:
            hint = f": {value:g}° are {radians(value):.4g} rad" if p.unit == "rad" else ""
            raise BadInput(
                f"{where}.{p.name} = {value:g}: expected {p.lower:g} to {p.upper:g} {p.unit}{hint}"
            )


def _effects_in(file: Path, key: str, source: Any) -> tuple[Effect, ...]:
    """Effects of the Python file that an entry names, where that file may run."""
    try:
        return load_trusted_effects(effect_file_beside(file, source))
    except BadInput as error:
        raise BadInput(f"{file}: {key}: {error}") from None


def vessel_tables(
    vessel: Vessel, provenance: dict[str, Provenance] | None = None
) -> dict[str, Any]:
    """A vessel as the tables of its file; defaults are left out.

    Areas above water that its effects need and nobody gave are written as assumed.
    """
    hull, provenance = vessel.hull, dict(provenance or {})
    if vessel.assumes_wind_area:
        hull = replace(hull, wind_area=hull.areas)
        provenance[AREAS_KEY] = Provenance(says=ASSUMED_AREAS)
    file = VesselFile(
        name=vessel.name,
        source=vessel.source,
        hull=HullTable(**vars(hull)),
        dynamics=DynamicsTable(**vars(vessel.dynamics)),
        thrusters=tuple(ThrusterTable(**_flat(t)) for t in vessel.thrusters),
        rudders=tuple(RudderTable(**_flat(r)) for r in vessel.rudders),
        sensors=SensorsTable(**vars(vessel.sensors)),
        effects=tuple({"type": a.effect.name, **a.values} for a in vessel.effects),
        provenance=provenance,
    )
    return file.model_dump(exclude_defaults=True)


def _flat(actuator: Thruster | Rudder) -> dict[str, Any]:
    values = dict(vars(actuator))
    return values | vars(values.pop("servo"))


def dump_vessel(vessel: Vessel, provenance: dict[str, Provenance] | None = None) -> str:
    """A vessel as the text of its file: `load_vessel` of it gives the same vessel."""
    return tomli_w.dumps(vessel_tables(vessel, provenance))


def zenoh_key(vessel: Vessel) -> str:
    """The vessel's name as a key on zenoh: small letters, no blanks or special characters."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in vessel.name.lower()).strip("-")
