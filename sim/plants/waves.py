"""A hull on the water: how it heaves, rolls and pitches, and what waves do to it.

**Hydrostatics**: heave, roll and pitch as three damped oscillators.

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

**Waves**: long-crested trains of a spectrum, and the load of each by Froude and Krylov.

    ζ = Σ a_i sin φ_i,   φ_i = ω_i t − k_i (N cos β + E sin β) + ε_i,   k_i = ω_i² / g

ζ [m, up] elevation at a place, a_i amplitudes, β direction towards [rad from north], ε_i phases. A
hull of length L and beam B averages what is shorter than itself:

    f_i = sinc(k_i L cos χ / 2) sinc(k_i B sin χ / 2),   χ = β − ψ

The pressure under the waves pushes the hull down the slope of the water, turns it by the change of
that slope along its length, lifts it and tilts it:

    X = −m g ζ_x,  Y = −m g ζ_y,  N = −m g L²/12 ζ_xy,   z_w = −ζ,  φ_w = −ζ_y,  θ_w = ζ_x

ζ_x, ζ_y, ζ_xy: derivatives along the hull and across, each train times its f_i. Diffraction and the
slow drift of second order are left out. Amplitudes follow the spectrum of ITTC's JONSWAP (γ = 3.3)
for a significant height H_s and a peak period T_p. Valid for: deep water, waves that do not break,
hulls of small draught. Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control,
2nd ed. 2021, §10.2; Faltinsen, Sea Loads on Ships and Offshore Structures, 1990, §2, §3.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import PCG64, Generator

from sim.jit import jitable
from sim.state import Floats

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


TRAINS = 24  # of a spectrum: their sum repeats after minutes, not seconds
LOWEST, HIGHEST = 0.6, 2.6  # of the peak frequency: 99 % of the energy lies between
PEAKEDNESS = 3.3  # γ of the North Sea
STEEPEST = 0.1  # height / length of waves that do not break


class WaveLoad(NamedTuple):
    """What waves do to a hull at one moment."""

    X: float  # N
    Y: float  # N
    N: float  # N m
    heave: float  # m, down: where the surface would carry it
    roll: float  # rad
    pitch: float  # rad
    elevation: float  # m, up, of the water at the body origin


@jitable
def averaged(x: float) -> float:
    """sin x / x: mean of a wave over a length, x half of it in radians of the wave."""
    return np.sinc(x / np.pi)


@jitable
def wave_load(
    waves: Floats, s: HullShape, north: float, east: float, yaw: float, time: float
) -> WaveLoad:
    """Trains (K, 5): amplitude [m], ω [rad/s], k [rad/m], β, ε [rad] -> their load at a place."""
    zeta, mean, slope_x, slope_y, twist = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(waves)):
        a, omega, k, beta, phase = waves[i, 0], waves[i, 1], waves[i, 2], waves[i, 3], waves[i, 4]
        turn = omega * time - k * (north * np.cos(beta) + east * np.sin(beta)) + phase
        c, d = np.cos(beta - yaw), np.sin(beta - yaw)
        f = a * averaged(0.5 * k * s.length * c) * averaged(0.5 * k * s.beam * d)
        zeta += a * np.sin(turn)
        mean += f * np.sin(turn)
        slope_x -= f * k * c * np.cos(turn)
        slope_y -= f * k * d * np.cos(turn)
        twist -= f * k * k * c * d * np.sin(turn)
    weight = s.mass * GRAVITY
    return WaveLoad(
        -weight * slope_x,
        -weight * slope_y,
        -weight * s.length**2 / 12.0 * twist,
        -mean,
        -slope_y,
        slope_x,
        zeta,
    )


@dataclass(frozen=True)
class Sea:
    """Irregular waves: significant height [m], peak period [s], direction towards [rad]."""

    height: float
    period: float
    direction: float = 0.0

    def __post_init__(self) -> None:
        if not self.height >= 0.0:
            raise ValueError(f"height = {self.height:g}: expected 0 m or more")
        if not self.period > 0.0:
            raise ValueError(f"period = {self.period:g}: expected more than 0 s")
        length = GRAVITY * self.period**2 / (2.0 * np.pi)
        if self.height > STEEPEST * length:
            raise ValueError(
                f"height = {self.height:g} m with a period of {self.period:g} s: such waves break; "
                f"expected {STEEPEST * length:.2g} m or less, or a longer period"
            )

    def trains(self, seed: int) -> Floats:
        """(TRAINS, 5) amplitude, ω, k, β, ε for `wave_load`; none for a height of 0."""
        if self.height == 0.0:
            return no_waves()
        rng = Generator(PCG64((seed, TRAINS)))
        peak = 2.0 * np.pi / self.period
        edges = peak * np.geomspace(LOWEST, HIGHEST, TRAINS + 1)
        omega = edges[:-1] + rng.uniform(size=TRAINS) * np.diff(edges)  # no common multiple
        ratio = omega / peak
        width = np.where(ratio <= 1.0, 0.07, 0.09)
        bump = PEAKEDNESS ** np.exp(-((ratio - 1.0) ** 2) / (2.0 * width**2))
        energy = ratio**-5 * np.exp(-1.25 * ratio**-4) * bump * np.diff(edges)
        amplitude = np.sqrt(2.0 * energy * (self.height / 4.0) ** 2 / energy.sum())
        phase = 2.0 * np.pi * rng.uniform(size=TRAINS)
        direction = np.full(TRAINS, self.direction)
        return np.column_stack([amplitude, omega, omega**2 / GRAVITY, direction, phase])


def no_waves() -> Floats:
    """Calm water: no trains (0, 5)."""
    return np.zeros((0, 5))
