"""How a hull heaves, rolls and pitches on the water: three damped oscillators.

    ω_z² = ρ g A_w / (m + A₃₃)      A_w [m²] area of the waterline, A₃₃ ≈ m
    ω_φ² = g GM_T / (1.2 k_φ²)      GM_T [m] transverse metacentric height, k_φ = 0.35 B
    ω_θ² = g GM_L / (2.0 k_θ²)      GM_L [m] longitudinal metacentric height, k_θ = 0.25 L

The factors 1.2 and 2.0 are the added inertia of the water. Where the vessel file has no A_w and no
metacentric heights they follow from length L, beam B and mass m of a box that fills 0.7 of L B:

    A_w = 0.7 L B,   GM_T = ρ A_w B² / (12 m),   GM_L = ρ A_w L² / (12 m)

(BM of the box; the height of the centre of gravity above that of buoyancy is left out). Damping
ratios: 0.3 in heave and pitch, 0.1 in roll. Valid for: small angles, hulls that are symmetric fore
and aft and to the sides. Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion
Control, 2nd ed. 2021, §4.2, §5.5 (hydrostatics, natural periods); Faltinsen, Sea Loads on Ships
and Offshore Structures, 1990, §3 (added mass in heave, damping of roll).
"""

from typing import NamedTuple

import numpy as np

from sim.jit import jitable

WATER_DENSITY = 1025.0  # kg/m³
GRAVITY = 9.80665  # m/s²
WATERLINE_SHARE = 0.7  # of length × beam
ADDED_HEAVE, ADDED_ROLL, ADDED_PITCH = 2.0, 1.2, 2.0  # factors on the inertia of the hull alone
ROLL_RADIUS, PITCH_RADIUS = 0.35, 0.25  # radii of gyration, shares of beam and length
HEAVE_DAMPING, ROLL_DAMPING, PITCH_DAMPING = 0.3, 0.1, 0.3  # of critical


class HullShape(NamedTuple):
    """What the waves and the three oscillators read of a hull."""

    length: float  # m
    beam: float  # m
    mass: float  # kg
    heave_rate: float  # rad/s, natural, undamped
    roll_rate: float
    pitch_rate: float
    heave_damping: float  # of critical
    roll_damping: float
    pitch_damping: float
    waterplane_area: float  # m²
    gm_transverse: float  # m
    gm_longitudinal: float  # m


def hull_shape(
    length: float,
    beam: float,
    mass: float,
    waterplane_area: float = 0.0,
    metacentric_heights: tuple[float, float] = (0.0, 0.0),
) -> HullShape:
    """Hull [m, m, kg, m², m] -> its three oscillators; what is 0 follows from the size."""
    area = waterplane_area or WATERLINE_SHARE * length * beam
    per_mass = WATER_DENSITY * area / (12.0 * mass)
    transverse = metacentric_heights[0] or per_mass * beam**2
    longitudinal = metacentric_heights[1] or per_mass * length**2
    roll_inertia = ADDED_ROLL * (ROLL_RADIUS * beam) ** 2
    pitch_inertia = ADDED_PITCH * (PITCH_RADIUS * length) ** 2
    return HullShape(
        length,
        beam,
        mass,
        float(np.sqrt(WATER_DENSITY * GRAVITY * area / (ADDED_HEAVE * mass))),
        float(np.sqrt(GRAVITY * transverse / roll_inertia)),
        float(np.sqrt(GRAVITY * longitudinal / pitch_inertia)),
        HEAVE_DAMPING,
        ROLL_DAMPING,
        PITCH_DAMPING,
        area,
        transverse,
        longitudinal,
    )


@jitable
def oscillator_step(
    q: float, q_dot: float, target: float, rate: float, damping: float, h: float
) -> tuple[float, float]:
    """q, q̇ after h [s] of q̈ + 2 ζ ω q̇ + ω² (q − target) = 0, exact; ζ < 1, ω [rad/s]."""
    decay, turn = damping * rate, rate * np.sqrt(1.0 - damping * damping)
    fade, c, s = np.exp(-decay * h), np.cos(turn * h), np.sin(turn * h)
    away = q - target
    a, b = away, (q_dot + decay * away) / turn
    after = fade * (a * c + b * s)
    return target + after, fade * turn * (b * c - a * s) - decay * after
