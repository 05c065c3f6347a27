"""Voyages for the tests: one by the project's own model, one by physics written here anew."""

from collections.abc import Callable
from dataclasses import replace
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.trial import Trial
from sim.vessel import Dynamics, Hull, Servo, Thruster, Vessel

Floats = NDArray[np.float64]

WAM_V = Vessel(
    name="plain",
    hull=Hull(4.9, 2.3, 180.0),
    dynamics=Dynamics(126.0, 121.4, 70.5, -26.6, -35.9, -36.4, -27.4, -99.2, -10.6),
    thrusters=(
        Thruster("left", Servo(1), (-0.7, -0.7), (-85.0, 90.0)),
        Thruster("right", Servo(3), (-0.7, 0.7), (-85.0, 90.0)),
    ),
)
UNSTABLE = replace(  # more sway than surge inertia, little damping in yaw: U_c is 0.3 m/s
    WAM_V, name="unstable", dynamics=replace(WAM_V.dynamics, m22=250.0, N_r=-40.0)
)


def commands(seconds: float, dt: float, seed: int = 1) -> Floats:
    """Thruster commands (T, 2): held for 2 to 8 s, mostly ahead."""
    rng = np.random.default_rng(seed)
    rows: list[Floats] = []
    while sum(len(r) for r in rows) < seconds / dt:
        base, turn = rng.uniform(-0.2, 0.9), rng.uniform(-0.3, 0.3)
        held = np.clip([base + turn, base - turn], -1.0, 1.0)
        rows.append(np.tile(held, (int(rng.uniform(2.0, 8.0) / dt), 1)))
    return np.concatenate(rows)[: int(seconds / dt)]


def trial_of(
    eta: Floats, nu: Floats, nu_dot: Floats, drive: Floats, dt: float, covariance: Floats
) -> Trial:
    """Motion (T, 3) each, commands (T, 2) of channels 1 and 3, covariance (9, 9) -> a trial."""
    T = len(drive)
    return Trial(
        name="voyage", time=dt * np.arange(T), eta=eta, nu=nu, nu_dot=nu_dot,
        covariance=np.tile(covariance, (T, 1, 1)), channels=(1, 3), pwm=1500.0 + 400.0 * drive,
        voltage=np.full(T, np.nan), wind=np.full((T, 2), np.nan), usable=np.ones(T, bool),
    )  # fmt: skip


def simulated(vessel: Vessel, seconds: float = 120.0, dt: float = 0.05, seed: int = 1) -> Trial:
    """What the project's own model does: for questions of bookkeeping only."""
    drive = commands(seconds, dt, seed)
    _, reports = Model.of(vessel).simulate(drive, dt)
    motion = reports[0, : len(drive)]
    return trial_of(
        motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, dt, np.diag(np.full(9, 1e-12))
    )


def voyage(
    seconds: float, dt: float = 0.05, seed: int = 1, current: tuple[float, float] = (0.0, 0.0),
    kept: Floats | float = 1.0,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """The boat of `WAM_V` in a current towards (north, east) [m/s], physics written anew; `kept`
    (T, 2): shares of their commands that the motors follow.

    -> eta, nu, nu_dot (T, 3), commands (T, 2) that were followed
    """
    drive = kept * commands(seconds, dt, seed)
    return _sailed(WAM_V, len(drive), dt, np.array(current), lambda k, x: drive[k])


def legs(vessel: Vessel, seconds: float, dt: float = 0.05) -> tuple[Floats, Floats, Floats, Floats]:
    """Legs of 20 s that an autopilot keeps straight, though the hull would not; as `voyage`."""

    def pilot(k: int, x: Floats) -> Floats:
        off = 0.4 * (k * dt // 20.0) - x[2]
        turn = np.clip(off - 2.0 * x[5], -0.4, 0.4)
        return np.array([0.5 + turn, 0.5 - turn])

    return _sailed(vessel, round(seconds / dt), dt, np.zeros(2), pilot)


def in_a_sea(
    seconds: float,
    dt: float = 0.1,
    late: float = 0.0,
    port: float = 1.0,
    current: tuple[float, float] = (0.0, 0.0),
) -> tuple[Floats, Floats, Floats, Floats]:
    """Courses that an autopilot holds against thirty waves of three seconds or so, of all phases;
    motors hear it `late` [s], the port one gives such a share of its thrust, the water runs towards
    (north, east) [m/s]; as `voyage`.
    """
    chance = np.random.default_rng(4)
    rate, phase = chance.normal(2.1, 0.3, 30), chance.uniform(0.0, 2.0 * np.pi, (3, 30))
    turn = np.arange(0.0, seconds, dt)[:, None, None] * rate + phase
    waves = np.sin(turn).sum(axis=2) * np.array([6.0, 8.0, 12.0])

    def pilot(k: int, x: Floats) -> Floats:
        off = 1.2 * (k * dt // 25.0) - x[2]
        turn = np.clip(0.9 * off - 0.5 * x[5], -0.5, 0.5)
        ahead = 0.5 + 0.4 * (1.2 + 0.4 * sin(0.1 * k * dt) - x[3])
        return np.clip([ahead + turn, ahead - turn], -0.5, 1.0)

    rows = round(late / dt)
    stream = np.array(current)
    return _sailed(WAM_V, len(waves), dt, stream, pilot, lambda k: waves[k], rows, port)


def _sailed(
    vessel: Vessel, T: int, dt: float, stream: Floats, pilot: Callable[[int, Floats], Floats],
    push: Callable[[int], Floats] = lambda k: np.zeros(3), late: int = 0, port: float = 1.0,
) -> tuple[Floats, Floats, Floats, Floats]:  # fmt: skip
    """Midpoint rule on plain floats: other code, another integrator, the same equations.

    push  [N, N, N m] on the boat at a row; motors act as they were told `late` rows before, the
          port one with such a share of its thrust
    """
    d, (north, east) = vessel.dynamics, stream

    def rate(x: list[float], left: float, right: float, other: Floats) -> list[float]:
        c, s = cos(x[2]), sin(x[2])
        u_c, v_c = c * north + s * east, c * east - s * north
        u, v, r = x[3] - u_c, x[4] - v_c, x[5]
        X = other[0] + left + right + d.m22 * v * r + (d.X_u + d.X_uu * abs(u)) * u
        Y = other[1] - d.m11 * u * r + (d.Y_v + d.Y_vv * abs(v)) * v
        N = 0.7 * (left - right) + (d.m11 - d.m22) * u * v + (d.N_r + d.N_rr * abs(r)) * r
        N += other[2]
        return [
            c * x[3] - s * x[4], s * x[3] + c * x[4], r,
            X / d.m11 + r * v_c, Y / d.m22 - r * u_c, N / d.m33,
        ]  # fmt: skip

    parts = 5
    h, x = dt / parts, [0.0, 0.0, 0.0, north, east, 0.0]
    out, drive = np.empty((T, 9)), np.empty((T, 2))
    for k in range(T):
        drive[k] = pilot(k, np.array(x))
        acting, other = drive[max(k - late, 0)], push(k)
        left, right = (float(90.0 * c if c >= 0.0 else 85.0 * c) for c in acting)
        left *= port
        out[k] = [*x, *rate(x, left, right, other)[3:]]
        for _ in range(parts):
            half = rate(x, left, right, other)
            mid = rate([a + 0.5 * h * b for a, b in zip(x, half, strict=True)], left, right, other)
            x = [a + h * b for a, b in zip(x, mid, strict=True)]
    return out[:, :3], out[:, 3:6], out[:, 6:], drive
