"""Waves on a hull: long-crested trains of a spectrum, and the load of each by Froude and Krylov.

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
from sim.plants.hydrostatics import GRAVITY, HullShape
from sim.state import Floats

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
