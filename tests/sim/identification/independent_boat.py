"""A boat in plain Python, sharing no code with `sim`: what identification is to find again.

Small steps of Euler's method; one screw, a rudder in its jet or a motor that turns.
"""

from math import atan2, cos, pi, sin, sqrt

import numpy as np

from sim.trial import Trial
from tests.sim.identification.noisy_trials import wander

DT, SMALL = 0.1, 0.005
MASS = {"m11": 60.0, "m22": 95.0, "m33": 30.0}
DRAG = {"X_u": 12.0, "X_uu": 9.0, "Y_v": 40.0, "Y_vv": 60.0, "N_r": 25.0, "N_rr": 15.0}
X_RUDDER, X_SCREW, FULL = -1.2, -1.0, 120.0


def blade(u, v, r, angle, thrust, area, aspect):
    """Forces of a rudder in the jet of the screw: X, Y, N."""
    disc = pi / 4.0 * area * aspect
    u_r = u + sqrt(u * u + 2.0 * max(thrust, 0.0) / (1000.0 * disc)) - abs(u)
    v_r = v + X_RUDDER * r
    attack = min(max(sin(angle + atan2(v_r, u_r)), -0.5), 0.5)
    normal = 500.0 * area * 6.13 * aspect / (aspect + 2.25) * attack * (u_r**2 + v_r**2)
    return -normal * sin(angle), -normal * cos(angle), X_RUDDER * -normal * cos(angle)


def motor(angle, thrust):
    """Forces of a motor turned by an angle: X, Y, N."""
    return thrust * cos(angle), -thrust * sin(angle), -X_SCREW * thrust * sin(angle)


def sail(force, seconds, seed, current=(0.0, 0.0)):
    """Random throttle and helm; `force` (u, v, r, throttle, helm) -> X, Y, N -> Trial."""
    rng = np.random.default_rng(seed)
    steps = int(seconds / DT)
    commands = np.repeat(rng.uniform([0.2, -1.0], [1.0, 1.0], (steps // 25 + 1, 2)), 25, axis=0)
    north = east = yaw = u = v = r = 0.0
    rows = []
    for throttle, helm in commands[:steps].tolist():
        c, s = cos(yaw), sin(yaw)
        u_c, v_c = c * current[0] + s * current[1], -s * current[0] + c * current[1]
        rows.append((north, east, yaw, u + u_c, v + v_c, r))
        for _ in range(round(DT / SMALL)):
            X, Y, N = force(u, v, r, throttle, helm)
            X += MASS["m22"] * v * r - (DRAG["X_u"] + DRAG["X_uu"] * abs(u)) * u
            Y += -MASS["m11"] * u * r - (DRAG["Y_v"] + DRAG["Y_vv"] * abs(v)) * v
            N += (MASS["m11"] - MASS["m22"]) * u * v - (DRAG["N_r"] + DRAG["N_rr"] * abs(r)) * r
            u, v, r = (
                u + SMALL * X / MASS["m11"],
                v + SMALL * Y / MASS["m22"],
                r + SMALL * N / MASS["m33"],
            )
            north += SMALL * (u * cos(yaw) - v * sin(yaw) + current[0])
            east += SMALL * (u * sin(yaw) + v * cos(yaw) + current[1])
            yaw += SMALL * r
    motion = np.array(rows)
    error = np.stack(
        [wander(std, tau, steps, rng) for std, tau in ((0.01, 2.0), (0.01, 2.0), (0.002, 0.4))], 1
    )
    nu = motion[:, 3:] + error
    variance = np.diag([0.1, 0.1, 1e-4, 1e-4, 1e-4, 4e-6, 1e-2, 1e-2, 1e-3])
    return Trial(
        name=f"voyage {seed}", time=DT * np.arange(steps), eta=motion[:, :3], nu=nu,
        nu_dot=np.gradient(nu, DT, axis=0), covariance=np.tile(variance, (steps, 1, 1)),
        channels=(1, 3), pwm=1500.0 + 400.0 * commands[:steps], voltage=np.full(steps, np.nan),
        wind=np.full((steps, 2), np.nan), usable=np.ones(steps, bool),
    )  # fmt: skip
