"""What each cause adds to the missing force of a second, and its slope against the cause; compiled.

    nothing      0
    current      F(ν) − F(ν − c)                c of the water, north and east [m/s]
    wind         w(ψ, ν; g)                     g of the air, north and east
    thruster i   F(ν; T_i) − F(ν; (1 + s) T_i)  s share of its thrust that it has too much
    compass      F(ν) − F(R(δ) ν)               δ reported − true heading [rad]
    drag         s (X_u + X_u|u| |u|) u         s growth of the damping ahead
    anything     w                              a force on the hull, wandering: [N, N, N m]

beside the small errors of a model that is right (`write_boat_errors`). `F` is the balance of the
vessel, T_i the thrust of thruster i ahead and astern, at the mean commands of the second: what a
thruster gives less turns with a motor that is steered, and is missing in the stream that meets a
rudder behind it. The last one is not a cause but what a named one has to beat: where it predicts
better than all of them, none of them is it.

A steady current is a frame that moves: the boat meets the water with ν − c and ν̇ − ċ, where
c = (u_c, v_c, 0) and ċ = (r v_c, −r u_c, 0). Slopes of F are one-sided differences. Memory of
actuators is left out of them: it adds the same thrust on both sides of each difference.

The wind load is that of `sim.wind`:

    X = −½ ρ C_X A_F V u_rw,   Y = −½ ρ C_Y A_L V v_rw,   N = −ρ C_N A_L L u_rw v_rw

written in g = |V_w| V_w, in which it is nearly linear. Areas of 0 leave a force g [N] that is fixed
in the world.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from sim.kernel.compiled import compiled
from sim.state import Floats, to_body, to_world
from sim.wind import AIR_DENSITY, C_N, C_X, C_Y


class Law(IntEnum):
    """Which of the laws above."""

    NOTHING = 0
    CURRENT = 1
    WIND = 2
    THRUST = 3
    COMPASS = 4
    DRAG = 5
    ANYTHING = 6


# All chosen, not measured.
DIFFERENCE_STEP = 1e-3  # m/s, rad/s and per s: of the slopes of the balance
STEP_RAD = 1e-3  # of the slope of a compass
WIND_SHARE = 0.1  # of a wind's speed, standard deviation: its areas and coefficients are not known
WIND_STEP = 0.15  # of the prior: near g = 0 a slope on the spot would be that of a root

BOAT_ERRORS = 10  # components of b, see `write_boat_errors`
BALANCES = (
    9  # motions whose balance the slopes take: as reported, in the water, seven steps from it
)
WITH_COMPASS = BALANCES + 2  # … and turned by the compass's error, and a step more
NOTHING, CURRENT, WIND, THRUST, COMPASS, DRAG, ANYTHING = map(int, Law)


class Hull(NamedTuple):
    """Numbers of a vessel that the laws take.

    damping  (6,)  X_u, X_uu, Y_v, Y_vv, N_r, N_rr
    wind     (4,)  areas in front and at the side [m²], length [m]; prior of g
    """

    damping: Floats
    wind: Floats


@compiled
def write_motions(motion: Floats, current: Floats, compass: float, out: Floats) -> None:
    """Motion (9,) -> those whose balances are needed: (`BALANCES` or `WITH_COMPASS`, 9)."""
    u_c, v_c = to_body(current[0], current[1], motion[2])
    r = motion[5]
    for k in range(len(out)):
        for i in range(9):
            out[k, i] = motion[i]
        if 1 <= k < BALANCES:
            out[k, 3] -= u_c
            out[k, 4] -= v_c
            out[k, 6] -= r * v_c
            out[k, 7] += r * u_c
        if 2 <= k < BALANCES - 1:
            out[k, k + 1] += DIFFERENCE_STEP
        elif k == BALANCES - 1:
            out[k, 2] += DIFFERENCE_STEP
        elif k >= BALANCES:
            angle = compass + (k - BALANCES) * STEP_RAD
            c, s = np.cos(angle), np.sin(angle)
            for i in (3, 6):  # velocity, acceleration: both turn with the heading
                out[k, i] = c * motion[i] - s * motion[i + 1]
                out[k, i + 1] = s * motion[i] + c * motion[i + 1]


@compiled
def write_boat_errors(
    u: float, v: float, r: float, commanded: Floats, hull: Hull, H: Floats
) -> None:
    """B (3, 10) into H (3, >= 10): what one unit of each of the boat's own errors adds.

    A constant force; scales of thrust, of turning, of the damping in u, v, r; a heading offset in
    sway and yaw.
    """
    d = hull.damping
    for a in range(3):
        for i in range(BOAT_ERRORS):
            H[a, i] = 1.0 if i == a else 0.0
    H[0, 3], H[2, 4] = commanded[0], commanded[2]
    H[0, 5] = (d[0] + d[1] * abs(u)) * u
    H[1, 6] = (d[2] + d[3] * abs(v)) * v
    H[2, 7] = (d[4] + d[5] * abs(r)) * r
    H[1, 8] = H[2, 9] = u


@compiled
def write_current_slope(motion: Floats, F: Floats, out: Floats, at: int) -> None:
    """∂/∂c of F(ν) − F(ν − c) from the balances F (>= 9, 3) -> columns `at` and the next (3, 2)."""
    c, s, r = np.cos(motion[2]), np.sin(motion[2]), motion[5]
    for a in range(3):
        by_u, by_v = F[2, a] - F[1, a], F[3, a] - F[1, a]
        by_u_dot, by_v_dot = F[5, a] - F[1, a], F[6, a] - F[1, a]
        ahead = (by_u - r * by_v_dot) / DIFFERENCE_STEP  # against u_c, for ċ = (r v_c, −r u_c)
        beside = (by_v + r * by_u_dot) / DIFFERENCE_STEP
        out[a, at] = ahead * c - beside * s
        out[a, at + 1] = ahead * s + beside * c


@compiled
def velocity_of_air(g_north: float, g_east: float) -> tuple[float, float]:
    """g = |V| V -> V north, east [m/s]."""
    size = np.hypot(g_north, g_east)
    root = np.sqrt(size) if size > 0.0 else 1.0
    return g_north / root, g_east / root


@compiled
def slope_of_air(g: Floats, covariance: Floats) -> tuple[tuple[float, float], tuple[float, float]]:
    """∂V/∂g (2, 2); V = g / √|g| has none at 0: where g is not known to be larger than its spread
    (2, 2), that is its size.
    """
    squared = g[0] ** 2 + g[1] ** 2 + covariance[0, 0] + covariance[1, 1]
    root, cross = squared**0.25, -0.5 * g[0] * g[1] / squared
    ahead, beside = 1.0 - 0.5 * g[0] ** 2 / squared, 1.0 - 0.5 * g[1] ** 2 / squared
    return (ahead / root, cross / root), (cross / root, beside / root)


@compiled
def spread(a: float, b: float, covariance: Floats) -> float:
    """Standard deviation of a x + b y, x and y with that covariance (2, 2)."""
    variance = a * a * covariance[0, 0] + b * b * covariance[1, 1]
    return np.sqrt(max(variance + a * b * (covariance[0, 1] + covariance[1, 0]), 0.0))


@compiled
def write_air(g: Floats, covariance: Floats, motion: Floats, wind: Floats, out: Floats) -> None:
    """g (2,) with covariance (2, 2) -> what `WindModel.in_world` tells of it (8,)."""
    slope, yaw = np.empty((3, 2)), motion[2]
    write_wind_slope(g, motion, wind, slope, 0)
    X, Y, _ = wind_force(g[0], g[1], motion, wind)
    out[0], out[1] = to_world(X, Y, yaw)
    north_0, east_0 = to_world(slope[0, 0], slope[1, 0], yaw)
    north_1, east_1 = to_world(slope[0, 1], slope[1, 1], yaw)
    out[2], out[3] = spread(north_0, north_1, covariance), spread(east_0, east_1, covariance)
    out[4], out[5] = velocity_of_air(g[0], g[1])
    by_north, by_east = slope_of_air(g, covariance)
    out[6] = np.hypot(spread(by_north[0], by_north[1], covariance), WIND_SHARE * out[4])
    out[7] = np.hypot(spread(by_east[0], by_east[1], covariance), WIND_SHARE * out[5])


@compiled
def wind_force(g_north: float, g_east: float, motion: Floats, wind: Floats) -> tuple[
    float, float, float
]:  # fmt: skip
    """Wind load of g on a boat that moves so -> X, Y, N [N, N, N m]; `wind` as in `Hull`."""
    front, side, length = wind[0], wind[1], wind[2]
    if not (front > 0.0 and side > 0.0):
        X, Y = to_body(g_north, g_east, motion[2])
        return X, Y, 0.0
    north, east = velocity_of_air(g_north, g_east)
    u_w, v_w = to_body(north, east, motion[2])
    u, v = motion[3] - u_w, motion[4] - v_w
    V = np.hypot(u, v)
    return (
        AIR_DENSITY * (-0.5 * C_X * front * V * u),
        AIR_DENSITY * (-0.5 * C_Y * side * V * v),
        AIR_DENSITY * (-C_N * side * length * u * v),
    )


@compiled
def write_wind_slope(g: Floats, motion: Floats, wind: Floats, out: Floats, at: int) -> None:
    """∂w/∂g by central differences of `WIND_STEP` of the prior -> columns `at` and the next."""
    h = WIND_STEP * wind[3]
    for i in range(2):
        north, east = (h, 0.0) if i == 0 else (0.0, h)
        above = wind_force(g[0] + north, g[1] + east, motion, wind)
        below = wind_force(g[0] - north, g[1] - east, motion, wind)
        for a in range(3):
            out[a, at + i] = (above[a] - below[a]) / (2.0 * h)


@compiled
def linearise(
    law: int, index: int, o: Floats, second: tuple[Floats, ...], hull: Hull, F: Floats,
    force: Floats, H: Floats,
) -> None:  # fmt: skip
    """A cause of size o at one second -> what it adds (3,), and H = [B ∂h/∂o] (3, >= 10 + len(o)).

    index   of the thruster
    second  motion (9,), commanded (3,), as in `SecondMeans`
    F       (11 + T, 3) balances of the motions of `write_motions`; then of each thruster what all
            of its thrust more would add, at its present share
    """
    motion, commanded = second
    u, v, at = motion[3], motion[4], BOAT_ERRORS
    if law == CURRENT:
        u_c, v_c = to_body(o[0], o[1], motion[2])
        u, v = u - u_c, v - v_c
    write_boat_errors(u, v, motion[5], commanded, hull, H)
    w = (0.0, 0.0, 0.0)
    if law == CURRENT:
        write_current_slope(motion, F, H, at)
        w = (F[0, 0] - F[1, 0], F[0, 1] - F[1, 1], F[0, 2] - F[1, 2])
    elif law == WIND:
        write_wind_slope(o, motion, hull.wind, H, at)
        w = wind_force(o[0], o[1], motion, hull.wind)
    elif law == COMPASS:
        for a in range(3):
            H[a, at] = (F[BALANCES, a] - F[BALANCES + 1, a]) / STEP_RAD
        turned = F[BALANCES]
        w = (F[0, 0] - turned[0], F[0, 1] - turned[1], F[0, 2] - turned[2])
    elif law == THRUST:
        for a in range(3):
            H[a, at] = F[WITH_COMPASS + index, a]
        w = (H[0, at] * o[0], H[1, at] * o[0], H[2, at] * o[0])
    elif law == DRAG:
        H[0, at], H[1, at], H[2, at] = H[0, 5], 0.0, 0.0
        w = (H[0, at] * o[0], 0.0, 0.0)
    elif law == ANYTHING:
        for a in range(3):
            for i in range(3):
                H[a, at + i] = 1.0 if i == a else 0.0
        w = (o[0], o[1], o[2])
    for a in range(3):
        force[a] = w[a]
