"""A boat and its sensors, made without the filter's code: the truth of the tests is known."""

from dataclasses import dataclass

import numpy as np

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import Events, join, make_events

STEP = 0.01  # s


@dataclass
class Truth:
    time: np.ndarray
    motion: np.ndarray  # (T, 9): eta, nu, nu_dot

    def at(self, times):
        """(K,) -> (K, 9)"""
        columns = [np.interp(times, self.time, column) for column in self.motion.T]
        return np.stack(columns, axis=1)


def gauss_markov(rng, sigma, tau, times):
    """A stationary first-order process at ascending times."""
    x = np.empty(len(times))
    x[0] = sigma * rng.standard_normal()
    for k in range(1, len(times)):
        keep = np.exp(-(times[k] - times[k - 1]) / tau)
        x[k] = keep * x[k - 1] + sigma * np.sqrt(1 - keep**2) * rng.standard_normal()
    return x


def integrate(nu, nu_dot, start_yaw):
    """Body velocity and its rate at STEP -> truth."""
    time = STEP * np.arange(len(nu))
    yaw = start_yaw + STEP * np.concatenate([[0], np.cumsum(0.5 * (nu[1:, 2] + nu[:-1, 2]))])
    north = np.cos(yaw) * nu[:, 0] - np.sin(yaw) * nu[:, 1]
    east = np.sin(yaw) * nu[:, 0] + np.cos(yaw) * nu[:, 1]
    place = [STEP * np.concatenate([[0], np.cumsum(0.5 * (w[1:] + w[:-1]))]) for w in (north, east)]
    return Truth(time, np.column_stack([*place, yaw, nu, nu_dot]))


def singer_boat(rng, seconds, s: FilterSettings):
    """A boat that moves exactly as the filter assumes."""
    time = STEP * np.arange(round(seconds / STEP) + 1)
    a = np.column_stack(
        [
            gauss_markov(rng, s.surge_acceleration_mps2, s.surge_tau_s, time),
            gauss_markov(rng, s.sway_acceleration_mps2, s.sway_tau_s, time),
            gauss_markov(rng, s.yaw_acceleration_radps2, s.yaw_tau_s, time),
        ]
    )
    nu = np.array([1.0, 0.0, 0.0]) + STEP * np.vstack([np.zeros(3), np.cumsum(a[:-1], axis=0)])
    return integrate(nu, a, rng.uniform(-3, 3))


def weaving_boat(rng, seconds):
    """A boat on a smooth course: each velocity a sum of sines between 0.02 and 0.4 Hz."""
    time = STEP * np.arange(round(seconds / STEP) + 1)
    nu, nu_dot = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    for axis, size in enumerate((0.35, 0.10, 0.12)):
        for omega in 2 * np.pi * rng.uniform(0.02, 0.4, 6):
            phase = rng.uniform(0, 2 * np.pi)
            amplitude = size / (1 + omega)
            nu[:, axis] += amplitude * np.sin(omega * time + phase)
            nu_dot[:, axis] += amplitude * omega * np.cos(omega * time + phase)
    nu[:, 0] += 1.5
    return integrate(nu, nu_dot, rng.uniform(-3, 3))


def telemetry(
    rng, truth: Truth, s: FilterSettings, attitude_hz=50.0, position_hz=25.0, start=0.0
) -> Events:
    """What ATTITUDE and LOCAL_POSITION_NED say, in order of the boat's time."""
    end = truth.time[-1]
    fast, slow = np.arange(start, end, 1 / attitude_hz), np.arange(start, end, 1 / position_hz)

    def white(kind, source, shape):
        return s.white_std(kind, source) * rng.standard_normal(shape)

    def coloured(sigma, tau, times):
        return gauss_markov(rng, sigma, tau, times)

    motion = truth.at(fast)
    heading = motion[:, 2] + s.heading_error_rad * rng.standard_normal()
    heading += white(MeasurementKind.YAW, "ATTITUDE", len(fast))
    rate = truth.at(fast - s.gyro_delay_s)[:, 5] + white(
        MeasurementKind.YAW_RATE, "ATTITUDE", len(fast)
    )
    motion = truth.at(slow)
    yaw, u, v = motion[:, 2], motion[:, 3], motion[:, 4]
    velocity = np.c_[np.cos(yaw) * u - np.sin(yaw) * v, np.sin(yaw) * u + np.cos(yaw) * v]
    place = motion[:, :2].copy()
    for axis in range(2):
        velocity[:, axis] += coloured(s.velocity_error_mps, s.velocity_error_tau_s, slow)
        place[:, axis] += coloured(s.position_error_m, s.position_error_tau_s, slow)
    velocity += white(MeasurementKind.VELOCITY, "LOCAL_POSITION_NED", velocity.shape)
    place += white(MeasurementKind.POSITION, "LOCAL_POSITION_NED", place.shape)
    attitude, local = "ATTITUDE", "LOCAL_POSITION_NED"
    wrapped = (heading + np.pi) % (2 * np.pi) - np.pi
    events = join(
        [
            make_events(
                MeasurementKind.YAW, fast, wrapped, s.white_std(MeasurementKind.YAW, attitude)
            ),
            make_events(
                MeasurementKind.YAW_RATE,
                fast,
                rate,
                s.white_std(MeasurementKind.YAW_RATE, attitude),
            ),
            make_events(
                MeasurementKind.VELOCITY,
                slow,
                velocity,
                s.white_std(MeasurementKind.VELOCITY, local),
            ),
            make_events(
                MeasurementKind.POSITION, slow, place, s.white_std(MeasurementKind.POSITION, local)
            ),
        ]
    )
    return events[np.argsort(events.time_s, kind="stable")]
