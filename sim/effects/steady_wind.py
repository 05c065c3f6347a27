"""Steady wind: the air pushes the boat sideways and turns it on quartering headings.

    X = ½ ρ V² C_X A_F,   Y = ½ ρ V² C_Y A_L,   N = ½ ρ V² C_N A_L L
    C_X = −c_x cos γ,     C_Y = c_y sin γ,      C_N = c_n sin 2γ
    γ = −atan2(v_rw, u_rw)

V, u_rw, v_rw [m/s] of the boat through the air; A_F, A_L [m²] frontal and lateral area, L [m]
length of the hull; ρ = 1.225 kg/m³; c_x = 0.7, c_y = 0.825, c_n = 0.125, the middle of the
published ranges. The wind blows at speed [m/s] from direction [rad from north]; where the boat
measured the wind, that wind acts and the two parameters do not count. Gusts are not modelled. Valid
for: hulls symmetric fore and aft and to the sides. Without areas a speed cannot be told: what is
left is a force (`inertial_force`). Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, §10.1 (wind coefficients of symmetrical craft).
"""

from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    QUARTERS,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Need,
    Parameter,
    Scope,
    Separation,
    Shown,
    circular_parameter,
)
from sim.state import Wrench, to_body
from sim.wind_loads import AIR_DENSITY, C_N, C_X, C_Y


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity over ground and of the air -> X, Y, N [N, N, N m]."""
    assumed = (flow.wind_known - 1.0) * p.speed  # it blows from there: hence the sign
    north = flow.wind_known * flow.wind_north + assumed * np.cos(p.direction)
    east = flow.wind_known * flow.wind_east + assumed * np.sin(p.direction)
    u_w, v_w = to_body(north, east, flow.yaw)
    u, v = flow.u_ground - u_w, flow.v_ground - v_w
    body = flow.body
    V = np.sqrt(u * u + v * v)  # V cos γ = u, V sin γ = −v
    return Wrench(
        -0.5 * AIR_DENSITY * C_X * body.area_front * V * u,
        -0.5 * AIR_DENSITY * C_Y * body.area_side * V * v,
        -AIR_DENSITY * C_N * body.area_side * body.length * u * v,
    )


CIRCLES = Separation(
    "full circles: wind changes its side, a motor does not; then motors off", "circles"
)

EFFECT = Effect(
    name="steady_wind",
    scope=Scope.VOYAGE,
    force=force,
    needs=(Need.WIND_AREA,),
    parameters=(
        Parameter(
            "speed", "m/s", lower=0.0, upper=40.0, start=5.0, scale=0.5, direction="direction"
        ),
        circular_parameter("direction", "from, clockwise from north", starts=QUARTERS),
    ),
    looks_like="pushed away from one side of the world, most when lying across it, and turned on "
    "quartering headings; a boat with stopped motors drifts that way",
    mistaken_for=(
        "steady_current",
        "inertial_force",
        "compass_deviation",
        "thruster_imbalance",
        "thruster_misalignment",
    ),
    shown_by=(Shown.OPPOSITE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "heading"),
    separated={
        "inertial_force": Separation(
            "full circles at two speeds: the apparent wind grows with the boat's own speed",
            "circles",
        ),
        "compass_deviation": Separation(
            "full circles, ahead and astern, and a drift with the motors off", "circles"
        ),
        "thruster_imbalance": CIRCLES,
        "thruster_misalignment": CIRCLES,
    },
    pattern_for=("heading",),
)
