"""The force on a hull in six degrees of freedom, as a physics engine applies it.

The water's share of the horizontal balance, as the vessel has it, and the thrusters act on the
tilted body; columns of the waterline carry it, each by the water that it displaces:

    F_i = −ρ g a_i s_i (ζ_N, ζ_E, 1)      s_i [m] wetted height, 0 … T + freeboard; world, D down
    heave, roll and pitch are damped against the mean motion of the water under the hull

The engine knows the rigid body, not the water that it carries along. Its inertia M_A acts as a
force of the acceleration that follows, so that the engine finds that very acceleration:

    (M_RB + M_A) ν̇ = f + g − C_RB ν,   τ_engine = f − M_A ν̇

M_A: in surge, sway and yaw what the vessel's inertia has beyond that of the rigid body (which may
be less than nothing, as fitted inertias are), in heave, roll and pitch that of
`sim.plants.mujoco_hull`.
Valid for: one hull, waves that do not break, and no shorter than the distance of columns. Source:
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, §3.3, §6.
"""

import numpy as np

from sim.balance import coriolis_force
from sim.jit import jitable
from sim.kernel.compiled import compiled
from sim.plants.waves import GRAVITY, WATER_DENSITY
from sim.state import Floats, Inertia, Velocity, to_body, to_world

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]  # rows of a rotation body -> world
OUT = 25  # numbers that `floating_force` reports


@jitable
def rotation_of(w: float, x: float, y: float, z: float) -> Matrix:
    """Unit quaternion body -> world, as a matrix."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@jitable
def to_hull(R: Matrix, a: Vector) -> Vector:
    """A world vector seen in the body: Rᵀ a."""
    x, y, z = R
    return (
        x[0] * a[0] + y[0] * a[1] + z[0] * a[2],
        x[1] * a[0] + y[1] * a[1] + z[1] * a[2],
        x[2] * a[0] + y[2] * a[1] + z[2] * a[2],
    )


@jitable
def from_hull(R: Matrix, a: Vector) -> Vector:
    """A body vector seen in the world: R a."""
    x, y, z = R
    return (
        x[0] * a[0] + x[1] * a[1] + x[2] * a[2],
        y[0] * a[0] + y[1] * a[1] + y[2] * a[2],
        z[0] * a[0] + z[1] * a[1] + z[2] * a[2],
    )


@jitable
def crossed(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jitable
def add_at(f: Floats, force: Vector, place: Vector) -> None:
    """Add a force that acts at a place of the body to force and moment (6,)."""
    moment = crossed(place, force)
    for i in range(3):
        f[i] += force[i]
        f[3 + i] += moment[i]


@jitable
def surface(
    waves: Floats, north: float, east: float, time: float
) -> tuple[float, float, float, float]:
    """Trains (K, 5) of `sim.plants.waves` at a place -> ζ [m, up], ζ_N, ζ_E, ζ_t."""
    zeta, slope_n, slope_e, rise = 0.0, 0.0, 0.0, 0.0
    for i in range(len(waves)):
        a, omega, k = waves[i, 0], waves[i, 1], waves[i, 2]
        ahead, side = np.cos(waves[i, 3]), np.sin(waves[i, 3])
        turn = omega * time - k * (north * ahead + east * side) + waves[i, 4]
        c = a * np.cos(turn)
        zeta += a * np.sin(turn)
        slope_n -= k * ahead * c
        slope_e -= k * side * c
        rise += omega * c
    return zeta, slope_n, slope_e, rise


@jitable
def add_buoyancy(
    f: Floats, body: Floats, R: Matrix, hull: Floats, columns: Floats, waves: Floats, time: float
) -> Vector:
    """Add the force on the columns to f (6,) -> heave, roll, pitch rates of the water under them.

    body (13,): place N, E, D and what does not matter here; hull: `FloatingNumbers`.
    """
    draught, freeboard = hull[6], hull[7]
    area, heave, across, roll, along, pitch = 0.0, 0.0, 1e-9, 0.0, 1e-9, 0.0
    for i in range(len(columns)):
        x, y, a = columns[i, 0], columns[i, 1], columns[i, 2]
        out = from_hull(R, (x, y, 0.0))
        zeta, slope_n, slope_e, rise = surface(waves, body[0] + out[0], body[1] + out[1], time)
        wet = min(max(draught + body[2] + out[2] + zeta, 0.0), draught + freeboard)
        lift = WATER_DENSITY * GRAVITY * a * wet
        force = to_hull(R, (-lift * slope_n, -lift * slope_e, -lift))
        add_at(f, force, (x, y, draught - 0.5 * wet))
        area += a
        heave -= a * rise
        across += a * y * y
        roll -= a * y * rise
        along += a * x * x
        pitch += a * x * rise
    return heave / area, roll / across, pitch / along


@jitable
def inertia_matrices(hull: Floats, M: Inertia) -> tuple[Floats, Floats]:
    """M_RB + M_A and M_A (6, 6) about the origin, body axes."""
    m, x_g, z_g = hull[0], hull[4], hull[5]
    total, added = np.zeros((6, 6)), np.zeros((6, 6))
    added[0, 0], added[1, 1], added[2, 2] = M.m11 - m, M.m22 - m, hull[9]
    added[3, 3], added[4, 4] = hull[10], hull[11]
    added[5, 5] = M.m33 - (hull[3] + m * x_g * x_g)
    added[0, 1] = added[1, 0] = M.m12
    added[0, 5] = added[5, 0] = M.m13
    added[1, 5] = added[5, 1] = M.m23 - m * x_g
    for i in range(6):
        for j in range(6):
            total[i, j] = added[i, j]
    for i in range(3):
        total[i, i] += m
    total[3, 3] += hull[1] + m * z_g * z_g
    total[4, 4] += hull[2] + m * (z_g * z_g + x_g * x_g)
    total[5, 5] += hull[3] + m * x_g * x_g
    total[0, 4] = total[4, 0] = m * z_g
    total[1, 3] = total[3, 1] = -m * z_g
    total[1, 5] += m * x_g
    total[5, 1] += m * x_g
    total[2, 4] = total[4, 2] = -m * x_g
    total[3, 5] = total[5, 3] = -m * x_g * z_g
    return total, added


@jitable
def solved(A: Floats, b: Floats) -> Floats:
    """A⁻¹ b of a positive definite A (n, n), which it overwrites, by elimination: numba needs
    seconds to compile `numpy.linalg.solve`."""
    n, x = len(b), b.copy()
    for i in range(n):
        for k in range(i + 1, n):
            factor = A[k, i] / A[i, i]
            for j in range(i, n):
                A[k, j] -= factor * A[i, j]
            x[k] -= factor * x[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= A[i, j] * x[j]
        x[i] /= A[i, i]
    return x


@jitable
def rigid_coriolis(hull: Floats, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """C_RB ν of velocity v and rates w of the body -> force, moment."""
    m, g = hull[0], (hull[4], 0.0, hull[5])
    whirl, drift = crossed(w, crossed(w, g)), crossed(w, v)
    force = (
        m * (drift[0] + whirl[0]), m * (drift[1] + whirl[1]), m * (drift[2] + whirl[2])
    )  # fmt: skip
    # about the centre of gravity, then moved to the origin
    spin = crossed(w, (hull[1] * w[0], hull[2] * w[1], hull[3] * w[2]))
    lever = crossed(g, force)
    return force, (spin[0] + lever[0], spin[1] + lever[1], spin[2] + lever[2])


@compiled
def floating_force(
    planar: Floats, body: Floats, tau: Floats, hull: Floats, columns: Floats, waves: Floats,
    time: float, out: Floats,
) -> None:  # fmt: skip
    """What an engine applies to a hull, and how the hull then moves.

    planar (9,): of `horizontal_balance`; body (13,): place N, E, D [m], quaternion, world velocity
    [m/s], body rates [rad/s]; tau (3,): X, Y, N of the thrusters in the body; hull:
    `FloatingNumbers`; columns (K, 3); waves (W, 5) -> out (OUT,): force [N, world] and moment
    [N m, body] for the engine (6); pose, velocity, acceleration in the plane (9); down, roll,
    pitch, their rates and accelerations (9); elevation of the water [m].
    """
    R = rotation_of(body[3], body[4], body[5], body[6])
    w = (body[10], body[11], body[12])
    v = to_hull(R, (body[7], body[8], body[9]))
    roll, pitch = np.arctan2(R[2][1], R[2][2]), -np.arcsin(min(max(R[2][0], -1.0), 1.0))
    yaw = np.arctan2(R[1][0], R[0][0])
    s, c, upright = np.sin(roll), np.cos(roll), max(np.cos(pitch), 1e-3)
    yaw_rate, pitch_rate = (w[1] * s + w[2] * c) / upright, w[1] * c - w[2] * s
    roll_rate = w[0] + yaw_rate * np.sin(pitch)
    u, sway = to_body(body[7], body[8], yaw)
    # the balance holds the rigid body's own Coriolis force, which the engine adds by itself
    m, x_g = hull[0], hull[4]
    rigid = Inertia(m, 0.0, 0.0, m, m * x_g, hull[3] + m * x_g * x_g)
    own = coriolis_force(rigid, Velocity(u, sway, yaw_rate))
    north, east = to_world(own.X - planar[6], own.Y - planar[7], yaw)
    f = np.zeros(6)
    add_at(f, to_hull(R, (north, east, 0.0)), (0.0, 0.0, 0.5 * hull[6]))
    add_at(f, (tau[0], tau[1], 0.0), (0.0, 0.0, hull[8]))
    heave, water_roll, water_pitch = add_buoyancy(f, body, R, hull, columns, waves, time)
    add_at(f, to_hull(R, (0.0, 0.0, -hull[12] * (body[9] - heave))), (0.0, 0.0, 0.0))
    turn = to_hull(R, (0.0, 0.0, own.N - planar[8]))
    f[3] += turn[0] - hull[13] * (w[0] - water_roll)
    f[4] += turn[1] - hull[14] * (w[1] - water_pitch)
    f[5] += turn[2] + tau[2]
    pull = f.copy()
    add_at(pull, to_hull(R, (0.0, 0.0, m * GRAVITY)), (x_g, 0.0, hull[5]))
    push, moment = rigid_coriolis(hull, v, w)
    for i in range(3):
        pull[i] -= push[i]
        pull[3 + i] -= moment[i]
    inertia = Inertia(planar[0], planar[1], planar[2], planar[3], planar[4], planar[5])
    total, added = inertia_matrices(hull, inertia)
    a = solved(total, pull)
    for i in range(6):
        for j in range(6):
            f[i] -= added[i, j] * a[j]
    force, drift = from_hull(R, (f[0], f[1], f[2])), crossed(w, v)
    acceleration = from_hull(R, (a[0] + drift[0], a[1] + drift[1], a[2] + drift[2]))
    forward, starboard = to_body(acceleration[0], acceleration[1], yaw)
    yaw_acc = (a[4] * s + a[5] * c + roll_rate * pitch_rate) / upright
    yaw_acc += yaw_rate * pitch_rate * np.tan(pitch)
    for i in range(3):
        out[i], out[3 + i] = force[i], f[3 + i]
    out[6], out[7], out[8] = body[0], body[1], yaw
    out[9], out[10], out[11] = u, sway, yaw_rate
    out[12], out[13], out[14] = forward + yaw_rate * sway, starboard - yaw_rate * u, yaw_acc
    out[15], out[16], out[17] = body[2], roll, pitch
    out[18], out[19], out[20] = body[9], roll_rate, pitch_rate
    out[21] = acceleration[2]
    out[22] = a[3] + yaw_acc * np.sin(pitch) + yaw_rate * pitch_rate * np.cos(pitch)
    out[23] = a[4] * c - a[5] * s - roll_rate * (w[1] * s + w[2] * c)
    out[24] = surface(waves, body[0], body[1], time)[0]
