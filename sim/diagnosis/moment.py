"""One second of a live voyage, averaged, and the balance linearised about it.

    F(ν, ν̇) = balance of the vessel,     slopes ∂F/∂ν and ∂F/∂ν̇ by one-sided differences

A steady current is a frame that moves: the boat meets the water with ν − c and ν̇ − ċ, where
c = (u_c, v_c, 0) and ċ = (r v_c, −r u_c, 0). Memory of actuators is left out of the slopes: it
adds the same thrust on both sides of each difference.
"""

from dataclasses import dataclass

import numpy as np

from sim.model import Model
from sim.state import Eta, Floats, Nu

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
