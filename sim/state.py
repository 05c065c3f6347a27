"""The shared vocabulary: pose, velocity, wrench, water, and the names of their components.

Body frame FRD (x forward, y starboard, z down), world NED, yaw clockwise from north, SI units.
Every tuple here holds floats or arrays alike: laws are written once and serve both.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from sim.jit import jitable

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[str], None]  # called with a line of text whenever long work takes a new step


class CountedStep(str):
    """A line of progress in a round of like steps: so many of `total` are `done`.

    A round begins with a line that counts nothing, or with none done.
    """

    done: int
    total: int

    def __new__(cls, text: str, done: int = 0, total: int = 0) -> Self:
        step = super().__new__(cls, text)
        step.done, step.total = done, total
        return step


class Eta(IntEnum):
    """Columns of an array of poses `eta`: (..., 3) [m, m, rad]."""

    NORTH = 0
    EAST = 1
    YAW = 2


class Nu(IntEnum):
    """Columns of an array of velocities `nu`: (..., 3) [m/s, m/s, rad/s]."""

    U = 0
    V = 1
    R = 2


class Tau(IntEnum):
    """Columns of an array of forces `tau`: (..., 3) [N, N, N m]."""

    X = 0
    Y = 1
    N = 2


class Pose(NamedTuple):
    """Position in the world [m] and yaw [rad, clockwise from north]."""

    north: float
    east: float
    yaw: float


class Velocity(NamedTuple):
    """Surge, sway [m/s] and yaw rate [rad/s] in the body frame."""

    u: float
    v: float
    r: float


class Wrench(NamedTuple):
    """Surge force, sway force [N] and yaw moment [N m] in the body frame."""

    X: float
    Y: float
    N: float


class Water(NamedTuple):
    """Velocity [m/s] and acceleration [m/s²] of the water in the world frame."""

    north: float
    east: float
    north_dot: float
    east_dot: float


class Inertia(NamedTuple):
    """Symmetric mass matrix, added mass included [kg, kg m, kg m²]."""

    m11: float
    m12: float
    m13: float
    m22: float
    m23: float
    m33: float


@jitable
def add_wrench(a: Wrench, b: Wrench) -> Wrench:
    """Sum of two wrenches -> X, Y, N [N, N, N m]."""
    return Wrench(a.X + b.X, a.Y + b.Y, a.N + b.N)


@jitable
def add_water(a: Water, b: Water) -> Water:
    """Sum of two motions of the water -> [m/s, m/s, m/s², m/s²]."""
    return Water(
        a.north + b.north, a.east + b.east, a.north_dot + b.north_dot, a.east_dot + b.east_dot
    )


@jitable
def to_body(north: float, east: float, yaw: float) -> tuple[float, float]:
    """A world vector seen in the body frame: north, east, yaw [rad] -> forward, starboard."""
    c, s = np.cos(yaw), np.sin(yaw)
    return c * north + s * east, c * east - s * north


def turned(vectors: Floats, angle: Floats) -> Floats:
    """Vectors (N, 2) by angles (N,) [rad]: body to world by the heading, back by minus that."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors.T
    return np.stack([c * x - s * y, s * x + c * y], axis=1)


@jitable
def to_world(forward: float, starboard: float, yaw: float) -> tuple[float, float]:
    """A body vector seen in the world frame: forward, starboard, yaw [rad] -> north, east."""
    c, s = np.cos(yaw), np.sin(yaw)
    return c * forward - s * starboard, s * forward + c * starboard


@jitable
def wrap(angle: float) -> float:
    """An angle [rad] -> the same angle in [−π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
