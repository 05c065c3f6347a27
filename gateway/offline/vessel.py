"""Vessel files: a first one from a log (`shadow init`), and their passport (`shadow vessel`).

Initial: channels, functions, pulse limits and directions come from the autopilot's parameters in
the log. Size, mass and thrust cannot be known from a log: the user gives them, and what follows
from them is marked as a guess.

The passport says of each number of a file where it comes from, and how two files differ.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.ingest.log import BoatSamples, Log, choose_floating
from gateway.ingest.mapping import THRUST_FUNCTIONS, Actuator, OutputFunction, actuators
from gateway.ingest.open import takes_mapping
from gateway.ingest.parameter_changes import outputs_notice
from gateway.ingest.px4_outputs import named_only, named_outputs
from gateway.number_keys import file_key
from gateway.offline.notices import MOVES_US, spread_of
from gateway.samples import Quantity
from gateway.toml_file import MAX_TOLD, explain, shortened
from gateway.vessel_file import (
    dump_vessel,
    edited_numbers,
    load_vessel,
    name_after,
    number_name,
    read_vessel_file,
)
from gateway.vessel_questions import DRAUGHT_PER_BEAM, box_draught, is_within
from gateway.vessel_tables import (
    ASSUMED_AREAS,
    GUESSED,
    Provenance,
    RudderTable,
    ThrusterTable,
    VesselFile,
)
from sim.effects.effect import Effect
from sim.identification import AREAS, BASE
from sim.identification.parameters import UNITS
from sim.model import parameters_of
from sim.vessel import Dynamics, Hull, Rudder, Servo, Thruster, Vessel

BY_HAND = "write the [[thrusters]] by hand, see configs/vessels"
ASTERN = 0.75  # thrust astern over thrust ahead of a usual propeller; a rule of thumb
_SIDES = {
    OutputFunction.THROTTLE: 0.0,
    OutputFunction.THROTTLE_LEFT: -1.0,
    OutputFunction.THROTTLE_RIGHT: 1.0,
}
_NAMES = {
    OutputFunction.THROTTLE: "main",
    OutputFunction.THROTTLE_LEFT: "left",
    OutputFunction.THROTTLE_RIGHT: "right",
    OutputFunction.MOTOR: "motor",
    OutputFunction.STEERING: "rudder",
}
# Ahead and to starboard of the middle: corners of motors 1 to 4.
_CORNERS = {1: (1.0, 1.0), 2: (-1.0, -1.0), 3: (1.0, -1.0), 4: (-1.0, 1.0)}


@dataclass(frozen=True)
class BoatSize:
    """What an owner knows: length, beam [m], mass [kg], thrust ahead of one motor [N], m/s."""

    length: float = 1.5
    beam: float = 0.8
    mass: float = 30.0
    thrust: float = 40.0
    top_speed: float = 2.0


def init_vessel(
    log: Log,
    out: Path,
    name: str | None,
    given: Mapping[str, float],
    system: int | None = None,
    anyway: bool = False,
) -> VesselFile:
    """Write an initial vessel file for the boat of a log -> what was written.

    `given` holds members of `BoatSize`; the others are assumed.
    """
    check_size(given)
    parameters = log.parameters(choose_floating(log, system, anyway))
    if not parameters and takes_mapping(log.path):
        raise BadInput(
            f"{log.path}: a table holds no parameters of the autopilot: give init a log of its "
            "own, or copy a file from configs/vessels and enter the channels"
        )
    if not parameters:
        raise BadInput(
            f"{log.path}: no parameters in it (PARAM_VALUE, PARM): record from boot or fetch "
            "them with the ground station, or copy a file from configs/vessels"
        )
    path, outputs = Path(log.path), actuators(parameters)
    if not outputs and (named := named_only(named_outputs(parameters))):
        raise BadInput(f"{log.path}: {named}: {BY_HAND}")
    text = first_vessel(path, name or name_after(path), outputs, given)
    write_whole(out, text.encode(), "the vessel file")
    return read_vessel_file(out)


def initial_notices(log: Log, system: int | None = None) -> list[str]:
    """What makes an initial vessel file doubtful: outputs that its log sets otherwise, or that move
    and are not in it.
    """
    boat = choose_floating(log, system, anyway=True)
    told = [f"{text}; this file has the last values" for text in outputs_notice(log, boat)]
    parameters = log.parameters(boat)
    known = {a.channel for a in actuators(parameters)}
    for channel in sorted(moving_channels(log.decode(boat)) - known):
        function = parameters.get(f"SERVO{channel}_FUNCTION")
        named = "" if function is None else f" (SERVO{channel}_FUNCTION {function:g})"
        told.append(
            f"output {channel} moves too, and its parameters{named} do not say that it drives the "
            "boat: add it by hand if it does"
        )
    return told


def moving_channels(decoded: BoatSamples) -> set[int]:
    """Outputs whose pulses move by more than noise."""
    found = set[int]()
    for samples in decoded.of(Quantity.ACTUATORS):
        first, last = samples.channels
        moves = (spread_of(pulses) > MOVES_US for pulses in samples.values[:, first - 1 : last].T)
        found |= {first + k for k, does in enumerate(moves) if does}
    return found


def initial_vessel_dict(
    made: VesselFile, out: Path, notices: Sequence[str] = ()
) -> dict[str, object]:
    """What was written as plain values: the file, its actuators, where each number is from."""
    parts: list[ThrusterTable | RudderTable] = [*made.thrusters, *made.rudders]
    found: dict[str, object] = {
        "written": str(out),
        "name": made.name,
        "actuators": [
            {"name": a.name, "channel": a.channel, "pwm_us": list(a.pwm), "reversed": a.reversed}
            for a in parts
        ],
        "provenance": {key: origin.says for key, origin in made.provenance.items()},
    }
    return found | ({"notices": list(notices)} if notices else {})


def check_size(given: Mapping[str, float]) -> None:
    """BadInput where a size is none."""
    for key, value in given.items():
        if not 0.0 < value < float("inf"):
            raise BadInput(f"--{key.replace('_', '-')} {value}: expected a positive number")
    size = BoatSize(**given)
    draught = box_draught(size.length, size.beam, size.mass)
    if not is_within(draught / size.beam, DRAUGHT_PER_BEAM):
        sizes = f"--length {size.length:g} --beam {size.beam:g} --mass {size.mass:g}"
        raise BadInput(f"{sizes}: such a hull would draw {draught:.2g} m: give all three, in "
                       "metres and kilograms")  # fmt: skip


def first_vessel(
    log_path: Path, name: str, found: list[Actuator], given: Mapping[str, float]
) -> str:
    """The text of an initial vessel file; `given` holds members of `BoatSize`."""
    try:
        vessel, provenance = initial_vessel(name, found, BoatSize(**given), frozenset(given))
        return dump_vessel(vessel, provenance)
    except BadInput as error:
        raise BadInput(f"{log_path}: {error}") from None
    except ValidationError as error:
        raise BadInput(f"{log_path}: no vessel comes of that: {explain(error)}") from None


ASIDE = "assumed straight ahead: motors of an X or a cross point aside: give azimuth, in radians"


def initial_vessel(
    name: str, found: list[Actuator], size: BoatSize, given: frozenset[str] = frozenset()
) -> tuple[Vessel, dict[str, Provenance]]:
    """Vessel with the log's actuators, and its provenance; `given` names what was not guessed.

    Added mass: slender body (Fossen 2021, §6.4.1, rules of thumb for small craft); damping: half
    linear, half quadratic of what full thrust balances at top speed.
    """
    motors = [a for a in found if a.kind in THRUST_FUNCTIONS]
    steering = [a for a in found if a.kind is OutputFunction.STEERING]
    if not motors:
        raise BadInput(
            f"no output drives the boat (SERVOn_FUNCTION 70, 73, 74 or 33 to 36): {BY_HAND}"
        )
    thrusters = tuple(
        _thruster(a, name, size) for a, name in zip(motors, _names(motors), strict=True)
    )
    rudders = tuple(
        _rudder(a, name, thrusters[0].name, size)
        for a, name in zip(steering, _names(steering), strict=True)
    )
    vessel = Vessel(
        name=name,
        source="shadow init: actuators from the log's parameters, the rest guessed from size",
        hull=Hull(size.length, size.beam, size.mass),
        dynamics=_dynamics(size, sum(t.thrust[1] for t in thrusters)),
        thrusters=thrusters,
        rudders=rudders,
    )
    marks = _provenance(vessel, given)
    marks |= {
        f"thrusters.{thruster.name}.azimuth": Provenance(says=ASIDE)
        for a, thruster in zip(motors, thrusters, strict=True)
        if a.motor is not None
    }
    return vessel, marks


def _names(found: Sequence[Actuator]) -> list[str]:
    """A name for each; with its channel where several outputs have one function."""
    plain = [_NAMES[a.kind] + (f"_{a.motor}" if a.motor else "") for a in found]
    return [
        name if plain.count(name) == 1 else f"{name}_{a.channel}"
        for a, name in zip(found, plain, strict=True)
    ]


def _thruster(a: Actuator, name: str, size: BoatSize) -> Thruster:
    """A thruster where a motor of that function usually is."""
    if a.motor is not None:
        ahead, side = _CORNERS[a.motor]
        position = (0.35 * size.length * ahead, 0.35 * size.beam * side)
    else:
        position = (-0.4 * size.length, 0.4 * size.beam * _SIDES[a.kind])
    thrust = (-round(ASTERN * size.thrust, 1), size.thrust)
    forward, starboard = (round(metres, 3) for metres in position)
    return Thruster(name, Servo(a.channel, a.pwm, a.reversed), (forward, starboard), thrust)


def _rudder(a: Actuator, name: str, behind: str, size: BoatSize) -> Rudder:
    area = round(0.02 * size.length * 0.2 * size.length, 4)  # a small share of the lateral plane
    return Rudder(
        name, Servo(a.channel, a.pwm, a.reversed), (-round(0.5 * size.length, 3), 0.0),
        (-0.6, 0.6),
        area=max(area, 0.002), wash=behind,
    )  # fmt: skip


def _dynamics(size: BoatSize, thrust: float) -> Dynamics:
    m11, m22 = 1.1 * size.mass, 1.6 * size.mass
    m33 = 1.5 * size.mass * (size.length**2 + size.beam**2) / 12.0
    linear, quadratic = 0.5 * thrust / size.top_speed, 0.5 * thrust / size.top_speed**2
    moment = thrust * 0.4 * size.beam
    return Dynamics(
        m11=round(m11, 2), m22=round(m22, 2), m33=round(m33, 3),
        X_u=-round(linear, 2), X_uu=-round(quadratic, 2),
        Y_v=-round(3.0 * linear, 2), Y_vv=-round(10.0 * quadratic, 2),
        N_r=-round(0.5 * moment, 3), N_rr=-round(0.5 * moment, 3),
    )  # fmt: skip


A_BLADE = "assumed a blade: measure it; of a motor that turns write"


def _provenance(vessel: Vessel, given: frozenset[str]) -> dict[str, Provenance]:
    guessed = Provenance(says=f"{GUESSED}: identify it")
    marks = {f"dynamics.{name}": guessed for name in BASE}
    for key in ("length", "beam", "mass"):
        if key not in given:
            marks[f"hull.{key}"] = Provenance(says="assumed: measure it")
    for thruster in vessel.thrusters:
        key = f"thrusters.{thruster.name}"
        marks[f"{key}.position"] = Provenance(says="assumed from its function: measure it")
        if "thrust" not in given:
            marks[f"{key}.thrust"] = Provenance(says="assumed: take it from the motor's data sheet")
        marks[f"{key}.pwm"] = Provenance(says="from the log's parameters")
    for rudder in vessel.rudders:
        key = f"rudders.{rudder.name}"
        for number in ("position", "angle"):
            marks[f"{key}.{number}"] = Provenance(says="assumed: measure it")
        turns = f'motor = "{vessel.thrusters[0].name}"'
        marks[f"{key}.area"] = Provenance(says=f"{A_BLADE}: {turns}, without area and wash")
        marks[f"{key}.wash"] = Provenance(says="assumed: the thruster ahead of the blade, if any")
        marks[f"{key}.pwm"] = Provenance(says="from the log's parameters")
    return marks


GIVEN = "given"  # the origin of a number that stands in the file without provenance
DEFAULT = "default"  # … that does not stand in it


@dataclass(frozen=True)
class Number:
    """One number of a vessel; `edited`: it is another one than its provenance gave.

    unsaid  where a number without provenance comes from: given, default, assumed
    """

    name: str
    value: float
    unit: str
    origin: Provenance | None
    edited: bool = False
    unsaid: str = GIVEN

    @property
    def source(self) -> str:
        """Where it comes from, in words."""
        if self.origin is None:
            return self.unsaid
        parts = (self.origin.fit, self.origin.recording, self.origin.date, self.origin.says)
        known = ", ".join(shortened(part, MAX_TOLD) for part in parts if part)
        if self.edited and self.origin.value is not None:
            return f"edited by hand, within its interval; {self.origin.value:.5g} by {known}"
        return known

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        origin = {} if self.origin is None else self.origin.model_dump(exclude_defaults=True)
        return {"name": self.name, "value": self.value, "unit": self.unit, "edited": self.edited,
                "source": self.source, "origin": origin}  # fmt: skip


@dataclass(frozen=True)
class Passport:
    """A vessel file: its vessel, its tables, and every number with its origin."""

    path: Path
    vessel: Vessel
    tables: VesselFile
    numbers: tuple[Number, ...]

    def number(self, name: str) -> Number | None:
        """The number of that name."""
        return next((one for one in self.numbers if one.name == name), None)

    def to_dict(self) -> dict[str, Any]:
        """What `shadow vessel show --json` prints."""
        return {
            "file": str(self.path), "name": self.vessel.name, "source": self.vessel.source,
            "effects": [added.effect.name for added in self.vessel.effects],
            "numbers": [one.to_dict() for one in self.numbers],
        } | self.history_as_dict()  # fmt: skip

    def history_as_dict(self) -> dict[str, Any]:
        """What `shadow vessel history --json` prints."""
        return {"history": [one.model_dump() for one in self.tables.history]}


@dataclass(frozen=True)
class Difference:
    """A number that two files do not share; None where a file has none of that name.

    beyond  whether it has left the 95 % interval of either; None where neither states one
    """

    name: str
    unit: str
    first: float | None
    second: float | None
    beyond: bool | None

    @property
    def share(self) -> float | None:
        """Change relative to the first, more damping positive; None without one, or from zero."""
        if self.first is None or self.second is None or self.first == 0.0:
            return None
        return self.second / self.first - 1.0

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**vars(self), "share": self.share}


def passport(path: str | Path, effects: Iterable[Effect] = ()) -> Passport:
    """Read a vessel file with the origins of its numbers; BadInput where it is wrong."""
    vessel, tables = load_vessel(path, effects), read_vessel_file(path)
    origins = {number_name(key): (key, origin) for key, origin in tables.provenance.items()}
    edited, units = edited_numbers(tables, vessel), _units(vessel)
    numbers = []
    for name, value in parameters_of(vessel).items():
        in_file = file_key(name, tables)
        whole = tables.provenance.get(in_file.key)
        key, origin = origins.get(name, (in_file.key, whole))
        unsaid = GIVEN if in_file.given else ASSUMED_AREAS if name in AREAS else DEFAULT
        numbers.append(Number(name, value, units.get(name, ""), origin, key in edited, unsaid))
    return Passport(Path(path), vessel, tables, tuple(numbers))


def _units(vessel: Vessel) -> dict[str, str]:
    """Units by name: those of the vessel file's numbers, and those that effects declare."""
    out = {name: UNITS.get(name.rpartition(".")[2], "") for name in parameters_of(vessel)}
    for added in vessel.effects:
        out |= {f"{added.effect.name}.{p.name}": p.unit for p in added.effect.parameters}
    return out


def differences(first: Passport, second: Passport) -> list[Difference]:
    """All numbers that differ, in the order of the first file."""
    names = dict.fromkeys(one.name for one in (*first.numbers, *second.numbers))
    out = []
    for name in names:
        a, b = first.number(name), second.number(name)
        first_value, second_value = (None if n is None else n.value for n in (a, b))
        if first_value != second_value:
            unit = next(n.unit for n in (a, b) if n is not None)
            out.append(Difference(name, unit, first_value, second_value, _beyond(a, b)))
    return out


def _beyond(a: Number | None, b: Number | None) -> bool | None:
    if a is None or b is None:
        return None
    held = [
        one.origin.ci95[0] <= other.value <= one.origin.ci95[1]
        for one, other in ((a, b), (b, a))
        if one.origin is not None and one.origin.ci95 is not None
    ]
    return not all(held) if held else None


def outputs_that_differ(first: Vessel, second: Vessel) -> list[str]:
    """A sentence for each actuator that only one has, or that is wired in another way."""
    ours, theirs = ({a.name: a for a in v.actuators} for v in (first, second))
    out = [f"{name}: only in the first" for name in ours.keys() - theirs.keys()]
    out += [f"{name}: only in the second" for name in theirs.keys() - ours.keys()]
    for name in ours.keys() & theirs.keys():
        if ours[name].servo != theirs[name].servo:
            out.append(f"{name}: {ours[name].servo} is {theirs[name].servo}")
    return sorted(out)


def diff_as_dict(first: Passport, second: Passport) -> dict[str, Any]:
    """What `shadow vessel diff --json` prints."""
    return {
        "first": str(first.path), "second": str(second.path),
        "numbers": [one.to_dict() for one in differences(first, second)],
        "outputs": outputs_that_differ(first.vessel, second.vessel),
    }  # fmt: skip
