"""Thruster lag: the shaft needs time, so thrust follows the command as a first-order lag.

    Ḟ = (F_commanded − F) / tau        tau [s], one state F [N] per thruster

Valid for: fixed-pitch propellers on speed-controlled motors. Source: Fossen, Handbook of Marine
Craft Hydrodynamics, 2nd ed. 2021, §9.3 (propeller shaft dynamics, linearised).
"""

from typing import Any

from sim.body import ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Role,
    Scope,
    Separation,
    Shown,
    Symptom,
)
from sim.effects.words import FittedValues


def thrust_rate(thrust: float, state: float, drive: ThrusterParameters, p: Any) -> float:
    """Commanded and acting thrust [N] -> rate of the acting thrust [N/s]."""
    return (thrust - state) / p.tau


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"thrust follows the throttle {p.size('tau', 's')} late"


EFFECT = Effect(
    name="thruster_lag",
    scope=Scope.BOAT,
    thrust_rate=thrust_rate,
    parameters=(
        Parameter(
            "tau", "s", lower=0.02, upper=5.0, start=0.3, scale=0.05, role=Role.TIME_CONSTANT
        ),
    ),
    looks_like="the boat answers late to every change of throttle, and right once it is steady",
    mistaken_for=("command_delay", "velocity_latency", "steering_lag"),
    shown_by=(Shown.COMMANDS,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "throttle_change"),
    separated={
        "command_delay": Separation(
            "steps and quick swings: a lag rounds them, a delay only moves them", "chirp"
        )
    },
    explains=(Symptom.LATE_COMMANDS,),
    in_words=in_words,
)
