"""The one definition of the dynamics.

    balance(ν̇, ν) = M ν̇_rel + C(ν_rel) ν_rel + D(ν_rel) ν_rel − τ     zero for a perfect model
    η̇ = J(ψ) ν,   ν = ν_rel + ν_current,   ν̇_current = (r v_c, −r u_c, 0) + Rᵀ(ψ) V̇_current

M symmetric 3×3 with added mass, C from M (so that it does no work), D = damping derivatives.
τ holds thrusters, rudders and every effect that acts as a force. Simulation solves it for ν̇
(it is linear in ν̇), the missing force evaluates it, the follower computes from it the force that
a commanded ν̇ takes. Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control,
2nd ed. 2021, §6.7 and §10.3.
"""

import numpy as np

from sim.body import Body, Flow
from sim.jit import jitable
from sim.state import Inertia, Pose, Velocity, Water, Wrench, to_body, to_world


@jitable
def kinematics(pose: Pose, nu: Velocity) -> tuple[float, float, float]:
    """η̇ = J(ψ) ν -> north, east [m/s], yaw [rad/s]."""
    north_dot, east_dot = to_world(nu.u, nu.v, pose.yaw)
    return north_dot, east_dot, nu.r


@jitable
def velocity_through(water: Water, pose: Pose, nu: Velocity) -> Velocity:
    """ν_rel = ν − ν_current -> u, v [m/s], r [rad/s]."""
    u_c, v_c = to_body(water.north, water.east, pose.yaw)
    return Velocity(nu.u - u_c, nu.v - v_c, nu.r)


@jitable
def acceleration_through(water: Water, pose: Pose, nu: Velocity, nu_dot: Velocity) -> Velocity:
    """ν̇_rel = ν̇ − ν̇_current -> [m/s², m/s², rad/s²]."""
    u_c, v_c = to_body(water.north, water.east, pose.yaw)
    u_c_dot, v_c_dot = to_body(water.north_dot, water.east_dot, pose.yaw)
    return Velocity(nu_dot.u - (nu.r * v_c + u_c_dot), nu_dot.v - (-nu.r * u_c + v_c_dot), nu_dot.r)


@jitable
def base_inertia(body: Body) -> Inertia:
    """M of the vessel file -> [kg, kg m, kg m²]."""
    return Inertia(body.m11, 0.0, 0.0, body.m22, body.mass * body.x_g, body.m33)


@jitable
def inertia_force(M: Inertia, a: Velocity) -> Wrench:
    """M ν̇ -> X, Y, N [N, N, N m]."""
    return Wrench(
        M.m11 * a.u + M.m12 * a.v + M.m13 * a.r,
        M.m12 * a.u + M.m22 * a.v + M.m23 * a.r,
        M.m13 * a.u + M.m23 * a.v + M.m33 * a.r,
    )


@jitable
def coriolis_force(M: Inertia, nu: Velocity) -> Wrench:
    """C(ν) ν with C built from M: νᵀ C ν = 0 -> X, Y, N [N, N, N m]."""
    p_x = M.m11 * nu.u + M.m12 * nu.v + M.m13 * nu.r  # momentum ahead
    p_y = M.m12 * nu.u + M.m22 * nu.v + M.m23 * nu.r  # momentum to starboard
    return Wrench(-p_y * nu.r, p_x * nu.r, p_y * nu.u - p_x * nu.v)


@jitable
def damping_force(body: Body, nu: Velocity) -> Wrench:
    """D(ν) ν, the force of damping -> X, Y, N [N, N, N m]."""
    u, v, r = nu.u, nu.v, nu.r
    return Wrench(
        -(body.X_u + body.X_uu * np.abs(u)) * u,
        -(body.Y_v + body.Y_vv * np.abs(v)) * v
        - (body.Y_r * r + body.Y_uv * u * v + body.Y_ur * u * r),
        -(body.N_r + body.N_rr * np.abs(r)) * r
        - (body.N_v * v + body.N_uv * u * v + body.N_ur * u * r),
    )


@jitable
def balance_residual(
    M: Inertia, body: Body, rel: Velocity, rel_dot: Velocity, tau: Wrench
) -> Wrench:
    """The balance: M ν̇_rel + C(ν_rel) ν_rel + D(ν_rel) ν_rel − τ -> X, Y, N [N, N, N m]."""
    a = inertia_force(M, rel_dot)
    c = coriolis_force(M, rel)
    d = damping_force(body, rel)
    return Wrench(a.X + c.X + d.X - tau.X, a.Y + c.Y + d.Y - tau.Y, a.N + c.N + d.N - tau.N)


@jitable
def solve(M: Inertia, tau: Wrench) -> Velocity:
    """M⁻¹ τ by the adjugate of the symmetric 3×3 -> [m/s², m/s², rad/s²]."""
    a11 = M.m22 * M.m33 - M.m23 * M.m23
    a12 = M.m13 * M.m23 - M.m12 * M.m33
    a13 = M.m12 * M.m23 - M.m13 * M.m22
    a22 = M.m11 * M.m33 - M.m13 * M.m13
    a23 = M.m12 * M.m13 - M.m11 * M.m23
    a33 = M.m11 * M.m22 - M.m12 * M.m12
    det = M.m11 * a11 + M.m12 * a12 + M.m13 * a13
    return Velocity(
        (a11 * tau.X + a12 * tau.Y + a13 * tau.N) / det,
        (a12 * tau.X + a22 * tau.Y + a23 * tau.N) / det,
        (a13 * tau.X + a23 * tau.Y + a33 * tau.N) / det,
    )


@jitable
def relative_velocity(flow: Flow) -> Velocity:
    """Velocity of the hull through the water -> u, v [m/s], r [rad/s]."""
    return Velocity(flow.u, flow.v, flow.r)
