"""`shadow init`: an initial vessel file from the autopilot's parameters in a log.

Channels, functions, pulse limits and directions come from the parameters. Size, mass and thrust
cannot be known from a log: the user gives them, and what follows from them is marked as a guess.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from gateway.errors import BadInput
from gateway.files import write_whole
from gateway.ingest.log import choose_floating
from gateway.ingest.open import open_log
from gateway.ingest.parameters import THRUST_FUNCTIONS, Actuator, OutputFunction, actuators
from gateway.toml_file import explain
from gateway.vessel_file import dump_vessel, read_vessel_file
from gateway.vessel_tables import GUESSED, Provenance, RudderTable, ThrusterTable, VesselFile
from sim.identification.settings import BASE
from sim.vessel import Dynamics, Hull, Rudder, Servo, Thruster, Vessel

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
    log_path: Path,
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
    log = open_log(log_path)
    parameters = log.parameters(choose_floating(log, system, anyway))
    if not parameters:
        raise BadInput(
            f"{log_path}: no parameters in it (PARAM_VALUE, PARM): record from boot or fetch "
            "them with the ground station, or copy a file from configs/vessels"
        )
    text = first_vessel(log_path, name or log_path.stem, actuators(parameters), given)
    write_whole(out, text.encode(), "the vessel file")
    return read_vessel_file(out)


def initial_vessel_dict(made: VesselFile, out: Path) -> dict[str, object]:
    """What was written as plain values: the file, its actuators, where each number is from."""
    parts: list[ThrusterTable | RudderTable] = [*made.thrusters, *made.rudders]
    return {
        "written": str(out),
        "name": made.name,
        "actuators": [
            {"name": a.name, "channel": a.channel, "pwm_us": list(a.pwm), "reversed": a.reversed}
            for a in parts
        ],
        "provenance": {key: origin.says for key, origin in made.provenance.items()},
    }


def check_size(given: Mapping[str, float]) -> None:
    """BadInput where a size is none."""
    for key, value in given.items():
        if not 0.0 < value < float("inf"):
            raise BadInput(f"--{key.replace('_', '-')} {value}: expected a positive number")


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
            "no output drives the boat (SERVOn_FUNCTION 70, 73, 74 or 33 to 36): "
            "write the [[thrusters]] by hand, see configs/vessels"
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
    return vessel, _provenance(vessel, given)


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
    return Thruster(name, Servo(a.channel, a.pwm, a.reversed), position, thrust)


def _rudder(a: Actuator, name: str, behind: str, size: BoatSize) -> Rudder:
    area = round(0.02 * size.length * 0.2 * size.length, 4)  # a small share of the lateral plane
    return Rudder(
        name, Servo(a.channel, a.pwm, a.reversed), (-0.5 * size.length, 0.0), (-0.6, 0.6),
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
    return marks
