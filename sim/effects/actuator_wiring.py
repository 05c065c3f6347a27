"""Actuator wiring: a plug in the wrong socket, or a motor that runs the wrong way round.

    c_i = s_i c_j,   j = digit i of `order`
    s_i = −1 where i is a digit of `reversed`, else 1

Actuators count from 1 as in the vessel file, thrusters first. order = 21: the first does what was
meant for the second, and the second what was meant for the first; order = 0: each its own.
reversed = 2: the second runs the wrong way round; 12: both; 0: none. Valid for: up to nine
actuators, as many digits in `order` as there are actuators. Source: ArduPilot documentation, Rover,
motor and servo configuration (checks of order and direction).
"""

from typing import Any

import numpy as np

from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Kind, Parameter, Scope, Values
from sim.effects.words import FittedValues

MAX_ACTUATORS = 9  # one decimal digit each


def wiring(commands: tuple[float, ...], place: float, p: Any) -> float:
    """All commands -> the one that the actuator at `place` (0, 1, …) gets [−1 … 1]."""
    digit = np.floor(p.order / 10.0 ** (len(commands) - 1 - place)) % 10.0
    source = digit - 1.0 + (digit == 0.0) * (place + 1.0)
    command = 0.0 * place
    for i in range(len(commands)):
        command = command + (source == i) * commands[i]
    turned = 0.0 * p.reversed
    for k in range(MAX_ACTUATORS):
        turned = turned + (np.floor(p.reversed / 10.0**k) % 10.0 == place + 1.0)
    return command * (1.0 - 2.0 * np.minimum(turned, 1.0))


def wirings(vessel: Any, _: object = None) -> list[Values]:
    """Plugs of port and starboard swapped, single motors or all of them the wrong way round."""
    count = len(vessel.actuators)
    own = "".join(str(i + 1) for i in range(count))
    all_motors = "".join(str(i + 1) for i in range(len(vessel.thrusters)))
    orders = [0.0, float(_mirrored(vessel))] if _mirrored(vessel) != own else [0.0]
    turned = [0.0, *(float(i + 1) for i in range(count)), float(all_motors or 0)]
    points = [{"order": o, "reversed": r} for o in orders for r in dict.fromkeys(turned)]
    return [p for p in points if p["order"] or p["reversed"]]


def _mirrored(vessel: Any) -> str:
    """The order in which each thruster gets the command of the one on the other side."""
    place = [np.array(t.position) for t in vessel.thrusters]
    digits = []
    for p in place:
        away = [float(np.hypot(*(q - p * [1.0, -1.0]))) for q in place]
        digits.append(str(int(np.argmin(away)) + 1))
    digits += [str(i + 1) for i in range(len(place), len(vessel.actuators))]
    return "".join(digits)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    order, backwards = (str(int(p[name])) for name in ("order", "reversed"))
    moved = [
        (i, int(digit)) for i, digit in enumerate(order, 1) if order != "0" and int(digit) != i
    ]
    parts = []
    if len(moved) == 2:
        parts.append(
            f"actuators {moved[0][0]} and {moved[1][0]} of the file get each other's commands"
        )
    elif moved:
        parts.append(", ".join(f"actuator {i} gets what is meant for {j}" for i, j in moved))
    if backwards != "0":
        verb = "runs" if len(backwards) == 1 else "run"
        of_file = "" if moved else " of the file"
        parts.append(f"actuator {' and '.join(backwards)}{of_file} {verb} the wrong way round")
    return " and ".join(parts) or "the actuators are wired as the vessel file says"


def mismatch(vessel: Any, values: Values) -> str:
    """Why digits are none of the vessel's actuators; empty where they are."""
    count = len(vessel.actuators)
    known = {str(i + 1) for i in range(count)}
    order, turned = (f"{values[name]:.0f}" for name in ("order", "reversed"))
    if order != "0" and (len(order) != count or not known.issuperset(order)):
        return (
            f"order = {order}: expected 0, or one digit from 1 to {count} for each of the "
            f"{count} actuators"
        )
    if turned != "0" and not known.issuperset(turned):
        return f"reversed = {turned}: expected 0, or digits from 1 to {count}"
    return ""


EFFECT = Effect(
    name="actuator_wiring",
    scope=Scope.BOAT,
    wiring=wiring,
    parameters=(
        Parameter(
            "order",
            "-",
            lower=0.0,
            upper=987654321.0,
            start=0.0,
            scale=1.0,
            kind=Kind.CHOICE,
            neutral=0.0,
            description="one digit per actuator: whose command it gets; 0: its own, all of them",
        ),
        Parameter(
            "reversed",
            "-",
            lower=0.0,
            upper=123456789.0,
            start=0.0,
            scale=1.0,
            kind=Kind.CHOICE,
            neutral=0.0,
            description="digits: the actuators that run the wrong way round; 0: none",
        ),
    ),
    looks_like="turns to the wrong side, or goes astern, or turns when it should go straight on",
    evidence=EvidenceAxis(ForceAxis.YAW, "helm"),
    search=wirings,
    mismatch=mismatch,
    in_words=in_words,
    example={"order": 21.0, "reversed": 0.0},
)
