"""A hull in six degrees of freedom: what its vessel file says, and what follows from its size.

    columns (x_i, y_i, a_i) of the waterline, Σ a_i = A_w,   draught T = m / (ρ A_w)
    GM_T = ρ Σ a_i y_i² / m + z_g − T/2,   GM_L = ρ Σ a_i x_i² / m + z_g − T/2

Where the file has no columns, 6 × 4 of equal area stand so that A_w and both metacentric heights
are those of `sim.plants.hydrostatics`; no inertia: the radii of gyration there; no centre of
gravity z_g [m, down from the waterline at rest]: that of buoyancy, T/2; no freeboard: 0.1 of the
length. Added inertia and damping of heave, roll and pitch are those of `sim.plants.hydrostatics`.
"""

from typing import NamedTuple

import numpy as np

from sim.plants.hydrostatics import (
    ADDED_HEAVE,
    ADDED_PITCH,
    ADDED_ROLL,
    GRAVITY,
    HEAVE_DAMPING,
    PITCH_DAMPING,
    PITCH_RADIUS,
    ROLL_DAMPING,
    ROLL_RADIUS,
    WATER_DENSITY,
    hull_shape,
)
from sim.state import Floats
from sim.vessel import Vessel

ALONG, ACROSS = 6, 4  # columns of a hull whose file has none
FREEBOARD_SHARE = 0.1  # of the length, above the waterline


class FloatingNumbers(NamedTuple):
    """Numbers of a floating hull beside those of its balance."""

    mass: float  # kg
    I_x: float  # kg m², of the hull alone about its centre of gravity
    I_y: float
    I_z: float
    x_g: float  # m ahead of the origin
    z_g: float  # m below the waterline at rest
    draught: float  # m
    freeboard: float  # m
    thrust_depth: float  # m, where thrusters push
    added_heave: float  # kg
    added_roll: float  # kg m²
    added_pitch: float  # kg m²
    heave_damping: float  # N s/m
    roll_damping: float  # N m s
    pitch_damping: float  # N m s


class FloatingHull(NamedTuple):
    """Numbers, columns (K, 3) x, y [m], a [m²], and natural rates of heave, roll, pitch [rad/s]."""

    numbers: FloatingNumbers
    columns: Floats
    rates: tuple[float, float, float]


def floating_hull(vessel: Vessel) -> FloatingHull:
    """The hull of a vessel; ValueError where it would capsize or sink at rest."""
    hull, given = vessel.hull, vessel.floating
    columns = np.array(given.points) if given.points else _assumed_columns(vessel)
    x, y, a = columns.T
    area, m = float(a.sum()), hull.mass
    draught = m / (WATER_DENSITY * area)
    z_g = draught / 2.0 if given.centre_of_gravity is None else given.centre_of_gravity
    inertia = given.inertia or (
        m * (ROLL_RADIUS * hull.beam) ** 2,
        m * (PITCH_RADIUS * hull.length) ** 2,
        m * (PITCH_RADIUS * hull.length) ** 2,
    )
    x_c = float(a @ x) / area
    lever = z_g - draught / 2.0  # of weight below buoyancy
    height_t = WATER_DENSITY * float(a @ y**2) / m + lever
    height_l = WATER_DENSITY * float(a @ (x - x_c) ** 2) / m + lever
    for name, height in (("to the side", height_t), ("over its bow", height_l)):
        if height <= 0.0:
            raise ValueError(
                f"{vessel.name} would fall {name}: its metacentric height is {height:.3g} m; lower "
                "floating.centre_of_gravity, or move floating.points apart"
            )
    stiffness = WATER_DENSITY * GRAVITY * area, m * GRAVITY * height_t, m * GRAVITY * height_l
    total = ADDED_HEAVE * m, ADDED_ROLL * inertia[0], ADDED_PITCH * inertia[1]
    ratios = HEAVE_DAMPING, ROLL_DAMPING, PITCH_DAMPING
    rates = tuple(float(np.sqrt(k / i)) for k, i in zip(stiffness, total, strict=True))
    damping = [
        2.0 * z * float(np.sqrt(k * i)) for z, k, i in zip(ratios, stiffness, total, strict=True)
    ]
    numbers = FloatingNumbers(
        m, *inertia, vessel.dynamics.x_g, z_g, draught,
        FREEBOARD_SHARE * hull.length if given.freeboard is None else given.freeboard,
        draught if given.thruster_depth is None else given.thruster_depth,
        total[0] - m, total[1] - inertia[0], total[2] - inertia[1], *damping,
    )  # fmt: skip
    return FloatingHull(numbers, columns, (rates[0], rates[1], rates[2]))


def _assumed_columns(vessel: Vessel) -> Floats:
    """(K, 3) columns that float as hydrostatics has it: the same area and metacentric heights."""
    h = vessel.hull
    shape = hull_shape(h.length, h.beam, h.mass, h.waterplane_area, h.metacentric_heights)
    area = shape.waterplane_area
    per_height = h.mass / (WATER_DENSITY * area)  # GM -> mean square distance from the centre
    x = _unit_spread(ALONG) * np.sqrt(per_height * shape.gm_longitudinal) + vessel.dynamics.x_g
    y = _unit_spread(ACROSS) * np.sqrt(per_height * shape.gm_transverse)
    grid = np.array([(along, across) for along in x for across in y])
    return np.column_stack([grid, np.full(len(grid), area / len(grid))])


def _unit_spread(count: int) -> Floats:
    """Places (count,) at equal distances, of mean 0 and mean square 1."""
    places = np.arange(count) - 0.5 * (count - 1)
    return places / np.sqrt(np.mean(places**2))
