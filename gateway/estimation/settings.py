"""What the filter assumes about boat and sensors: noise, gates, limits.

An autopilot's outputs are filtered already, so their errors are coloured: each quantity has a
white part (by source message) and a first-order Gauss-Markov part (std and time constant). The
boat's acceleration is a first-order Gauss-Markov process too (R. A. Singer, IEEE Transactions on
Aerospace and Electronic Systems, 1970).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from scipy.stats import chi2

from gateway.errors import BadInput
from gateway.estimation.names import Kind


@dataclass(frozen=True)
class White:
    """Standard deviations of the white part of one source's errors."""

    yaw_rad: float = 0.01
    yaw_rate_radps: float = 0.01
    velocity_mps: float = 0.05
    position_m: float = 0.1
    body_velocity_mps: float = 0.05
    acceleration_mps2: float = 0.3

    def of(self, kind: Kind) -> float:
        """Standard deviation in the unit of that kind."""
        return float(getattr(self, FIELD_OF_KIND[kind]))


FIELD_OF_KIND = {
    Kind.YAW: "yaw_rad",
    Kind.YAW_RATE: "yaw_rate_radps",
    Kind.VELOCITY: "velocity_mps",
    Kind.POSITION: "position_m",
    Kind.BODY_VELOCITY: "body_velocity_mps",
    Kind.ACCELERATION: "acceleration_mps2",
}

# White parts on top of the coloured errors below. An autopilot's filter gives smooth outputs; the
# values are several times what ArduRover shows in simulation, whose sensors are clean.
SOURCES: Mapping[str, White] = {
    "ATTITUDE": White(yaw_rad=0.001, yaw_rate_radps=0.006),
    "ATTITUDE_QUATERNION": White(yaw_rad=0.001, yaw_rate_radps=0.006),
    "LOCAL_POSITION_NED": White(velocity_mps=0.015, position_m=0.02),
    "ODOMETRY": White(yaw_rad=0.001, velocity_mps=0.015, body_velocity_mps=0.015, position_m=0.02),
    "GLOBAL_POSITION_INT": White(yaw_rad=0.005, velocity_mps=0.015, position_m=0.02),
    "GPS_RAW_INT": White(velocity_mps=0.1, position_m=0.3),
    "VFR_HUD": White(yaw_rad=0.01, velocity_mps=0.03, body_velocity_mps=0.1),
    "RAW_IMU": White(yaw_rate_radps=0.006),
    "SCALED_IMU": White(yaw_rate_radps=0.006),
    "SCALED_IMU2": White(yaw_rate_radps=0.006),
    "SCALED_IMU3": White(yaw_rate_radps=0.006),
    "HIGHRES_IMU": White(yaw_rate_radps=0.006),
    "XKF1": White(yaw_rad=0.001, velocity_mps=0.015, position_m=0.02),
    "ATT": White(yaw_rad=0.001),
    "IMU": White(yaw_rate_radps=0.006),
    "GPS": White(velocity_mps=0.1, position_m=0.3),
}


class Model(NamedTuple):
    """The settings as the compiled kernels take them, SI."""

    surge_sigma: float
    surge_tau: float
    sway_sigma: float
    sway_tau: float
    yaw_sigma: float
    yaw_tau: float
    position_sigma: float
    position_tau: float
    velocity_sigma: float
    velocity_tau: float
    heading_sigma: float
    gate_one: float
    gate_two: float
    gated_run: float
    gated_for: float
    max_late: float
    gap: float
    refused_run: float
    max_step: float
    gyro_delay: float
    prior_position: float
    prior_speed: float
    prior_yaw_rate: float


def gyro_delay_s(cutoff_hz: float) -> float:
    """Cut-off of the autopilot's gyro filter [Hz] (INS_GYRO_FILTER) -> delay of its yaw rate [s].

    That of a second-order Butterworth low-pass for slow motion. 0 Hz means no filter.
    """
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0


@dataclass(frozen=True)
class FilterSettings:
    """Table `[filter]` of gateway.toml."""

    surge_acceleration_mps2: float = 0.6
    surge_tau_s: float = 1.0
    sway_acceleration_mps2: float = 0.3
    sway_tau_s: float = 1.0
    yaw_acceleration_radps2: float = 0.4
    yaw_tau_s: float = 0.7
    position_error_m: float = 0.5
    position_error_tau_s: float = 60.0
    velocity_error_mps: float = 0.03
    velocity_error_tau_s: float = 2.0
    heading_error_rad: float = 0.02  # slow; see `uncertainty.py`
    gyro_delay_s: float = 0.0  # of the reported yaw rate; see `told_by`
    sources: Mapping[str, White] = field(default_factory=lambda: SOURCES)
    gate_probability: float = 0.999999  # share of honest measurements that pass
    gated_in_a_row: int = 10  # so many outliers …
    gated_for_s: float = 1.0  # … over so long are a discontinuity of the source
    max_late_s: float = 1.0  # later events are refused
    gap_s: float = 60.0  # a longer silence, or a clock step back by more, starts afresh
    refused_in_a_row: int = 50  # so many late events: it is the filter's clock that is wrong
    history_events: int = 256  # how far back a late event can rewind, in events
    max_step_s: float = 0.1  # longer predictions are cut into steps
    prior_position_m: float = 1e4
    prior_speed_mps: float = 5.0
    prior_yaw_rate_radps: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "gyro_delay_s" and value == 0.0:
                continue
            if name != "sources" and not 0.0 < value < float("inf"):
                raise BadInput(f"[filter] {name} = {value}: expected a positive number")
        if self.gate_probability >= 1.0:
            raise BadInput(f"[filter] gate_probability = {self.gate_probability}: expected < 1")
        if self.history_events < 2:
            raise BadInput(f"[filter] history_events = {self.history_events}: expected 2 or more")

    def told_by(self, parameters: Mapping[str, float]) -> "FilterSettings":
        """The same with what the autopilot's parameters tell: the delay of its gyro filter."""
        if self.gyro_delay_s > 0.0 or "INS_GYRO_FILTER" not in parameters:
            return self
        return replace(self, gyro_delay_s=gyro_delay_s(parameters["INS_GYRO_FILTER"]))

    def white_std(self, kind: Kind, source: str) -> float:
        """Standard deviation of the white error of one kind of measurement from one message."""
        return self.sources.get(source, White()).of(kind)

    def model(self) -> Model:
        """The numbers for the compiled kernels."""
        return Model(
            self.surge_acceleration_mps2,
            self.surge_tau_s,
            self.sway_acceleration_mps2,
            self.sway_tau_s,
            self.yaw_acceleration_radps2,
            self.yaw_tau_s,
            self.position_error_m,
            self.position_error_tau_s,
            self.velocity_error_mps,
            self.velocity_error_tau_s,
            self.heading_error_rad,
            float(chi2.ppf(self.gate_probability, 1)),
            float(chi2.ppf(self.gate_probability, 2)),
            float(self.gated_in_a_row),
            self.gated_for_s,
            self.max_late_s,
            self.gap_s,
            float(self.refused_in_a_row),
            self.max_step_s,
            self.gyro_delay_s,
            self.prior_position_m,
            self.prior_speed_mps,
            self.prior_yaw_rate_radps,
        )
