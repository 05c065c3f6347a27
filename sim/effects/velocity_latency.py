"""Velocity latency: reported position and velocity over ground are old, heading and gyro are not.

    reported p, V at t = p, V at t − delay

delay [s], p and V in the world. A free run looks back along its own track. Where only one moment is
known, V − delay V̇ and p − delay V + ½ delay² V̇ stand for it: in the body frame u − delay (u̇ − r
v), v − delay (v̇ + r u). Accelerations come from the accelerometer and are in time. Valid for: a
receiver that is late by a constant time. Source: Groves, Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems, 2nd ed. 2013, ch. 14 (synchronisation of GNSS and
inertial data).
"""

from typing import Any

from sim.body import Report
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Separation,
    Shown,
    Symptom,
)
from sim.effects.words import FittedValues
from sim.state import to_world


def latency(p: Any) -> float:
    """Age of reported position and velocity over ground [s]."""
    return p.delay


def observe(report: Report, p: Any) -> Report:
    """Motion now -> with position and velocity as they were."""
    back = p.delay * (report.u_dot - report.r * report.v)
    right = p.delay * (report.v_dot + report.r * report.u)
    north, east = to_world(report.u - 0.5 * back, report.v - 0.5 * right, report.yaw)
    return Report(
        report.north - p.delay * north,
        report.east - p.delay * east,
        report.yaw,
        report.u - back,
        report.v - right,
        report.r,
        report.u_dot,
        report.v_dot,
        report.r_dot,
    )


QUICK_TURNS = Separation(
    "quick turns with a gyro in the log: a gyro is not late, a receiver's velocity is", "zigzag"
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"reported positions and speeds are {p.size('delay', 's')} old"


EFFECT = Effect(
    name="velocity_latency",
    scope=Scope.BOAT,
    observe=observe,
    latency=latency,
    parameters=(Parameter("delay", "s", lower=0.0, upper=2.0, start=0.1, scale=0.03, neutral=0.0),),
    looks_like="speed and place come late while turn rate and heading come in time; in a turn the "
    "boat seems to slip outwards",
    mistaken_for=("thruster_lag", "command_delay"),
    shown_by=(Shown.COMMANDS, Shown.VELOCITY),
    evidence=EvidenceAxis(ForceAxis.SURGE, "acceleration"),
    separated={"thruster_lag": QUICK_TURNS, "command_delay": QUICK_TURNS},
    explains=(Symptom.LATE_VELOCITY,),
    in_words=in_words,
)
