"""Steering lag: the rudder, or the steered motor, follows its command as a first-order lag.

    δ̇ = (δ_commanded − δ) / tau        tau [s], one state δ [rad] per rudder

Valid for: servos and steering gear away from their limit of rate. Source: Fossen, Handbook of
Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (steering machine dynamics, linearised).
"""

from typing import Any

from sim.body import RudderParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Need,
    Parameter,
    Role,
    Scope,
    Separation,
    Shown,
)
from sim.effects.words import FittedValues


def angle_rate(angle: float, state: float, blade: RudderParameters, p: Any) -> float:
    """Commanded and acting angle [rad] -> rate of the acting angle [rad/s]."""
    return (angle - state) / p.tau


STEPS_ONE_BY_ONE = Separation(
    "steps of the throttle with the helm still, then of the helm at one throttle", "steps"
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"the steering follows its command {p.size('tau', 's')} late"


EFFECT = Effect(
    name="steering_lag",
    scope=Scope.BOAT,
    angle_rate=angle_rate,
    needs=(Need.STEERING,),
    parameters=(
        Parameter(
            "tau", "s", lower=0.02, upper=5.0, start=0.3, scale=0.05, role=Role.TIME_CONSTANT
        ),
    ),
    looks_like="turns begin and end late, while changes of speed come in time",
    mistaken_for=("thruster_lag", "command_delay"),
    shown_by=(Shown.COMMANDS,),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm_change"),
    separated={"thruster_lag": STEPS_ONE_BY_ONE, "command_delay": STEPS_ONE_BY_ONE},
    in_words=in_words,
)
