"""The wind force on a hull, and the areas above water of a boat whose file has none.

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw + s L Y

A_F, A_L frontal and lateral area above water [m²], L length [m], (u_rw, v_rw) velocity of the hull
through the air [m/s], V its size; s L how far ahead of midships the centre of the lateral area lies
[m]. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, §10.1 (wind coefficients
of symmetrical craft; the lever of the lateral area as with Blendermann).

**Areas** from length and beam:

    A_F = 0.10 L B,   A_L = 0.12 L²        L, B [m]; A_F, A_L frontal and lateral area [m²]

What is above the water of a small unmanned boat: hulls, a deck, a mast with aerials. The factors
are the middle of the boats whose areas are known or were judged from pictures: A_F / (L B) from
0.07 (WAM-V, 4.9 m) to 0.15 (an open boat of 1.8 m), A_L / L² from 0.07 (WAM-V) to 0.17 (light
catamarans of 1.2 m); of the shipped ones BlueBoat has 0.09 and 0.14, the demo boat 0.10 and 0.14.
All lie within `AREA_FACTOR` of what is assumed. Valid for: boats of 0.8 to 6 m without a cabin.

What a boat's motion tells of the wind is a force, ½ ρ V² C A: areas k times as large stand for a
wind 1/√k times as fast.
"""

import numpy as np

from sim.body import Flow
from sim.jit import jitable
from sim.state import Wrench, to_body

FRONT_SHARE, SIDE_SHARE = 0.10, 0.12  # A_F / (L B), A_L / L²
AREA_FACTOR = 2.0  # the areas are taken to be right to within this factor
DIGITS = 3  # of the areas: no more is known, and a file then holds exactly what is assumed


def assumed_wind_areas(length: float, beam: float) -> tuple[float, float]:
    """Length, beam [m] -> frontal, lateral area [m²]."""
    areas = (FRONT_SHARE * length * beam, SIDE_SHARE * length**2)
    front, side = (float(f"{area:.{DIGITS}g}") for area in areas)
    return front, side


def areas_text(front: float, side: float) -> str:
    """That areas [m²] were assumed, in words."""
    return (
        "areas above water assumed from length and beam: "
        f"frontal {front:.3g} m², lateral {side:.3g} m²"
    )


AIR_DENSITY = 1.225  # kg/m³ at 15 °C
C_X, C_Y, C_N = 0.7, 0.825, 0.125  # of 0.50–0.90, 0.70–0.95, 0.05–0.20
COEFFICIENT_FACTOR = 1.4  # that C_X and C_Y may be off by: 0.70 / 0.50


@jitable
def wind_load(
    flow: Flow, north: float, east: float, c_x: float, c_n: float, centre: float
) -> Wrench:
    """Motion of the hull, of the air [m/s, to north and east], coefficients ahead and of the
    moment, centre of the lateral area [lengths ahead of midships] -> X, Y, N [N, N, N m].
    """
    u_w, v_w = to_body(north, east, flow.yaw)
    u, v = flow.u_ground - u_w, flow.v_ground - v_w
    body = flow.body
    V = np.sqrt(u * u + v * v)  # V cos γ = u, V sin γ = −v
    Y = -0.5 * AIR_DENSITY * C_Y * body.area_side * V * v
    return Wrench(
        -0.5 * AIR_DENSITY * c_x * body.area_front * V * u,
        Y,
        body.length * (centre * Y - AIR_DENSITY * c_n * body.area_side * u * v),
    )
