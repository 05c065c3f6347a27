"""Coefficients of the wind force on a hull that is symmetric fore and aft and to the sides.

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

A_F, A_L frontal and lateral area above water [m²], L length [m], (u_rw, v_rw) velocity of the hull
through the air [m/s], V its size. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed.
2021, §10.1 (wind coefficients of symmetrical craft).
"""

AIR_DENSITY = 1.225  # kg/m³ at 15 °C
C_X, C_Y, C_N = 0.7, 0.825, 0.125  # of 0.50–0.90, 0.70–0.95, 0.05–0.20
