"""Is the model of a boat under way still right, and does a current or a wind explain where not?

Here: one second of a live voyage, averaged; the balance linearised about it, and the wind load.

    F(ν, ν̇) = balance of the vessel,     slopes ∂F/∂ν and ∂F/∂ν̇ by one-sided differences

A steady current is a frame that moves: the boat meets the water with ν − c and ν̇ − ċ, where
c = (u_c, v_c, 0) and ċ = (r v_c, −r u_c, 0). Memory of actuators is left out of the slopes: it
adds the same thrust on both sides of each difference.

With wind areas the wind load is that of `sim.wind`:

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

written in g = |V_w| V_w, in which it is nearly linear. Without areas a speed cannot be told, and g
is a force [N] that is fixed in the world.

**Causes of the boat's own**: a thruster, the compass, the drag, anything.

What each adds to the missing force, beside the small errors of a model that is right:

    thruster i   s τ_i                          s share of its thrust that it has too much
    compass      F(ν) − F(R(δ) ν)               δ reported − true heading [rad]
    drag         s (X_u + X_u|u| |u|) u         s growth of the damping ahead
    anything     w                              a force on the hull, wandering: [N, N, N m]

`F` is the balance of the vessel, τ_i the force of thruster i as commanded (mean of the second,
static curve). The last one is not a cause but what a named one has to beat: where it predicts
better than all of them, none of them is it.

**The step of all filters here**, an extended Kalman filter that weighs outliers less, compiled.

A boat under way takes eight each second, in numpy at 44 µs each, compiled at 13.

    S = H P Hᵀ + R = L Lᵀ,     K = P Hᵀ S⁻¹,     x ← x + K m
    P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ          (Joseph's form)

Beyond `MAX_SQUARED_DISTANCE` of mᵀ S⁻¹ m, R counts as much larger as it takes. An S that is not
positive definite gives NaN. Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to
Tracking and Navigation, 2001, §5.2 and §7.3.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.actuators import thrust_at, thruster_force
from sim.body import ThrusterParameters
from sim.kernel.compiled import compiled
from sim.model import Model
from sim.state import Eta, Floats, Nu, to_body
from sim.vessel import Points, Thruster, Vessel, as_table
from sim.wind import AIR_DENSITY, C_N, C_X, C_Y

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


# Chosen on the tuning voyages of benchmarks/live_naming.py.
THRUST_PRIOR = 0.6  # standard deviation of a thruster's share
COMPASS_PRIOR_RAD = 0.25
DRAG_PRIOR = 0.8
ANYTHING_PRIOR = 0.25  # of the thrust full ahead, and of that at half the beam
ANYTHING_DRIFT_S = 120.0  # in which it wanders by its prior
STEP_RAD = 1e-3

# second, value (n,) -> X, Y, N (3,) and its slope (3, n)
ForceAndSlope = Callable[[SecondMeans, Floats], tuple[Floats, Floats]]


class OwnCause(NamedTuple):
    """A cause aboard: prior standard deviations (n,), time of its walk [s], what it adds."""

    kind: str  # thrust, compass, drag, anything
    name: str  # of the thruster; empty else
    prior: Floats
    drift_s: float
    force: ForceAndSlope


def own_causes(model: Model, drift_s: float) -> tuple[OwnCause, ...]:
    """All causes aboard a vessel; `drift_s` is the time of a steady cause's walk."""
    return tuple(_of(model, drift_s))


def _of(model: Model, drift_s: float) -> Iterator[OwnCause]:
    vessel = model.vessel
    owner = {t.name: t.curve for t in vessel.thrusters}
    for i, thruster in enumerate(vessel.thrusters):
        curve = thruster.curve
        curve = owner.get(curve, curve) if isinstance(curve, str) else curve
        yield OwnCause(
            "thrust", thruster.name, np.array([THRUST_PRIOR]), drift_s,
            _thrust(thruster, i, as_table(curve)),
        )  # fmt: skip
    yield OwnCause("compass", "", np.array([COMPASS_PRIOR_RAD]), drift_s, _compass(model))
    yield OwnCause("drag", "", np.array([DRAG_PRIOR]), drift_s, _drag(model))
    thrust = sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass
    prior = ANYTHING_PRIOR * thrust * np.array([1.0, 1.0, 0.5 * vessel.hull.beam])
    yield OwnCause("anything", "", prior, ANYTHING_DRIFT_S, lambda second, w: (w, np.eye(3)))


def _thrust(thruster: Thruster, index: int, table: Points) -> ForceAndSlope:
    x, y = thruster.position
    points = np.array(table, float)
    astern, ahead = thruster.thrust
    drive = ThrusterParameters(float(index), x, y, thruster.azimuth, astern, ahead, 1.0)

    def force(second: SecondMeans, s: Floats) -> tuple[Floats, Floats]:
        command = float(second.mean_commands[index])
        share = float(np.interp(command, points[:, 0], points[:, 1]))
        thrust = float(thrust_at(command, share, drive))
        slope = np.array(thruster_force(thrust, thruster.azimuth, drive), float)[:, None]
        return slope[:, 0] * s[0], slope

    return force


def _compass(model: Model) -> ForceAndSlope:
    def force(second: SecondMeans, delta: Floats) -> tuple[Floats, Floats]:
        rows = np.tile(second.motion, (3, 1))
        for row, angle in zip(rows[1:], (delta[0], delta[0] + STEP_RAD), strict=True):
            c, s = np.cos(angle), np.sin(angle)
            for i in (3, 6):  # velocity, acceleration: both turn with the heading
                u, v = row[i : i + 2].tolist()
                row[i : i + 2] = c * u - s * v, s * u + c * v
        commands = np.tile(second.commands, (3, 1))
        F, _ = model.missing_force(rows, np.full(3, second.time), commands, commands)
        return F[0] - F[1], ((F[1] - F[2]) / STEP_RAD)[:, None]

    return force


def _drag(model: Model) -> ForceAndSlope:
    d = model.vessel.dynamics

    def force(second: SecondMeans, s: Floats) -> tuple[Floats, Floats]:
        u = float(second.nu[0])
        slope = np.array([[(d.X_u + d.X_uu * abs(u)) * u], [0.0], [0.0]])
        return slope[:, 0] * s[0], slope

    return force


MAX_SQUARED_DISTANCE = 16.0  # mᵀ S⁻¹ m over three axes: beyond this noise is not Gaussian; chosen


@compiled
def cholesky(S: Floats) -> Floats:
    """L with L Lᵀ = S (k, k)."""
    L = np.zeros_like(S)
    for i in range(len(S)):
        for j in range(i + 1):
            rest = S[i, j] - (L[i, :j] * L[j, :j]).sum()
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
    return L


@compiled
def whitened(L: Floats, columns: Floats) -> Floats:
    """L⁻¹ columns: (k, k), (k, n) -> (k, n)."""
    out = columns.copy()
    for i in range(len(L)):
        for n in range(out.shape[1]):
            for j in range(i):
                out[i, n] -= L[i, j] * out[j, n]
            out[i, n] /= L[i, i]
    return out


@compiled
def unwhitened(L: Floats, columns: Floats) -> Floats:
    """L⁻ᵀ columns: (k, k), (k, n) -> (k, n)."""
    out = columns.copy()
    for i in range(len(L) - 1, -1, -1):
        for n in range(out.shape[1]):
            for j in range(i + 1, len(L)):
                out[i, n] -= L[j, i] * out[j, n]
            out[i, n] /= L[i, i]
    return out


@compiled
def kalman_step(
    state: tuple[Floats, Floats, Floats],
    measured: tuple[Floats, Floats, Floats],
    held: NDArray[np.bool_],
) -> tuple[Floats, Floats, Floats, float]:
    """One step of the filter.

    state     mean (n,), covariance (n, n), variance (n,) that its random walk adds
    measured  innovation m (3,), its variance R (3,), H (3, n)
    held      (n,): what does not move
    -> mean, covariance, mᵢ² / Sᵢᵢ (3,), mᵀ S⁻¹ m (at most `MAX_SQUARED_DISTANCE`) + ln |S|
    """
    mean, covariance, walk = state
    m, variance, H = measured
    P = covariance + np.diag(walk)
    HP = H @ P
    spread = HP @ np.ascontiguousarray(H.T)
    R = variance.copy()
    L = cholesky(spread + np.diag(R))
    ratio = m**2 / (np.diag(spread) + R)
    squared = (whitened(L, m.copy().reshape(-1, 1)) ** 2).sum()
    if squared > MAX_SQUARED_DISTANCE:  # an outlier: it counts, but less
        R = R * (squared / MAX_SQUARED_DISTANCE)
        L = cholesky(spread + np.diag(R))
    K = np.ascontiguousarray(unwhitened(L, whitened(L, HP)).T)
    for i in range(len(mean)):
        if held[i]:
            K[i] = 0.0
    A = np.eye(len(mean)) - K @ H
    kept = A @ P @ np.ascontiguousarray(A.T) + (K * R) @ np.ascontiguousarray(K.T)
    distance = min(squared, MAX_SQUARED_DISTANCE) + 2.0 * np.log(np.diag(L)).sum()
    return mean + K @ m, kept, ratio, distance
