"""Antenna offset: the antenna does not sit where the vessel file says.

    position + R(ψ) (x, y),   u − r y,   v + r x

x ahead, y to starboard [m]. The lever arm is beyond `sensors.antenna`. Valid for: a rigid mount.
Source: Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd ed.
2013, ch. 14 (lever arms).
"""

from collections.abc import Mapping
from typing import Any

from sim.body import Report
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import FittedValues
from sim.state import to_world


def observe(report: Report, p: Any) -> Report:
    """Motion where the antenna should be -> motion where it is."""
    north, east = to_world(p.x, p.y, report.yaw)
    return Report(
        report.north + north,
        report.east + east,
        report.yaw,
        report.u - report.r * p.y,
        report.v + report.r * p.x,
        report.r,
        report.u_dot - report.r_dot * p.y,
        report.v_dot + report.r_dot * p.x,
        report.r_dot,
    )


def within(vessel: Any) -> Mapping[str, tuple[float, float]]:
    """No further out than the ends of the hull [m], on an outrigger too."""
    far = 0.5 * vessel.hull.length
    return {"x": (-far, far), "y": (-far, far)}


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    along, across = p.side("x", " ahead", " aft"), p.side("y", " to starboard", " to port")
    return (f"the antenna does not sit where the file says, but {p.size('x', 'm', after=along)} "
            f"and {p.size('y', 'm', after=across)} of there")  # fmt: skip


EFFECT = Effect(
    name="antenna_offset",
    scope=Scope.BOAT,
    observe=observe,
    parameters=(
        Parameter("x", "m", lower=-20.0, upper=20.0, start=0.0, scale=0.05, neutral=0.0),
        Parameter(
            "y", "m", lower=-20.0, upper=20.0, start=0.0, scale=0.05, neutral=0.0, sided=True
        ),
    ),
    looks_like="sideways speed in proportion to the turn rate, at once and without any force; "
    "spots on the track that swing around the boat",
    mistaken_for=("cross_damping", "cg_offset"),
    evidence=EvidenceAxis(ForceAxis.SWAY, "turn_rate"),
    within=within,
    in_words=in_words,
)
