"""Thruster fault: one thruster weakens, or fails, at one moment.

    F_i → gain F_i   for i = thruster and t >= time

thruster counted from 1 in the order of the vessel file, gain [-] (0: dead), time [s after the first
sample]. Valid for: a lost blade, a line around the shaft, a motor in its emergency mode. Source:
Blanke, Kinnaert, Lunze and Staroswiecki, Diagnosis and Fault-Tolerant Control, 3rd ed. 2016 (loss
of effectiveness of an actuator).
"""

from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    TIME_OF_CHANGE,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Parameter,
    Scope,
    Separation,
    Shown,
    Values,
)
from sim.effects.words import FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    hit = 1.0 * (drive.number + 1.0 == p.thruster) * (flow.time >= p.time)
    return F * (1.0 + hit * (p.gain - 1.0))


SAME_RUN_TWICE = Separation(
    "the same run at the beginning and at the end, with a coast to a stop in each; a motor that "
    "fails also turns the boat",
    "steps",
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (f"thruster {p['thruster']:.0f} gives {p.size('gain', '%', 100.0)} of its thrust from "
            f"{p.moment('time')} on")  # fmt: skip


def mismatch(vessel: Any, values: Values) -> str:
    """Why there is no such thruster; empty where there is."""
    count = len(vessel.thrusters)
    if values["thruster"] > count:
        return f"thruster = {values['thruster']:g}: the vessel has {count}"
    return ""


EFFECT = Effect(
    name="thruster_fault",
    scope=Scope.VOYAGE,
    thrust=thrust,
    parameters=(
        Parameter(
            "thruster",
            "-",
            lower=1.0,
            upper=16.0,
            start=1.0,
            scale=1.0,
            kind=Kind.CHOICE,
            description="1, 2, … in the order of the vessel file",
        ),
        Parameter("gain", "-", lower=0.0, upper=2.0, start=0.5, scale=0.05, neutral=1.0),
        TIME_OF_CHANGE,
    ),
    looks_like="right up to one moment; from then on it pulls to one side and is slower",
    mistaken_for=("payload_change", "drag_growth", "battery_sag"),
    shown_by=(Shown.CHANGE,),
    general_of="thruster_imbalance",
    evidence=EvidenceAxis(ForceAxis.YAW, "time"),
    separated={
        "drag_growth": SAME_RUN_TWICE,
        "payload_change": SAME_RUN_TWICE,
        "battery_sag": Separation("one run with a full and one with a tired battery", "steps"),
    },
    mismatch=mismatch,
    in_words=in_words,
    pattern_for=("rhythm",),
)
