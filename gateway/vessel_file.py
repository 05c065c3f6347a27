"""Vessel files: TOML → validated tables → `sim.vessel.Vessel`, and back.

docs/vessel.md describes the format. Every mistake is one line: file, key, what was expected.
"""

import json
import tomllib
from collections.abc import Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tomli_w
from annotated_types import Ge, Gt, Le, Lt
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    TypeAdapter,
    ValidationError,
)

from gateway.errors import BadInput
from gateway.files import vessel_names, vessel_path
from gateway.user_effects import known_effects, load_effects
from sim.effects.effect import Effect
from sim.vessel import (
    CURVES,
    AddedEffect,
    Dynamics,
    Hull,
    Points,
    Rudder,
    Sensors,
    Servo,
    Thruster,
    Vessel,
    curve_problem,
)

T = TypeVar("T")

Positive = Annotated[float, Gt(0.0)]
Damping = Annotated[float, Le(0.0)]
Azimuth = Annotated[float, Ge(-3.1416), Le(3.1416)]
Steering = Annotated[float, Gt(-1.58), Lt(1.58)]  # rad: degrees by mistake are caught
Channel = Annotated[int, Ge(1), Le(32)]
Point = tuple[float, float]


def _ascending(pwm: tuple[float, float, float]) -> tuple[float, float, float]:
    low, neutral, high = pwm
    if not 500 <= low <= neutral <= high <= 2500 or low == high:
        raise ValueError("must be ascending pulse widths in µs: lowest, neutral, highest")
    return pwm


def _astern_ahead(thrust: Point) -> Point:
    if not thrust[0] <= 0.0 < thrust[1]:
        raise ValueError("must be thrust in N full astern (negative or 0), then full ahead")
    return thrust


def _curve(given: Any) -> str | Points:
    """A name, or a table as tuples."""
    if isinstance(given, str):
        return given
    try:
        points = tuple((float(c), float(s)) for c, s in given)
    except (TypeError, ValueError):
        raise ValueError("expected linear, quadratic, a table or a thruster that has one") from None
    wrong = curve_problem(points)
    if wrong:
        raise ValueError(f"pairs of command and share of full thrust {wrong}")
    return points


Pulses = Annotated[tuple[float, float, float], AfterValidator(_ascending)]
Thrust = Annotated[Point, AfterValidator(_astern_ahead)]
Curve = Annotated[Any, PlainValidator(_curve)]


class StrictTable(BaseModel):
    """Unknown keys are mistakes; numbers are finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class HullTable(StrictTable):
    """[hull]"""

    length: Positive
    beam: Positive
    mass: Positive
    wind_area: Annotated[Point, Field(description="frontal, lateral [m²]")] = (0.0, 0.0)


class DynamicsTable(StrictTable):
    """[dynamics]"""

    m11: Positive
    m22: Positive
    m33: Positive
    X_u: Damping
    X_uu: Damping
    Y_v: Damping
    Y_vv: Damping
    N_r: Damping
    N_rr: Damping
    x_g: float = 0.0
    Y_r: float = 0.0
    N_v: float = 0.0
    Y_uv: float = 0.0
    Y_ur: float = 0.0
    N_uv: float = 0.0
    N_ur: float = 0.0


class ThrusterTable(StrictTable):
    """[[thrusters]]"""

    name: str
    channel: Channel
    position: Point
    azimuth: Azimuth = 0.0
    pwm: Pulses = (1100.0, 1500.0, 1900.0)
    reversed: bool = False
    thrust: Thrust
    curve: Curve = "linear"


class RudderTable(StrictTable):
    """[[rudders]]"""

    name: str = "rudder"
    channel: Channel
    position: Point = (0.0, 0.0)
    pwm: Pulses = (1100.0, 1500.0, 1900.0)
    reversed: bool = False
    angle: tuple[Steering, Steering]
    area: Annotated[float, Ge(0.0)] = 0.0
    aspect: Positive = 1.5
    wash: str | None = None
    motor: str | None = None


class SensorsTable(StrictTable):
    """[sensors]"""

    antenna: Point = (0.0, 0.0)
    imu: Point = (0.0, 0.0)


GUESSED = "guessed from size"  # provenance of a number that was never measured


class Provenance(StrictTable):
    """[provenance."KEY"]: where a number came from."""

    recording: str = ""
    date: str = ""
    version: str = ""
    ci95: Point | None = None
    says: str = ""


class VesselFile(StrictTable):
    """A vessel file as written."""

    name: str
    source: str = ""
    hull: HullTable
    dynamics: DynamicsTable
    thrusters: Annotated[tuple[ThrusterTable, ...], Field(min_length=1)]
    rudders: tuple[RudderTable, ...] = ()
    sensors: SensorsTable = SensorsTable()
    effects: tuple[dict[str, Any], ...] = ()
    provenance: dict[str, Provenance] = Field(default_factory=dict)

    @property
    def guessed(self) -> bool:
        """Whether any number of its dynamics was guessed."""
        marks = self.provenance.items()
        return any(k.startswith("dynamics.") and m.says.startswith(GUESSED) for k, m in marks)


_VESSEL_FILE = TypeAdapter(VesselFile)


def load_vessel(path: str | Path, more_effects: Iterable[Effect] = ()) -> Vessel:
    """The vessel of a vessel file, or a shipped vessel by its name (`otter`).

    `more_effects` are known beside the catalogue's.
    """
    file = vessel_path(path)
    read = read_vessel_file(file)
    _check_actuators(file, read)
    known = {effect.name: effect for effect in (*known_effects(), *more_effects)}
    try:
        return Vessel(
            name=read.name,
            source=read.source,
            hull=Hull(**dict(read.hull)),
            dynamics=Dynamics(**dict(read.dynamics)),
            thrusters=tuple(Thruster(**_actuator(t)) for t in read.thrusters),
            rudders=tuple(Rudder(**_actuator(r)) for r in read.rudders),
            sensors=Sensors(**dict(read.sensors)),
            effects=tuple(
                _effect(file, f"effects[{i}]", entry, known) for i, entry in enumerate(read.effects)
            ),
        )
    except ValueError as error:  # an effect that cannot act on this vessel
        raise BadInput(f"{file}: {error}") from None


def read_vessel_file(path: str | Path) -> VesselFile:
    """The validated tables of a vessel file; BadInput with one line where it is wrong."""
    file = vessel_path(path)
    try:
        return validated(_VESSEL_FILE, tomllib.loads(file.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{file}: not a TOML file: {error}") from None
    except UnicodeDecodeError:
        raise BadInput(f"{file}: not a text file; a vessel file is TOML") from None
    except OSError as error:
        shipped = f"; vessels that ship: {', '.join(vessel_names())}" if not file.suffix else ""
        raise BadInput(f"{file}: cannot read the vessel file: {error.strerror}{shipped}") from None


def validated(kind: TypeAdapter[T], tables: Mapping[str, Any]) -> T:
    """TOML tables as a validated object: a number in quotes or a bool for a number is a mistake.

    pydantic's strict rules for JSON hold for TOML too: there are no tuples and no enums in either.
    """
    return kind.validate_json(json.dumps(tables, default=str), strict=True)


def explain(error: ValidationError) -> str:
    """The mistakes of a pydantic error in one line: key and what was expected."""
    mistakes = error.errors()
    unknown = [_key(m["loc"]) for m in mistakes if m["type"] in _UNKNOWN]
    missing = [_key(m["loc"]) for m in mistakes if m["type"] == "missing"]
    keys = {"unknown key": unknown, "missing key": missing}
    if unknown or missing:
        return "; ".join(f"{what} {', '.join(found)}" for what, found in keys.items() if found)
    message = mistakes[0]["msg"].removeprefix("Value error, ")
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    key, value = _key(mistakes[0]["loc"]), mistakes[0]["input"]
    shown = "" if isinstance(value, dict) else f" = {value!r}"  # a whole table is too long
    return f"{key}{shown}: {message[0].lower()}{message[1:]}{more}"


_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _key(location: tuple[int | str, ...]) -> str:
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in location).lstrip(".")


def _check_actuators(file: Path, read: VesselFile) -> None:
    """BadInput where actuators share a name, or refer to one that is not there."""
    thrusters = [t.name for t in read.thrusters]
    names = thrusters + [r.name for r in read.rudders]
    tables = [t.name for t in read.thrusters if not isinstance(t.curve, str)]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{file}: the name {name!r} is given to {names.count(name)} actuators")
    for i, thruster in enumerate(read.thrusters):
        if isinstance(thruster.curve, str) and thruster.curve not in (*CURVES, *tables):
            raise BadInput(
                f"{file}: thrusters[{i}].curve = {thruster.curve!r}: expected {', '.join(CURVES)}, "
                "a table of [command, share of full thrust], or a thruster that has one "
                f"({', '.join(tables)})"
            )
    for i, rudder in enumerate(read.rudders):
        for named in (rudder.wash, rudder.motor):
            if named is not None and named not in thrusters:
                raise BadInput(
                    f"{file}: rudders[{i}]: no thruster named {named!r}: "
                    f"there are {', '.join(thrusters)}"
                )
        if rudder.motor is None and rudder.area == 0.0:
            raise BadInput(
                f"{file}: rudders[{i}]: a blade needs its area [m²]; a steered motor needs motor"
            )


def _actuator(table: ThrusterTable | RudderTable) -> dict[str, Any]:
    """The members of a Thruster or Rudder."""
    values = dict(table)
    servo = Servo(values.pop("channel"), values.pop("pwm"), values.pop("reversed"))
    return {**values, "servo": servo}


def _effect(file: Path, key: str, entry: dict[str, Any], known: dict[str, Effect]) -> AddedEffect:
    values = dict(entry)
    name, source = values.pop("type", None), values.pop("file", None)
    if name is None:
        raise BadInput(
            f"{file}: missing key {key}.type: expected one of {', '.join(sorted(known))}"
        )
    if source is not None:
        known = known | {e.name: e for e in _effects_in(file, f"{key}.file", source)}
    if name not in known:
        raise BadInput(f"{file}: {key}.type = {name!r}: expected one of {', '.join(sorted(known))}")
    effect = known[str(name)]
    for parameter, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise BadInput(f"{file}: {key}.{parameter} = {value!r}: expected a number")
    try:
        return AddedEffect(effect, {k: float(v) for k, v in values.items()})
    except ValueError as error:
        raise BadInput(f"{file}: {key}: {error}") from None


def _effects_in(file: Path, key: str, source: Any) -> tuple[Effect, ...]:
    """Effects of the Python file that an entry names, relative to the vessel file."""
    if not isinstance(source, str):
        raise BadInput(f"{file}: {key} = {source!r}: expected a path")
    try:
        return load_effects(file.parent / source)
    except BadInput as error:
        raise BadInput(f"{file}: {key}: {error}") from None


def vessel_tables(
    vessel: Vessel, provenance: dict[str, Provenance] | None = None
) -> dict[str, Any]:
    """A vessel as the tables of its file; defaults are left out."""
    file = VesselFile(
        name=vessel.name,
        source=vessel.source,
        hull=HullTable(**vars(vessel.hull)),
        dynamics=DynamicsTable(**vars(vessel.dynamics)),
        thrusters=tuple(ThrusterTable(**_flat(t)) for t in vessel.thrusters),
        rudders=tuple(RudderTable(**_flat(r)) for r in vessel.rudders),
        sensors=SensorsTable(**vars(vessel.sensors)),
        effects=tuple({"type": a.effect.name, **a.values} for a in vessel.effects),
        provenance=provenance or {},
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
