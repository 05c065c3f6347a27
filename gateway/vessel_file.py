"""Vessel files: TOML → validated tables → `sim.vessel.Vessel`, and back.

docs/vessel.md describes the format. Every mistake is one line: file, key, what was expected.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from math import isclose, isfinite, nan, radians
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError

from gateway.errors import BadInput, printable
from gateway.files import vessel_names, vessel_path
from gateway.toml_file import MAX_TOLD, explain, parse_toml, read_toml, shortened, validated
from gateway.user_effects import effect_file_beside, known_effects, load_trusted_effects
from gateway.vessel_tables import (
    AREAS_KEY,
    ASSUMED_AREAS,
    MAX_LISTED,
    MAX_NAME,
    DynamicsTable,
    FloatingTable,
    HullTable,
    Provenance,
    Revision,
    RudderTable,
    SensorsTable,
    ThrusterTable,
    VesselFile,
    check_tables,
)
from sim.effects.effect import Effect, Kind, Parameter
from sim.model import parameters_of
from sim.near_names import did_you_mean
from sim.vessel import (
    AddedEffect,
    Dynamics,
    Floating,
    Hull,
    Rudder,
    Sensors,
    Servo,
    Thruster,
    Vessel,
)

_VESSEL_FILE = TypeAdapter(VesselFile)
ENCLOSED_VESSEL = "vessel.toml"  # the attachment of a recording with the vessel that it is of
LISTED = "`shadow effects` lists those there are"
ROOM = 20  # characters behind a name: " fitted"
OF, OF_THE_BOAT = "of", "boat"  # in the entry of an effect of a day that this boat has every day


def load_vessel(path: str | Path, more_effects: Iterable[Effect] = ()) -> Vessel:
    """The vessel of a vessel file, of the one in a recording, or a shipped one by name (`otter`).

    `more_effects` are known beside the catalogue's.
    """
    file = vessel_path(path)
    read = read_vessel_file(file)
    check_tables(file, read)
    given = {effect.name: effect for effect in more_effects}
    try:
        vessel = Vessel(
            name=read.name,
            source=read.source,
            sketch=read.sketch,
            hull=_hull(read),
            dynamics=Dynamics(**dict(read.dynamics)),
            thrusters=tuple(Thruster(**_actuator(t)) for t in read.thrusters),
            rudders=tuple(Rudder(**_actuator(r)) for r in read.rudders),
            sensors=Sensors(**dict(read.sensors)),
            floating=Floating(**dict(read.floating)),
            effects=tuple(
                _effect(file, f"effects[{i}]", entry, given) for i, entry in enumerate(read.effects)
            ),
        )
    except ValueError as error:  # an effect that cannot act on this vessel
        raise BadInput(f"{file}: {error}") from None
    for i, added in enumerate(vessel.effects):
        mismatch = added.effect.mismatch
        if mismatch is not None and (why := mismatch(vessel, added.values)):
            raise BadInput(f"{file}: effects[{i}]: {why}")
    _check_provenance(file, read, vessel)
    return vessel


def edited_numbers(read: VesselFile, vessel: Vessel) -> dict[str, tuple[float, Provenance]]:
    """Numbers that are no longer what their provenance says: key -> the number now, and that."""
    numbers, out = parameters_of(vessel), {}
    for key, origin in read.provenance.items():
        now = numbers.get(number_name(key))
        if now is not None and origin.value is not None and not same_number(now, origin.value):
            out[key] = now, origin
    return out


def number_name(key: str) -> str:
    """The name that a model gives to what a key of the provenance is about."""
    return key.removeprefix("dynamics.")


def same_number(one: float, other: float) -> bool:
    """Whether two numbers are one, but for how they were written."""
    return isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)


def _check_provenance(file: Path, read: VesselFile, vessel: Vessel) -> None:
    """BadInput where a number was edited to what its provenance speaks against."""
    for key, (now, origin) in edited_numbers(read, vessel).items():
        if origin.ci95 is None or not origin.ci95[0] <= now <= origin.ci95[1]:
            interval = "" if origin.ci95 is None else f" ({_ends(origin.ci95)})"
            raise BadInput(
                f"{file}: {key} = {now:g}: {shortened(origin.recording, 200)} gave "
                f'{origin.value:g}{interval}: put that back, or take [provenance."{key}"] '
                "out where the new number is meant"
            )


def _ends(ci95: tuple[float, float]) -> str:
    return f"{ci95[0]:.4g} … {ci95[1]:.4g}"


def read_vessel_file(path: str | Path) -> VesselFile:
    """The validated tables of a vessel file; BadInput with one line where it is wrong."""
    file = vessel_path(path)
    names = vessel_names()
    if not file.suffix and not file.exists():
        raise BadInput(
            f"{file}: cannot read the vessel file: there is no such file: "
            f"{did_you_mean(str(path), names)}vessels that ship: {', '.join(names)}"
        )
    try:
        return validated(_VESSEL_FILE, _tables(file))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None


def _tables(file: Path) -> dict[str, Any]:
    """The tables of a vessel file, or of the one that lies in a recording of the gateway's."""
    if file.suffix != ".mcap":
        return read_toml(file, "the vessel file")
    from gateway.recording.reader import Recording  # of no use to any other

    held = Recording.open(file).attachments.get(ENCLOSED_VESSEL)
    if held is None:
        raise BadInput(f"{file}: this recording holds no vessel file: give one (TOML)")
    return parse_toml(file, held.data, "the vessel file in it")


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
        raise BadInput(f"{file}: missing key {key}.type: {LISTED}")
    if source is not None and name not in given:
        known = known | {e.name: e for e in _effects_in(file, f"{key}.file", source)}
    if name not in known:
        own = "one of your own needs --effects FILE.py"
        raise BadInput(f"{file}: {no_effect(f'{key}.type', name, known)}; {own}")
    effect = known[str(name)]
    if OF in values and OF not in {p.name for p in effect.parameters}:
        effect = _of_whom(f"{file}: {key}.{OF}", effect, values.pop(OF))
    for parameter, value in values.items():
        if not _is_number(value):
            where = f"{file}: {key}.{shortened(parameter)} = {shortened(repr(value))}"
            raise BadInput(f"{where}: expected a number")
    try:
        added = AddedEffect(effect, {k: float(v) for k, v in values.items()})
    except ValueError as error:
        raise BadInput(f"{file}: {key}: {shortened(str(error), MAX_TOLD)}") from None

    check_effect(f"{file}: {key}", effect.parameters, added.values)
    return added


def no_effect(key: str, name: Any, known: Iterable[str]) -> str:
    """What is said of a name that no effect has; all names would be longer than what is printed."""
    return f"{key} = {shortened(repr(name))}: no such effect: {which_effect(str(name), known)}"


def which_effect(name: str, known: Iterable[str]) -> str:
    """Which effect was meant by a name that none has, and where those there are stand."""
    return f"{did_you_mean(name, known)}{LISTED}"


def _of_whom(where: str, effect: Effect, whose: Any) -> Effect:
    """An effect of a day as the boat's, where its entry says that every day has it alike."""
    if whose != OF_THE_BOAT:
        raise BadInput(f"{where} = {shortened(repr(whose))}: expected {OF_THE_BOAT!r}, or none")
    if not effect.alike:
        able = ", ".join(each.name for each in known_effects() if each.alike)
        raise BadInput(f"{where}: {effect.name} is none that a boat has every day ({able})")
    return effect.of_the_boat


def _of_entry(added: AddedEffect) -> dict[str, Any]:
    """An effect as an entry of the file."""
    whose = {OF: OF_THE_BOAT} if added.effect.is_alike else {}
    return {"type": added.effect.name, **whose, **added.values}


def _is_number(value: Any) -> bool:
    """Whether a value of a TOML table is a finite number."""
    whole = isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63
    return whole or (isinstance(value, float) and isfinite(value))


def check_effect(where: str, known: Sequence[Parameter], values: Mapping[str, float]) -> None:
    """BadInput where a number is far beyond what its effect declares: mostly degrees; or where one
    that stands for a choice is none of those.
    """
    for p in known:
        room = 0.0 if p.kind in (Kind.CIRCLE, Kind.CHOICE) else p.upper - p.lower
        value = values[p.name]
        if p.kind is Kind.CHOICE and not value.is_integer():
            raise BadInput(f"{where}.{p.name} = {value:g}: expected a whole number")
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
        raise BadInput(f"{file}: {key}: {shortened(str(error), MAX_TOLD)}") from None


def vessel_tables(
    vessel: Vessel,
    provenance: dict[str, Provenance] | None = None,
    history: Sequence[Revision] = (),
) -> dict[str, Any]:
    """A vessel as the tables of its file; defaults are left out, and provenance of other numbers.

    Areas above water that its effects need and nobody gave are written as assumed.
    """
    numbers, hull = parameters_of(vessel), vessel.hull
    provenance = {
        key: origin
        for key, origin in (provenance or {}).items()
        if origin.value is None or same_number(numbers.get(number_name(key), nan), origin.value)
    }
    if vessel.assumes_wind_area:
        hull = replace(hull, wind_area=hull.areas)
        provenance[AREAS_KEY] = Provenance(says=ASSUMED_AREAS)
    file = VesselFile(
        name=vessel.name,
        source=vessel.source,
        sketch=vessel.sketch,
        hull=HullTable(**vars(hull)),
        dynamics=DynamicsTable(**vars(vessel.dynamics)),
        thrusters=tuple(ThrusterTable(**_flat(t)) for t in vessel.thrusters),
        rudders=tuple(RudderTable(**_flat(r)) for r in vessel.rudders),
        sensors=SensorsTable(**vars(vessel.sensors)),
        floating=FloatingTable(**vars(vessel.floating)),
        effects=tuple(map(_of_entry, vessel.effects)),
        provenance=provenance,
        history=tuple(history),
    )
    return file.model_dump(exclude_defaults=True)


def _flat(actuator: Thruster | Rudder) -> dict[str, Any]:
    values = dict(vars(actuator))
    return values | vars(values.pop("servo"))


def dump_vessel(
    vessel: Vessel,
    provenance: dict[str, Provenance] | None = None,
    history: Sequence[Revision] = (),
) -> str:
    """A vessel as the text of its file: `load_vessel` of it gives the same vessel."""
    return tomli_w.dumps(vessel_tables(vessel, provenance, history))


def revised(
    old: VesselFile, before: Vessel, now: Vessel, by: str, recording: str
) -> tuple[Revision, ...]:
    """The history of a file with one revision more: what `by` changed, found on `recording`."""
    was, new = parameters_of(before), parameters_of(now)
    changed = {k: v for k, v in new.items() if k not in was or not same_number(v, was[k])}
    revision = Revision(
        date=datetime.now(UTC).date().isoformat(), by=by, recording=recording,
        version=version("shadow-gateway"),
        before={k: was[k] for k in changed if k in was}, now=changed,
    )  # fmt: skip
    return (*old.history, revision) if changed else old.history


def name_after(file: Path) -> str:
    """The name of a boat that is called after a file, with room for a word behind it."""
    return printable(file.stem)[: MAX_NAME - ROOM]


def listed(texts: Iterable[str], mark: str = ", ") -> str:
    """Names of recordings, or what was said on each, as a file holds them: those that fit."""
    return shortened(mark.join(texts), MAX_LISTED - 1)


def of_fitted_areas(intervals: Mapping[str, tuple[float, float]], doubts: Iterable[str]) -> str:
    """What is said of areas above water that were fitted: by name, 95 % intervals [m²]; doubts."""
    ends = " and ".join(f"{low:.3g} … {high:.3g}" for low, high in intervals.values())
    one = len(intervals) == 1
    what = f"{next(iter(intervals))} fitted" if one else "fitted"
    says = f"{what} to the measured wind, 95 % interval{'' if one else 's'} {ends} m²"
    return listed(filter(None, (says, *doubts)), "; ")


def zenoh_key(vessel: Vessel) -> str:
    """The vessel's name as a key on zenoh: small letters, no blanks or special characters."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in vessel.name.lower()).strip("-")
