"""Yaw-rate bias: the gyro reads a constant rate too much.

    reported r = r + bias        bias [rad/s]

Valid for: hours of a MEMS gyro in even temperature; heading is not touched. Source: Groves,
Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd ed. 2013, §4.4.1.
"""

from typing import Any

from sim.body import Report
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import DEG, FittedValues


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a biased gyro reports it."""
    return Report(
        report.north,
        report.east,
        report.yaw,
        report.u,
        report.v,
        report.r + p.bias,
        report.u_dot,
        report.v_dot,
        report.r_dot,
    )


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "the gyro reads " + p.size(
        "bias", "°/s", DEG, after=" too fast to " + p.side("bias", "starboard", "port")
    )


EFFECT = Effect(
    name="yaw_rate_bias",
    scope=Scope.VOYAGE,
    observe=observe,
    parameters=(
        Parameter(
            "bias", "rad/s", lower=-0.3, upper=0.3, start=0.0, scale=0.003, neutral=0.0, sided=True
        ),
    ),
    looks_like="a turn rate that is off by the same amount always, at rest too, while the heading "
    "does not follow",
    evidence=EvidenceAxis(ForceAxis.YAW, "time"),
    in_words=in_words,
)
