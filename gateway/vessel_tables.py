"""The tables of a vessel file, and what has to hold between them.

Bounds are wide: they stop what no boat is, no integration can follow, no compiler can finish.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le, MaxLen
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainValidator

from gateway.errors import BadInput, one_line
from sim.near_names import did_you_mean
from sim.vessel import CURVES, Points, curve_problem

LARGEST = 1e9  # of any number of a vessel, in SI: the largest ships have a mass of 6e8 kg
LONGEST_M = 500.0  # the longest ship measures 458 m
LARGEST_PLACE_M = 1000.0  # of a thruster or sensor from the origin
MAX_RUDDERS, MAX_EFFECTS = 16, 48  # each is compiled into the model; the catalogue fits in
MAX_NAME = 100  # characters of a name: tables and pictures have one in each row
MAX_KEY = 300  # … of a number's: names of an actuator and of what it is
MAX_SOURCE = 1000  # … of a sentence that people write
MAX_LISTED = 200_000  # … of what commands list, as the names of thousands of recordings
FASTEST_S = 1e-3  # a boat that damping stops sooner has a number in the wrong unit

Number = Annotated[float, Ge(-LARGEST), Le(LARGEST)]
Positive = Annotated[float, Gt(0.0), Le(LARGEST)]
Length = Annotated[float, Gt(0.0), Le(LONGEST_M)]
Damping = Annotated[float, Ge(-LARGEST), Le(0.0)]
NotNegative = Annotated[float, Ge(0.0), Le(LARGEST)]
Area = NotNegative
Metres = Annotated[float, Ge(-LARGEST_PLACE_M), Le(LARGEST_PLACE_M)]
Place = tuple[Metres, Metres]
Channel = Annotated[int, Ge(1), Le(32)]
Point = tuple[float, float]
Column = tuple[Metres, Metres, Positive]


def _azimuth(angle: float) -> float:
    if not abs(angle) <= HALF_TURN:
        raise ValueError("expected -3.1416 to 3.1416, in radians: is it in degrees?")
    return angle


def _bearing(angle: float) -> float:
    if not abs(angle) <= WHOLE_TURN:
        raise ValueError("expected -6.2832 to 6.2832, in radians: is it in degrees?")
    return angle


def _steering(angle: float) -> float:
    if not abs(angle) < MOST_STEERED:
        raise ValueError("expected less than a quarter turn, in radians: is it in degrees?")
    return angle


WHOLE_TURN, HALF_TURN, MOST_STEERED = 6.2832, 3.1416, 1.58  # rad
Bearing = Annotated[float, AfterValidator(_bearing)]
Azimuth = Annotated[float, AfterValidator(_azimuth)]
Steering = Annotated[float, AfterValidator(_steering)]


def _one_line(name: str) -> str:
    if one_line(name) != name:
        raise ValueError("must be one line of characters that can be shown")
    return name


def _ascending(pwm: tuple[float, float, float]) -> tuple[float, float, float]:
    low, neutral, high = pwm
    if not 500 <= low <= neutral <= high <= 2500 or low == high:
        raise ValueError("must be ascending pulse widths in µs: lowest, neutral, highest")
    return pwm


def _astern_ahead(thrust: Point) -> Point:
    if max(map(abs, thrust)) > LARGEST:
        raise ValueError(f"must be at most {LARGEST:g} N, astern and ahead")
    if not thrust[0] <= 0.0 < thrust[1]:
        raise ValueError("must be thrust in N full astern (negative or 0), then full ahead")
    return thrust


def _both_areas(areas: Point) -> Point:
    if not (min(areas) > 0.0 or areas == (0.0, 0.0)):
        raise ValueError("must be the frontal and the lateral area in m², both positive")
    return areas


def _port_starboard(angle: Point) -> Point:
    if not angle[0] < angle[1]:
        raise ValueError("must be rad at command -1, then at 1, ascending (reversed = true)")
    return angle


def _curve(given: Any) -> str | Points:
    """A name, or a table as tuples."""
    if isinstance(given, str):
        if len(given) > MAX_NAME:
            raise ValueError(f"expected a name of at most {MAX_NAME} characters")
        return given
    try:
        points = tuple((float(c), float(s)) for c, s in given)
    except (TypeError, ValueError):
        raise ValueError("expected linear, quadratic, a table or a thruster that has one") from None
    wrong = curve_problem(points)
    if wrong:
        raise ValueError(f"pairs of command and share of full thrust {wrong}")
    return points


Name = Annotated[str, MaxLen(MAX_NAME), AfterValidator(_one_line)]
Word = Annotated[str, MaxLen(MAX_NAME)]
Key = Annotated[str, MaxLen(MAX_KEY)]
Source = Annotated[str, MaxLen(MAX_SOURCE)]
Listed = Annotated[str, MaxLen(MAX_LISTED)]
Pulses = Annotated[tuple[float, float, float], AfterValidator(_ascending)]
Thrust = Annotated[Point, AfterValidator(_astern_ahead)]
Curve = Annotated[Any, PlainValidator(_curve)]


class StrictTable(BaseModel):
    """Unknown keys are mistakes; numbers are finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class HullTable(StrictTable):
    """[hull]"""

    length: Length
    beam: Length
    mass: Positive
    wind_area: Annotated[
        tuple[Area, Area], AfterValidator(_both_areas), Field(description="frontal, lateral [m²]")
    ] = (0.0, 0.0)
    waterplane_area: Area = 0.0
    metacentric_heights: tuple[NotNegative, NotNegative] = (0.0, 0.0)


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
    x_g: Metres = 0.0
    Y_r: Number = 0.0
    N_v: Number = 0.0
    Y_uv: Number = 0.0
    Y_ur: Number = 0.0
    N_uv: Number = 0.0
    N_ur: Number = 0.0


class ThrusterTable(StrictTable):
    """[[thrusters]]"""

    name: Name
    channel: Channel
    position: Place
    azimuth: Azimuth = 0.0
    pwm: Pulses = (1100.0, 1500.0, 1900.0)
    reversed: bool = False
    thrust: Thrust
    curve: Curve = "linear"


class RudderTable(StrictTable):
    """[[rudders]]"""

    name: Name = "rudder"
    channel: Channel
    position: Place = (0.0, 0.0)
    pwm: Pulses = (1100.0, 1500.0, 1900.0)
    reversed: bool = False
    angle: Annotated[tuple[Steering, Steering], AfterValidator(_port_starboard)]
    area: Area = 0.0
    aspect: Positive = 1.5
    wash: Word | None = None
    motor: Word | None = None


class SensorsTable(StrictTable):
    """[sensors]"""

    antenna: Place = (0.0, 0.0)
    imu: Place = (0.0, 0.0)
    gyro_noise: NotNegative = 0.0
    gyro_bias: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    accel_noise: NotNegative = 0.0
    accel_bias: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    position_noise: NotNegative = 0.0
    velocity_noise: NotNegative = 0.0


MAX_POINTS = 500  # columns of a hull, each of them computed in every step


class FloatingTable(StrictTable):
    """[floating]"""

    points: Annotated[tuple[Column, ...], Field(max_length=MAX_POINTS)] = ()
    inertia: tuple[Positive, Positive, Positive] | None = None
    centre_of_gravity: Metres | None = None
    freeboard: Annotated[float, Gt(0.0), Le(LONGEST_M)] | None = None
    thruster_depth: Metres | None = None


GUESSED = "guessed from size"  # provenance of a number that was never measured
ASSUMED_AREAS = "assumed from length and beam: measure it"  # … and of the areas above water
AREAS_KEY = "hull.wind_area"


class Provenance(StrictTable):
    """[provenance."KEY"]: where a number came from.

    value  what was written then: a number that is another one now was edited since
    fit    what found it: "identify, shooting, 240 s"
    """

    recording: Listed = ""
    date: Word = ""
    version: Word = ""
    fit: Listed = ""
    value: float | None = None
    ci95: Point | None = None
    says: Listed = ""


class Revision(StrictTable):
    """[[history]]: a command that changed numbers, with what they were and what they are."""

    date: Word
    by: Word
    recording: Listed = ""
    version: Word = ""
    before: dict[Key, float] = Field(default_factory=dict)
    now: dict[Key, float] = Field(default_factory=dict)


class VesselFile(StrictTable):
    """A vessel file as written."""

    name: Name
    source: Source = ""
    sketch: bool = False
    hull: HullTable
    dynamics: DynamicsTable
    thrusters: Annotated[tuple[ThrusterTable, ...], Field(min_length=1)]
    rudders: Annotated[tuple[RudderTable, ...], Field(max_length=MAX_RUDDERS)] = ()
    sensors: SensorsTable = SensorsTable()
    floating: FloatingTable = FloatingTable()
    effects: Annotated[tuple[dict[str, Any], ...], Field(max_length=MAX_EFFECTS)] = ()
    provenance: dict[Key, Provenance] = Field(default_factory=dict)
    history: tuple[Revision, ...] = ()

    @property
    def guessed(self) -> bool:
        """Whether any number of its dynamics was guessed."""
        marks = self.provenance.items()
        return any(k.startswith("dynamics.") and m.says.startswith(GUESSED) for k, m in marks)


def _or_one_of(thrusters: Sequence[str]) -> str:
    """The thrusters whose table another one may take, at the end of a sentence."""
    return f", or a thruster that has one ({', '.join(thrusters)})" if thrusters else ""


def check_tables(file: Path, read: VesselFile) -> None:
    """BadInput where actuators share a name or an output, or refer to one that is not there."""
    thrusters = [t.name for t in read.thrusters]
    names = thrusters + [r.name for r in read.rudders]
    tables = [t.name for t in read.thrusters if not isinstance(t.curve, str)]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{file}: the name {name!r} is given to {names.count(name)} actuators")
    _check_channels(file, read)
    _check_damping(file, read.dynamics)
    for i, thruster in enumerate(read.thrusters):
        if isinstance(thruster.curve, str) and thruster.curve not in (*CURVES, *tables):
            raise BadInput(
                f"{file}: thrusters[{i}].curve = {thruster.curve!r}: "
                f"{did_you_mean(thruster.curve, (*CURVES, *tables))}expected {', '.join(CURVES)}, "
                f"{'' if tables else 'or '}a table of [command, share of full thrust]"
                f"{_or_one_of(tables)}"
            )
    for i, rudder in enumerate(read.rudders):
        for named in (rudder.wash, rudder.motor):
            if named is not None and named not in thrusters:
                raise BadInput(
                    f"{file}: rudders[{i}]: no thruster named {named!r}: "
                    f"{did_you_mean(named, thrusters)}there are {', '.join(thrusters)}"
                )
        if rudder.motor is None and rudder.area == 0.0:
            raise BadInput(
                f"{file}: rudders[{i}]: a blade needs its area [m²]; a steered motor needs motor"
            )


def _check_channels(file: Path, read: VesselFile) -> None:
    """BadInput where an output drives a thruster and something else; rudders may share one."""
    taken: dict[int, str] = {}
    for i, thruster in enumerate(read.thrusters):
        if thruster.channel in taken:
            raise BadInput(
                f"{file}: thrusters[{i}].channel = {thruster.channel}: drives "
                f"{taken[thruster.channel]!r} too: two motors on one output are one thruster, "
                "between them, with the thrust of both"
            )
        taken[thruster.channel] = thruster.name
    for i, rudder in enumerate(read.rudders):
        if rudder.channel in taken:
            raise BadInput(
                f"{file}: rudders[{i}].channel = {rudder.channel}: is that of thruster "
                f"{taken[rudder.channel]!r}: one output cannot do both"
            )


def _check_damping(file: Path, d: DynamicsTable) -> None:
    """BadInput where the hull would stop within a millisecond: no integration follows that."""
    for inertia, *keys in (("m11", "X_u", "X_uu"), ("m22", "Y_v", "Y_vv"), ("m33", "N_r", "N_rr")):
        for key in keys:
            if -getattr(d, key) * FASTEST_S > getattr(d, inertia):
                raise BadInput(
                    f"{file}: dynamics.{key} = {getattr(d, key):g} with {inertia} = "
                    f"{getattr(d, inertia):g}: stops the boat in less than {FASTEST_S:g} s: "
                    "is the unit right?"
                )
