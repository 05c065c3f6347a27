"""Is the model of a boat under way still right, and does a current or a wind explain where not?

Here: one second of a live voyage, averaged; the balance linearised about it, and the wind load.

    F(ν, ν̇) = balance of the vessel,     slopes ∂F/∂ν and ∂F/∂ν̇ by one-sided differences

The laws of all causes stand in `sim.monitoring.causes`.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sim.model import Model
from sim.monitoring.causes import (
    BALANCES,
    DIFFERENCE_STEP,
    WIND_SHARE,
    WITH_COMPASS,
    slope_of_air,
    velocity_of_air,
    wind_force,
    write_air,
    write_motions,
)
from sim.state import Eta, Floats, Nu, to_body
from sim.vessel import Vessel
from sim.wind import AIR_DENSITY, C_Y, assumed_wind_areas

# All chosen, not measured.
WIND_PRIOR_MPS = 12.0  # standard deviation of the wind's speed
WIND_FORCE_PRIOR = 0.3  # the same of a force in the world, of the thrust full ahead
NO_CURRENT = np.zeros(2)


@dataclass(frozen=True)
class SecondMeans:
    """Means over one second of a live voyage.

    motion       (9,)  reported eta, nu, nu_dot       variance     (3,)  of u, v, r
    missing      (3,)  X, Y, N [N, N, N m]            missing_std  (3,)  as stated
    commanded    (3,)  τ(commands)                    commands     (na,) the latest
    errors       (H, 3) u, v, r: latest prediction errors that came due, NaN where none did
    mean_commands (na,)  their mean
    short_error  (3,)  u, v, r of the prediction over one second that came due, NaN without one
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
    short_error: Floats = field(default_factory=lambda: np.full(3, np.nan))

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
    """Slopes of a vessel's balance in water that moves.

    slope_nu  (3, 3)  ∂F/∂ν              slope_nu_dot  (3, 3)  ∂F/∂ν̇
    slope_yaw (3,)    ∂F/∂ψ: of a vessel file with a current or a wind in it
    """

    slope_nu: Floats
    slope_nu_dot: Floats
    slope_yaw: Floats

    @classmethod
    def of(cls, F: Floats) -> "Balance":
        """From balances (>= 9, 3) of the motions of `causes.write_motions`."""
        slopes = (F[2:BALANCES] - F[1]).T / DIFFERENCE_STEP
        return cls(slopes[:, :3], slopes[:, 3:6], slopes[:, 6])

    @cached_property
    def system_matrix(self) -> Floats:
        """∂(ν̇, ψ̇)/∂(ν, ψ) of the free vessel: (4, 4) [1/s and mixed]."""
        A, slopes = np.zeros((4, 4)), np.column_stack([self.slope_nu, self.slope_yaw])
        A[:3] = -np.linalg.solve(self.slope_nu_dot, slopes)
        A[3, Nu.R] = 1.0
        return A


def world_to_body(world: Floats, yaw: float) -> Floats:
    """North, east (2,) -> ahead, to starboard (2,)."""
    return np.array(to_body(world[0], world[1], yaw))


def current_shift(current: Floats, second: SecondMeans) -> Floats:
    """Water moving north, east (2,) [m/s] -> what it takes off (ν, ν̇): (6,)."""
    u_c, v_c = world_to_body(current, second.yaw)
    r = second.nu[Nu.R]
    return np.array([u_c, v_c, 0.0, r * v_c, -r * u_c, 0.0])


def balances_at(
    model: Model, second: SecondMeans, current: Floats, compass: float | None = None
) -> Floats:
    """Balances (9, 3), with a compass error [rad] (11, 3), of the motions of `write_motions`."""
    count = BALANCES if compass is None else WITH_COMPASS
    motions, commands = np.empty((count, 9)), np.empty((count, len(second.commands)))
    write_motions(second.motion, current, compass or 0.0, motions)
    commands[:] = second.commands
    force, _ = model.missing_force(motions, np.full(count, second.time), commands, commands)
    return force


def thrust_ahead(vessel: Vessel) -> float:
    """Thrust of all thrusters full ahead, or a size of one [N]."""
    return sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass


@dataclass(frozen=True)
class WindModel:
    """Frontal, lateral area [m²] and length [m]; prior (standard deviation) of each g.

    given  whether the vessel has areas; else those that `sim.wind` assumes: they tell how a wind
           pushes ahead, abeam and about the middle, and its force, but not its speed
    """

    front: float
    side: float
    length: float
    prior: float
    given: bool = True

    @classmethod
    def of(cls, vessel: Vessel) -> "WindModel":
        """Of a vessel with areas above water, or without."""
        hull = vessel.hull
        given = min(hull.wind_area) > 0.0
        front, side = hull.wind_area if given else assumed_wind_areas(hull.length, hull.beam)
        return cls(front, side, hull.length, WIND_PRIOR_MPS**2, given)

    @classmethod
    def uniform(cls, vessel: Vessel) -> "WindModel":
        """The same; without areas a force that is fixed in the world, alike on all headings."""
        air = cls.of(vessel)
        force = WIND_FORCE_PRIOR * thrust_ahead(vessel)
        return air if air.given else cls(0.0, 0.0, air.length, force, given=False)

    @property
    def has_areas(self) -> bool:
        """Whether a force can be told as a wind."""
        return self.given and self.front > 0.0 and self.side > 0.0

    def force_abeam(self, g: Floats) -> float:
        """g (2,) -> what it pushes a boat that lies across it with [N]."""
        return float(0.5 * AIR_DENSITY * C_Y * self.side * np.hypot(*g))

    @cached_property
    def numbers(self) -> Floats:
        """(4,), as `causes.Hull.wind` has them."""
        return np.array([self.front, self.side, self.length, self.prior])

    def force(self, g: Floats, second: SecondMeans) -> Floats:
        """g north, east (2,) -> X, Y, N (3,) [N, N, N m]."""
        return np.array(wind_force(g[0], g[1], second.motion, self.numbers))

    def in_world(self, g: Floats, covariance: Floats, second: SecondMeans) -> Floats:
        """g (2,) with covariance (2, 2) -> (8,) north and east each: the force on the boat as it
        lies [N], its std, the velocity of the air [m/s], its std.
        """
        out = np.empty(8)
        write_air(g, covariance, second.motion, self.numbers, out)
        return out


def air_velocity(g: Floats) -> Floats:
    """g = |V| V (2,) -> V, velocity of the air (2,) [m/s]."""
    return np.array(velocity_of_air(g[0], g[1]))


def air_velocity_covariance(g: Floats, covariance: Floats) -> Floats:
    """g (2,) with covariance (2, 2) -> covariance of V (2, 2).

    V = g / √|g| has no slope at 0: where g is not known to be larger, its spread is its size. And
    as much of V as its coefficients and areas are uncertain.
    """
    (a, b), (c, d) = slope_of_air(g, covariance)
    slope, V = np.array([[a, b], [c, d]]), air_velocity(g)
    return np.asarray(slope @ covariance @ slope.T + WIND_SHARE**2 * np.outer(V, V))
