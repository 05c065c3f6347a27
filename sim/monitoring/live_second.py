"""One second of a live voyage, averaged; the balance linearised about it, and the wind load there.

    F(ν, ν̇) = balance of the vessel,     slopes ∂F/∂ν and ∂F/∂ν̇ by one-sided differences

A steady current is a frame that moves: the boat meets the water with ν − c and ν̇ − ċ, where
c = (u_c, v_c, 0) and ċ = (r v_c, −r u_c, 0). Memory of actuators is left out of the slopes: it
adds the same thrust on both sides of each difference.

With wind areas the wind load is that of `sim.wind_loads`:

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

written in g = |V_w| V_w, in which it is nearly linear. Without areas a speed cannot be told, and g
is a force [N] that is fixed in the world.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.state import Eta, Floats, Nu, to_body
from sim.vessel import Vessel
from sim.wind_loads import AIR_DENSITY, C_N, C_X, C_Y

# All chosen, not measured.
DIFFERENCE_STEP = 1e-3  # m/s, rad/s and per s: of the slopes of the balance
WIND_PRIOR_MPS = 12.0  # standard deviation of the wind's speed
WIND_FORCE_PRIOR = 0.3  # the same without areas, of the thrust full ahead
WIND_STEP = 0.15  # of the prior: near g = 0 a slope on the spot would be that of a root
NO_CURRENT = np.zeros(2)


@dataclass(frozen=True)
class SecondMeans:
    """Means over one second of a live voyage.

    motion       (9,)  reported eta, nu, nu_dot       variance     (3,)  of u, v, r
    missing      (3,)  X, Y, N [N, N, N m]            missing_std  (3,)  as stated
    commanded    (3,)  τ(commands)                    commands     (na,) the latest
    errors       (H, 3) u, v, r: latest prediction errors that came due, NaN where none did
    mean_commands (na,)  their mean
    """

    time: float
    motion: Floats
    variance: Floats
    missing: Floats
    missing_std: Floats
    commanded: Floats
    commands: Floats
    errors: Floats
    mean_commands: Floats

    @property
    def yaw(self) -> float:
        """Heading [rad]."""
        return float(self.motion[Eta.YAW])

    @property
    def nu(self) -> Floats:
        """Velocity over ground (3,)."""
        return self.motion[3:6]


@dataclass(frozen=True)
class Balance:
    """Balance of a vessel (3,) in still and in moving water, slopes (3, 3) in the moving.

    slope_nu  ∂F/∂ν                slope_nu_dot  ∂F/∂ν̇
    """

    still_water: Floats
    moving_water: Floats
    slope_nu: Floats
    slope_nu_dot: Floats

    @property
    def system_matrix(self) -> Floats:
        """∂ν̇/∂ν of the free vessel: (3, 3) [1/s and mixed]."""
        return np.asarray(-np.linalg.solve(self.slope_nu_dot, self.slope_nu), dtype=float)


def world_to_body(world: Floats, yaw: float) -> Floats:
    """North, east (2,) -> ahead, to starboard (2,)."""
    return np.array(to_body(world[0], world[1], yaw))


def current_shift(current: Floats, second: SecondMeans) -> Floats:
    """Water moving north, east (2,) [m/s] -> what it takes off (ν, ν̇): (6,)."""
    u_c, v_c = world_to_body(current, second.yaw)
    r = second.nu[Nu.R]
    return np.array([u_c, v_c, 0.0, r * v_c, -r * u_c, 0.0])


def balance_at(model: Model, second: SecondMeans, current: Floats = NO_CURRENT) -> Balance:
    """The balance of a vessel in still water and in a current, with its slopes there."""
    rows = np.tile(second.motion, (8, 1))
    rows[1:, 3:] = second.motion[3:] - current_shift(current, second)
    rows[2:, 3:] += DIFFERENCE_STEP * np.eye(6)
    commands = np.tile(second.commands, (8, 1))
    force, _ = model.missing_force(rows, np.full(8, second.time), commands, commands)
    slopes = (force[2:] - force[1]).T / DIFFERENCE_STEP
    return Balance(force[0], force[1], slopes[:, :3], slopes[:, 3:])


@dataclass(frozen=True)
class WindModel:
    """Frontal, lateral area [m²] and length [m]; prior (standard deviation) of each g."""

    front: float
    side: float
    length: float
    prior: float

    @classmethod
    def of(cls, vessel: Vessel, thrust: float) -> "WindModel":
        """Thrust full ahead [N] gives the size of a force where there are no areas."""
        front, side = vessel.hull.wind_area
        areas = front > 0.0 and side > 0.0
        prior = WIND_PRIOR_MPS**2 if areas else WIND_FORCE_PRIOR * thrust
        return cls(front, side, vessel.hull.length, prior)

    @property
    def has_areas(self) -> bool:
        """Whether a force can be told as a wind."""
        return self.front > 0.0 and self.side > 0.0

    def force_and_slope(self, g: Floats, second: SecondMeans) -> tuple[Floats, Floats]:
        """g north, east (2,) -> X, Y, N (3,) and their slope against g (3, 2)."""
        h = WIND_STEP * self.prior
        slope = [
            (self.force(g + step, second) - self.force(g - step, second)) / (2.0 * h)
            for step in h * np.eye(2)
        ]
        return self.force(g, second), np.array(slope).T

    def force(self, g: Floats, second: SecondMeans) -> Floats:
        """g north, east (2,) -> X, Y, N (3,) [N, N, N m]."""
        if not self.has_areas:
            return np.append(world_to_body(g, second.yaw), 0.0)
        u_w, v_w = world_to_body(air_velocity(g), second.yaw)
        u, v = second.nu[0] - u_w, second.nu[1] - v_w
        V = np.hypot(u, v)
        return AIR_DENSITY * np.array([
            -0.5 * C_X * self.front * V * u,
            -0.5 * C_Y * self.side * V * v,
            -C_N * self.side * self.length * u * v,
        ])  # fmt: skip

    def world_force(self, g: Floats, second: SecondMeans) -> Floats:
        """g north, east (2,) -> the force on the boat as it lies, north, east (2,) [N]."""
        return world_to_body(self.force(g, second)[:2], -second.yaw)


def air_velocity(g: Floats) -> Floats:
    """g = |V| V (2,) -> V, velocity of the air (2,) [m/s]."""
    size = float(np.hypot(g[0], g[1]))
    return g / np.sqrt(size) if size > 0.0 else np.zeros(2)


def air_velocity_covariance(g: Floats, covariance: Floats) -> Floats:
    """g (2,) with covariance (2, 2) -> covariance of V (2, 2).

    V = g / √|g| has no slope at 0: where g is not known to be larger, its spread is its size.
    """
    size = np.sqrt(float(g @ g) + float(np.trace(covariance)))
    slope = (np.eye(2) - 0.5 * np.outer(g, g) / size**2) / np.sqrt(size)
    return np.asarray(slope @ covariance @ slope.T)
