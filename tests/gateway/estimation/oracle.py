"""The filter written a second time, slowly: filterpy's, with Jacobians by complex steps."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, rts_smoother
from scipy.linalg import block_diag, expm

from gateway.estimation import STATES, FilterSettings, MeasurementKind
from gateway.estimation.events import Events, join, make_events, ticks


@lru_cache(maxsize=8)  # the same three for each column of a Jacobian
def axis(dt, sigma, tau):
    """Transition and noise of (displacement, velocity, acceleration) by Van Loan's method."""
    A = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / tau]])
    G = np.diag([0, 0, 2 * sigma**2 / tau])
    big = expm(np.block([[-A, G], [np.zeros((3, 3)), A.T]]) * dt)
    F = big[3:, 3:].T
    return F, F @ big[:3, 3:]


def axes(dt, s):
    return (
        axis(dt, s.surge_acceleration_mps2, s.surge_tau_s),
        axis(dt, s.sway_acceleration_mps2, s.sway_tau_s),
        axis(dt, s.yaw_acceleration_radps2, s.yaw_tau_s),
    )


def errors(s):
    """Std and time constant of the four coloured errors."""
    position = (s.position_error_m, s.position_error_tau_s)
    velocity = (s.velocity_error_mps, s.velocity_error_tau_s)
    return np.array([position, position, velocity, velocity])


def process(x, dt, s):
    """State (13,) -> state dt later; complex numbers welcome."""
    n, e, psi, u, v, r, a, b, c = x[:9]
    (Fu, _), (Fv, _), (Fr, _) = axes(dt, s)
    ahead, u1, a1 = Fu @ [0, u, a]
    aside, v1, b1 = Fv @ [0, v, b]
    psi1, r1, c1 = Fr @ [psi, r, c]
    middle = psi + r * dt / 2 + c * dt**2 / 8
    n1 = n + np.cos(middle) * ahead - np.sin(middle) * aside
    e1 = e + np.sin(middle) * ahead + np.cos(middle) * aside
    decay = np.exp(-dt / errors(s)[:, 1])
    return np.concatenate([[n1, e1, psi1, u1, v1, r1, a1, b1, c1], decay * x[9:]])


def process_noise(x, dt, s):
    (_, Qu), (_, Qv), (_, Qr) = axes(dt, s)
    middle = x[2] + x[5] * dt / 2 + x[8] * dt**2 / 8
    c, si = np.cos(middle), np.sin(middle)
    sigma, tau = errors(s).T
    # (displacement ahead, u, u_dot, aside, v, v_dot, yaw, r, r_dot) -> the order of the state
    T = np.zeros((9, 9))
    T[0, [0, 3]] = c, -si
    T[1, [0, 3]] = si, c
    for row, column in ((2, 6), (3, 1), (4, 4), (5, 7), (6, 2), (7, 5), (8, 8)):
        T[row, column] = 1
    motion = T @ block_diag(Qu, Qv, Qr) @ T.T
    return block_diag(motion, np.diag(sigma**2 * (1 - np.exp(-2 * dt / tau))))


def reading(kind, x, s):
    """State (13,) -> what that kind reads."""
    n, e, psi, u, v, r, _, _, r_dot, pn, pe, v1, v2 = x
    c, si = np.cos(psi), np.sin(psi)
    return {
        MeasurementKind.YAW: lambda: np.array([psi]),
        MeasurementKind.YAW_RATE: lambda: np.array([r - s.gyro_delay_s * r_dot]),
        MeasurementKind.VELOCITY: lambda: np.array([c * u - si * v + v1, si * u + c * v + v2]),
        MeasurementKind.POSITION: lambda: np.array([n + pn, e + pe]),
        MeasurementKind.BODY_VELOCITY: lambda: np.array([u + v1, v + v2]),
    }[kind]()


def jacobian(function, x):
    columns = [function(x + 1e-30j * direction).imag / 1e-30 for direction in np.eye(len(x))]
    return np.stack(columns, axis=1)


def prior(s):
    P = np.zeros(STATES)
    P[:3] = s.prior_position_m**2, s.prior_position_m**2, np.pi**2
    P[3:6] = s.prior_speed_mps**2, s.prior_speed_mps**2, s.prior_yaw_rate_radps**2
    P[6:9] = (
        s.surge_acceleration_mps2**2,
        s.sway_acceleration_mps2**2,
        s.yaw_acceleration_radps2**2,
    )
    P[9:] = errors(s)[:, 0] ** 2
    return np.diag(P)


@dataclass
class Run:
    x: np.ndarray
    P: np.ndarray
    F: np.ndarray  # into step k
    Q: np.ndarray
    moved: np.ndarray  # the prediction's nonlinear part: f(x) − F x
    nis: np.ndarray


def run(events: Events, s: FilterSettings, along=None) -> Run:
    """filterpy over events in order of time; the first is a yaw.

    Linearised at its own state, or along given states (K, 13).
    """
    ekf = ExtendedKalmanFilter(STATES, 2)
    ekf.x, ekf.P = np.zeros(STATES), prior(s)
    ekf.x[2] = events.z[0, 0]
    out = []
    time = events.time_s[0]
    for k, (t, kind) in enumerate(zip(events.time_s, events.kind, strict=True)):
        dt = t - time
        time = t
        before = ekf.x.copy()
        ekf.F, ekf.Q = np.eye(STATES), np.zeros((STATES, STATES))
        after = before
        if dt > 0:
            at = before if along is None else along[k - 1]
            ekf.F = jacobian(lambda x, dt=dt: process(x, dt, s), at)
            ekf.Q = process_noise(at, dt, s)
            after = process(at, dt, s) + ekf.F @ (before - at)
        ekf.predict()
        moved = after - ekf.F @ before
        ekf.x = after
        nis = 0.0
        if kind != MeasurementKind.TICK:
            measure(ekf, kind, events.z[k], events.std[k], ekf.x if along is None else along[k], s)
            nis = ekf.y @ ekf.SI @ ekf.y
        out.append((ekf.x.copy(), ekf.P.copy(), ekf.F.copy(), ekf.Q.copy(), moved, nis))
    return Run(*(np.array(column) for column in zip(*out, strict=True)))


def measure(ekf, kind, z, std, at, s):
    """One update linearised at a state (13,)."""
    m = 1 if kind in (MeasurementKind.YAW, MeasurementKind.YAW_RATE) else 2
    ekf.dim_z = m
    H = jacobian(lambda x: reading(kind, x, s), at)
    ekf.update(
        z[:m],
        lambda _: H,
        lambda x: reading(kind, at, s) + H @ (x - at),
        R=np.diag(std[:m] ** 2),
        residual=lambda a, b: residual(kind, a, b),
    )


def smoothed(run: Run):
    """filterpy's smoother is linear: taking an offset out of the states makes the filter so."""
    offset = np.zeros_like(run.x)
    for k in range(1, len(offset)):
        offset[k] = run.F[k] @ offset[k - 1] + run.moved[k]
    x, P, _, _ = rts_smoother(run.x - offset, run.P, run.F[1:], run.Q[1:])
    return x + offset, P


def residual(kind, a, b):
    difference = a - b
    return (difference + np.pi) % (2 * np.pi) - np.pi if kind == MeasurementKind.YAW else difference


def with_heading_error(x, P, s):
    """Motion (K, 9), covariance (K, 9, 9) -> the same with an unknown heading error on top."""
    P = P.copy()
    for k, (_, _, _, u, v, _, a, b, _) in enumerate(x):
        slope = s.heading_error_rad * np.array([0, 0, 1, v, -u, 0, b, -a, 0])
        P[k] += np.outer(slope, slope)
    return P


def random_events(rng: np.random.Generator, count: int, body: bool = False) -> Events:
    """A turning boat seen at random times by every kind of sensor, a tick now and then."""
    time = np.cumsum(rng.uniform(0.0, 0.045, count))
    time[::7] = time[np.maximum(np.arange(0, count, 7) - 1, 0)]  # some at the same moment
    yaw = 3.0 + 0.3 * time
    u, v = 1.5 + 0.5 * np.sin(time), 0.2 * np.cos(time)
    north, east = np.cos(yaw) * u - np.sin(yaw) * v, np.sin(yaw) * u + np.cos(yaw) * v
    position = np.cumsum(np.c_[north, east] * np.diff(time, prepend=0.0)[:, None], axis=0)
    velocity = np.c_[u, v] if body else np.c_[north, east]
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    choice = rng.integers(0, 5, count)
    choice[0] = 1
    kinds = (
        (MeasurementKind.YAW, wrapped, 0.02),
        (MeasurementKind.YAW_RATE, np.full(count, 0.3), 0.01),
        (MeasurementKind.BODY_VELOCITY if body else MeasurementKind.VELOCITY, velocity, 0.05),
        (MeasurementKind.POSITION, position, 0.2),
    )
    parts = [ticks(time[choice == 0])]
    for n, (kind, z, std) in enumerate(kinds, start=1):
        at = choice == n
        noise = std * rng.standard_normal(z[at].shape)
        parts.append(make_events(kind, time[at], z[at] + noise, std))
    events = join(parts)
    return events[np.lexsort((events.kind, events.time_s))]
