"""Thruster fault: one thruster, or all of them, weaken or fail at one moment.

    F_i → gain F_i   for i = thruster, or all i if thruster = 0, and t >= time

thruster counted from 1 in the order of the vessel file, gain [-] (0: dead), time [s after the first
sample]. Valid for: a lost blade, a line around the shaft, a motor in its emergency mode; of all
thrusters: an autopilot or a battery that limits the power from then on, another battery, weed that
was run into. Source: Blanke, Kinnaert, Lunze and Staroswiecki, Diagnosis and Fault-Tolerant
Control, 3rd ed. 2016 (loss of effectiveness of an actuator).
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

ALL = 0.0  # in the place of a thruster's number


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    this = 1.0 * ((p.thruster == ALL) | (drive.number + 1.0 == p.thruster))
    return F * (1.0 + this * (flow.time >= p.time) * (p.gain - 1.0))


def evidence_axis(values: Values) -> EvidenceAxis:
    """One thruster that fails turns the boat, all of them slow it."""
    return EvidenceAxis(ForceAxis.SURGE if values["thruster"] == ALL else ForceAxis.YAW, "time")


SAME_RUN_TWICE = Separation(
    "the same run at the beginning and at the end, with a coast to a stop in each; a single "
    "motor that fails also turns the boat",
    "steps",
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    share, moment = p.size("gain", "%", 100.0), p.moment("time")
    if p["thruster"] == ALL:
        return f"all thrusters give {share} of their thrust from {moment} on"
    return f"thruster {p['thruster']:.0f} gives {share} of its thrust from {moment} on"


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
            lower=0.0,
            upper=16.0,
            start=1.0,
            scale=1.0,
            kind=Kind.CHOICE,
            description="1, 2, … in the order of the vessel file; 0: all",
        ),
        Parameter("gain", "-", lower=0.0, upper=2.0, start=0.5, scale=0.05, neutral=1.0),
        TIME_OF_CHANGE,
    ),
    looks_like="right up to one moment; from then on it is slower and, if one thruster failed, "
    "pulls to one side",
    mistaken_for=("payload_change", "drag_growth", "battery_sag"),
    shown_by=(Shown.CHANGE,),
    general_of="thruster_imbalance",
    evidence=evidence_axis,
    separated={
        "drag_growth": SAME_RUN_TWICE,
        "payload_change": SAME_RUN_TWICE,
        "battery_sag": Separation("one run with a full and one with a tired battery", "steps"),
    },
    mismatch=mismatch,
    in_words=in_words,
    pattern_for=("rhythm",),
)
