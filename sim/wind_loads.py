"""The wind force on a hull that is symmetric fore and aft and to the sides.

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

A_F, A_L frontal and lateral area above water [m²], L length [m], (u_rw, v_rw) velocity of the hull
through the air [m/s], V its size. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed.
2021, §10.1 (wind coefficients of symmetrical craft).
"""

import numpy as np

from sim.body import Flow
from sim.jit import jitable
from sim.state import Wrench, to_body

AIR_DENSITY = 1.225  # kg/m³ at 15 °C
C_X, C_Y, C_N = 0.7, 0.825, 0.125  # of 0.50–0.90, 0.70–0.95, 0.05–0.20
COEFFICIENT_FACTOR = 1.4  # that C_X and C_Y may be off by: 0.70 / 0.50


@jitable
def wind_load(flow: Flow, north: float, east: float, c_x: float, c_n: float) -> Wrench:
    """Motion of the hull, of the air [m/s, to north and east], coefficients ahead and of the moment
    -> X, Y, N [N, N, N m].
    """
    u_w, v_w = to_body(north, east, flow.yaw)
    u, v = flow.u_ground - u_w, flow.v_ground - v_w
    body = flow.body
    V = np.sqrt(u * u + v * v)  # V cos γ = u, V sin γ = −v
    return Wrench(
        -0.5 * AIR_DENSITY * c_x * body.area_front * V * u,
        -0.5 * AIR_DENSITY * C_Y * body.area_side * V * v,
        -AIR_DENSITY * c_n * body.area_side * body.length * u * v,
    )
