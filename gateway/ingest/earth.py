"""Latitude and longitude to metres on the plane that touches WGS-84 at an origin, and back.

    north = (φ − φ0) M,   east = (λ − λ0) N cos φ0
    M = a (1 − e²) / (1 − e² sin² φ0)^1.5,   N = a / (1 − e² sin² φ0)^0.5

Valid for: some kilometres around the origin, at sea level. Source: NIMA TR8350.2 (WGS-84).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim.state import Floats

A = 6_378_137.0  # m
E2 = 6.694379990141e-3


class Origin(NamedTuple):
    """Where a local frame starts."""

    latitude_deg: float
    longitude_deg: float


@lru_cache(maxsize=16)
def metres_per_degree(origin: Origin) -> tuple[float, float]:
    """Origin -> m per degree of latitude, of longitude."""
    sine = np.sin(np.radians(origin.latitude_deg))
    meridian = A * (1.0 - E2) / (1.0 - E2 * sine**2) ** 1.5
    parallel = A / (1.0 - E2 * sine**2) ** 0.5 * np.cos(np.radians(origin.latitude_deg))
    return float(np.radians(meridian)), float(np.radians(parallel))


def to_local(degrees: Floats, origin: Origin) -> Floats:
    """(..., 2) [latitude, longitude, degrees] -> (..., 2) [north, east, m]."""
    turned = degrees[..., 1] - origin.longitude_deg
    east = (turned + 180.0) % 360.0 - 180.0  # across the date line
    north = degrees[..., 0] - origin.latitude_deg
    return np.stack([north, east], axis=-1) * np.array(metres_per_degree(origin))


def to_degrees(metres: Floats, origin: Origin) -> Floats:
    """(..., 2) [north, east, m] -> (..., 2) [latitude, longitude, degrees]."""
    return np.asarray(metres / np.array(metres_per_degree(origin)) + np.array(origin))


def on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    """Are these the degrees of a place?"""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


def distance_m(one: Origin, other: Origin) -> float:
    """Distance between two places."""
    return float(np.hypot(*to_local(np.array(one), other)))
