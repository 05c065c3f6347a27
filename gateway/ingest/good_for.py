"""What a recording can teach, and what it cannot, in sentences with the reason in them."""

from collections.abc import Mapping

from gateway.ingest.boats import Boat
from gateway.ingest.sources import Choice

FAST_HZ = 5.0  # below, effects that act within a fraction of a second cannot be told
NOT_FLOATING = ("copter", "rotor", "wing", "plane", "vtol", "submarine", "helicopter", "airship")


def good_for(boat: Boat, choices: Mapping[str, Choice], ever_armed: bool | None) -> tuple[str, ...]:
    """One sentence per limit; a single "everything" sentence where there is none."""
    said = [
        *_vehicle(boat),
        *_motion(choices),
        *_commands(choices, ever_armed),
        *_surroundings(choices),
    ]
    return tuple(said) or ("motion and commands are complete and fast: all effects can be told",)


def _vehicle(boat: Boat) -> list[str]:
    if any(word in boat.type for word in NOT_FLOATING):
        return [f"the vehicle says that it is a {boat.type}: no model of a boat fits it"]
    return []


def _motion(choices: Mapping[str, Choice]) -> list[str]:
    said = []
    if "yaw" not in choices:
        said.append("no heading: surge cannot be told from sway, nothing can be identified")
    if "yaw rate" not in choices:
        said.append("no yaw rate: it follows from the heading alone, its noise is larger")
    moving = choices.get("velocity") or choices.get("position")
    if moving is None:
        said.append("no velocity and no position: nothing can be identified")
    elif moving.rate_hz < FAST_HZ:
        said.append(
            f"{moving.name} at {moving.rate_hz:.1f} Hz: accelerations are smoothed over about "
            f"{2.0 / max(moving.rate_hz, 0.1):.1f} s, quick manoeuvres teach little"
        )
    if "velocity" in choices and choices["velocity"].source == "VFR_HUD":
        said.append("velocity from VFR_HUD has no direction: sway and going astern are unknown")
    return said


def _commands(choices: Mapping[str, Choice], ever_armed: bool | None) -> list[str]:
    if "commands" not in choices:
        return ["no servo outputs: the motion can be shown, but no model be identified or compared"]
    said = []
    if ever_armed is False:
        said.append("never armed: nothing to identify")
    rate = choices["commands"].rate_hz
    if rate < FAST_HZ:
        said.append(
            f"commands at {rate:.1f} Hz: thruster lag, command delay and velocity latency cannot "
            f"be told from it ({FAST_HZ:.0f} Hz needed)"
        )
    return said


def _surroundings(choices: Mapping[str, Choice]) -> list[str]:
    said = []
    if "voltage" not in choices:
        said.append("no battery voltage: a sagging battery cannot be told from a weak motor")
    if "wind" not in choices:
        said.append("no measured wind: wind can only be inferred, and is easily taken for current")
    return said
