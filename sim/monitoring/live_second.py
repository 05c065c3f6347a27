"""One second of a live voyage, averaged, and the balance linearised about it.

    F(ν, ν̇) = balance of the vessel,     slopes ∂F/∂ν and ∂F/∂ν̇ by one-sided differences

A steady current is a frame that moves: the boat meets the water with ν − c and ν̇ − ċ, where
c = (u_c, v_c, 0) and ċ = (r v_c, −r u_c, 0). Memory of actuators is left out of the slopes: it
adds the same thrust on both sides of each difference.

What the air does to a boat, as a live estimate sees it.

With wind areas the law is that of `sim.wind_loads`:

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

written in g = |V_w| V_w, in which it is nearly linear. Without areas a speed cannot be told, and g
is a force [N] that is fixed in the world.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.state import Eta, Floats, Nu
from sim.vessel import Vessel
from sim.wind_loads import AIR_DENSITY, C_N, C_X, C_Y

STEP = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3])  # m/s, m/s, rad/s and per s
NO_CURRENT = np.zeros(2)


@dataclass(frozen=True)
class Moment:
    """Means over one second of a live voyage.

    motion     (9,)  reported eta, nu, nu_dot       variance  (3,)  of u, v, r
    missing    (3,)  X, Y, N [N, N, N m]            std       (3,)  of missing, as stated
    commanded  (3,)  τ(commands)                    commands  (na,) the latest
    errors     (H, 3) u, v, r: latest prediction errors that came due, NaN where none did
    """

    time: float
    motion: Floats
    variance: Floats
    missing: Floats
    std: Floats
    commanded: Floats
    commands: Floats
    errors: Floats

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
    """force (3,) through still and moving water, slopes (3, 3) against ν and ν̇ in the moving."""

    still: Floats
    moving: Floats
    velocity: Floats
    acceleration: Floats

    @property
    def rate(self) -> Floats:
        """∂ν̇/∂ν of the free vessel: (3, 3) [1/s and mixed]."""
        return np.asarray(-np.linalg.solve(self.acceleration, self.velocity), dtype=float)


def in_body(world: Floats, yaw: float) -> Floats:
    """North, east (2,) -> ahead, to starboard (2,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * world[0] + s * world[1], c * world[1] - s * world[0]])


def shift_by(current: Floats, moment: Moment) -> Floats:
    """Water moving north, east (2,) [m/s] -> what it takes off (ν, ν̇): (6,)."""
    u_c, v_c = in_body(current, moment.yaw)
    r = moment.nu[Nu.R]
    return np.array([u_c, v_c, 0.0, r * v_c, -r * u_c, 0.0])


def balance_at(model: Model, moment: Moment, current: Floats = NO_CURRENT) -> Balance:
    """The balance of a vessel at a moment, in still water and in a current."""
    moving = moment.motion[3:] - shift_by(current, moment)
    rows = np.tile(moment.motion, (8, 1))
    rows[1:, 3:] = moving
    rows[2:, 3:] += np.diag(STEP)
    commands = np.tile(moment.commands, (8, 1))
    force, _ = model.missing_force(rows, np.full(8, moment.time), commands, commands)
    slopes = (force[2:] - force[1]).T / STEP
    return Balance(force[0], force[1], slopes[:, :3], slopes[:, 3:])


WIND = 12.0  # m/s, prior of a wind's size
PRIOR_STEP = 0.15  # of the prior: near g = 0 a slope on the spot would be that of a root


@dataclass(frozen=True)
class Air:
    """Frontal, lateral area [m²] and length [m]; prior (standard deviation) of g."""

    front: float
    side: float
    length: float
    prior: float

    @classmethod
    def of(cls, vessel: Vessel, thrust: float) -> "Air":
        """Thrust full ahead [N] tells how large a force may be."""
        front, side = vessel.hull.wind_area
        areas = front > 0.0 and side > 0.0
        return cls(front, side, vessel.hull.length, WIND**2 if areas else 0.3 * thrust)

    @property
    def has_areas(self) -> bool:
        """Can a force be told as a wind?"""
        return self.front > 0.0 and self.side > 0.0

    def push(self, g: Floats, moment: Moment) -> tuple[Floats, Floats]:
        """g north, east (2,) -> X, Y, N (3,) and their slope against g (3, 2)."""
        h = PRIOR_STEP * self.prior
        slope = [
            (self.force(g + step, moment) - self.force(g - step, moment)) / (2.0 * h)
            for step in h * np.eye(2)
        ]
        return self.force(g, moment), np.array(slope).T

    def force(self, g: Floats, moment: Moment) -> Floats:
        """g north, east (2,) -> X, Y, N (3,) [N, N, N m]."""
        if not self.has_areas:
            return np.append(in_body(g, moment.yaw), 0.0)
        u_w, v_w = in_body(velocity(g), moment.yaw)
        u, v = moment.nu[0] - u_w, moment.nu[1] - v_w
        V = np.hypot(u, v)
        return AIR_DENSITY * np.array([
            -0.5 * C_X * self.front * V * u,
            -0.5 * C_Y * self.side * V * v,
            -C_N * self.side * self.length * u * v,
        ])  # fmt: skip

    def world_force(self, g: Floats, moment: Moment) -> Floats:
        """g north, east (2,) -> the force as the boat now lies, north, east (2,) [N]."""
        force = self.force(g, moment)[:2]
        return in_body(force, -moment.yaw)


def velocity(g: Floats) -> Floats:
    """g = |V| V (2,) -> V, velocity of the air (2,) [m/s]."""
    size = float(np.hypot(g[0], g[1]))
    return g / np.sqrt(size) if size > 0.0 else np.zeros(2)


def velocity_spread(g: Floats, spread: Floats) -> Floats:
    """g (2,) with covariance (2, 2) -> covariance of V (2, 2).

    V = g / √|g| has no slope at 0: where g is not known to be larger, its spread is its size.
    """
    size = np.sqrt(float(g @ g) + float(np.trace(spread)))
    slope = (np.eye(2) - 0.5 * np.outer(g, g) / size**2) / np.sqrt(size)
    return np.asarray(slope @ spread @ slope.T)
