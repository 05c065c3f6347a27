"""Command delay: everything happens as commanded, only later.

    c(t) → c(t − delay)        delay [s], of all thrusters and rudders

Valid for: slow buses, radio links, filters in speed controllers; one delay for all. Source: Åström
and Murray, Feedback Systems, 2nd ed. 2021, (time delays).
"""

from typing import Any

from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Shown, Symptom
from sim.effects.words import FittedValues


def delay(p: Any) -> float:
    """How much later all commands act [s]."""
    return p.delay


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"commands act {p.size('delay', 's')} late"


EFFECT = Effect(
    name="command_delay",
    scope=Scope.BOAT,
    delay=delay,
    parameters=(Parameter("delay", "s", lower=0.0, upper=3.0, start=0.2, scale=0.05, neutral=0.0),),
    looks_like="the whole motion comes late by the same time, fast and slow changes alike, turning "
    "included",
    mistaken_for=("thruster_lag", "velocity_latency", "steering_lag"),
    shown_by=(Shown.COMMANDS,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "throttle_change"),
    explains=(Symptom.LATE_COMMANDS,),
    in_words=in_words,
)
