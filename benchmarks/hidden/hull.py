"""How a hull answers forces: Kirchhoff's equations for the momentum of hull and dragged water.

    P_x = m11 u        P_y = m22 v + m x_g r        L = m33 r + m x_g v
    Ṗ_x = r P_y + X    Ṗ_y = −r P_x + Y             L̇ = v P_x − u P_y + N

u, v, r through the water, body axes forward and starboard. The Munk moment is v P_x − u P_y.
Source: Lamb, Hydrodynamics, 6th ed. 1932, §124; damping by SNAME derivatives.
"""

from benchmarks.hidden.boats import Hull
from benchmarks.hidden.scene import Push


def damping(h: Hull, u: float, v: float, r: float) -> Push:
    """Velocity through the water [m/s, m/s, rad/s] -> X, Y, N [N, N, N m]."""
    return Push(
        (h.X_u + h.X_uu * abs(u)) * u,
        (h.Y_v + h.Y_vv * abs(v)) * v,
        (h.N_r + h.N_rr * abs(r)) * r,
    )


def answer(h: Hull, u: float, v: float, r: float, push: Push) -> tuple[float, float, float]:
    """Velocity and all forces -> u̇, v̇ [m/s²], ṙ [rad/s²] in turning axes."""
    coupling = h.mass * h.x_g
    P_x, P_y = h.m11 * u, h.m22 * v + coupling * r
    P_x_dot = r * P_y + push.X
    P_y_dot = -r * P_x + push.Y
    L_dot = v * P_x - u * P_y + push.N
    det = h.m22 * h.m33 - coupling * coupling
    return (
        P_x_dot / h.m11,
        (h.m33 * P_y_dot - coupling * L_dot) / det,
        (h.m22 * L_dot - coupling * P_y_dot) / det,
    )
