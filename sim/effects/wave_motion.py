"""Wave motion: a train of long-crested waves that pushes the boat to and fro as it passes.

    F = force sin(omega t − k s + phase)
    k = omega² / g,   s = N cos direction + E sin direction

F acts along direction [rad from north, towards]; force [N] at the crests, omega [rad/s], t [s after
the first sample], N and E [m] position, phase [rad], g = 9.81 m/s². Sailing with or against the
waves moves the frequency of encounter. Valid for: one frequency, deep water, waves longer than the
boat. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, §10.2 (dispersion and
frequency of encounter).
"""

from typing import NamedTuple

import numpy as np

from sim.body import Flow
from sim.effects.effect import Effect, Kind, Parameter, Scope
from sim.state import Wrench, to_body

GRAVITY = 9.81  # m/s²


class Parameters(NamedTuple):
    force: float
    omega: float
    direction: float
    phase: float


def force(flow: Flow, p: Parameters) -> Wrench:
    """Place, heading and time -> X, Y, N [N, N, N m]."""
    c, s = np.cos(p.direction), np.sin(p.direction)
    along = c * flow.north + s * flow.east
    k = p.omega * p.omega / GRAVITY
    push = p.force * np.sin(p.omega * flow.time - k * along + p.phase)
    X, Y = to_body(push * c, push * s, flow.yaw)
    return Wrench(X, Y, 0.0)


EFFECT = Effect(
    name="wave_motion",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter("force", "N", lower=0.0, upper=1000.0, start=5.0, scale=1.0, neutral=0.0),
        Parameter("omega", "rad/s", lower=0.2, upper=12.0, start=2.0, scale=0.05),
        Parameter("direction", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.1,
                  kind=Kind.CIRCLE, says="towards, clockwise from north"),
        Parameter("phase", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.2, kind=Kind.CIRCLE,
                  says="at the origin, at the first sample"),
    ),
    looks_like="an oscillation of one frequency and zero mean that is faster against the waves "
    "than with them; like sensor noise, but in a narrow band",
    partial=True,
)  # fmt: skip
