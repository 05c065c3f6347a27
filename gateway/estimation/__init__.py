"""From measurements at their own times and rates to motion with its uncertainty.

Here: indices of the state and of what is kept per measurement, kinds of measurements, flags; and
process noise, measurement noise, gates and limits of the filter: `[filter]` of gateway.toml.

An autopilot's outputs are filtered already, so their errors are coloured: each quantity has a
white part (by source message) and a first-order Gauss-Markov part (std and time constant). The
boat's acceleration is a first-order Gauss-Markov process too (R. A. Singer, IEEE Transactions on
Aerospace and Electronic Systems, 1970).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from typing import NamedTuple

from scipy.special import chdtri

from gateway.errors import BadInput
from gateway.estimation.gyro_delay import gyro_delay_of
from sim.trial import MOTION


class State(IntEnum):
    """Components of the filter's state; the first nine are the motion of a `Trial`."""

    NORTH = 0  # m
    EAST = 1  # m
    YAW = 2  # rad, continuous
    U = 3  # m/s, over ground
    V = 4  # m/s
    R = 5  # rad/s
    U_DOT = 6  # m/s², derivative of the body component
    V_DOT = 7  # m/s²
    R_DOT = 8  # rad/s²
    POSITION_ERROR_NORTH = 9  # m, reported − true
    POSITION_ERROR_EAST = 10  # m
    VELOCITY_ERROR_FIRST = 11  # m/s, north; forward where the source reports body velocity
    VELOCITY_ERROR_SECOND = 12  # m/s, east; starboard


STATES = len(State)
assert State.R_DOT + 1 == MOTION


class MeasurementKind(IntEnum):
    """What an event measures."""

    TICK = 0  # nothing: prediction only
    YAW = 1  # rad
    YAW_RATE = 2  # rad/s
    VELOCITY = 3  # north, east over ground [m/s]
    POSITION = 4  # north, east [m]
    BODY_VELOCITY = 5  # forward, starboard over ground [m/s]; instead of VELOCITY, not beside it


KINDS = len(MeasurementKind)


class Flag(IntFlag):
    """What became of an event, and whether the row's estimate can be used."""

    VALID = 1  # the estimate rests on yaw and on velocity or position
    USED = 2
    GATED = 4  # an outlier or no number: not used
    WAITING = 8  # not used: heading is not known (yet, or any more)
    LATE = 16  # used after rewinding the filter
    REFUSED = 32  # too late, or no valid time or kind
    JUMP = 64  # states re-initialised after a discontinuity of the source
    RESTART = 128  # everything forgotten: a long gap, or the boat's clock stepped


class GateRecord(IntEnum):
    """What is kept about the gate of each kind of measurement."""

    SEEN = 0  # 1.0 once a measurement was used
    GATED_RUN = 1  # number gated in a row
    GATED_SINCE = 2  # time of the first of them [s]
    COUNT = 3  # measurements that the next rests on, see `scatter`
    SCATTER = 4  # variance of the white errors over the assumed one
    TIME = 5  # of the last measurement [s]
    STEP = 6  # since the one before it [s]
    MEASURED = 7  # the last measurement, two components
    CHANGE = 9  # since the one before it
    BEND = 11  # how far it lay from the line through the two before it


GATE_RECORDS = GateRecord.BEND + 2


SMALLEST, LARGEST = 1e-9, 1e6  # of any number of the table, in SI
BOUNDS = {  # narrower where a wild value would cost time or memory without end
    "gyro_delay_s": (0.0, 10.0),
    "gyro_delay_std_s": (0.0, 10.0),
    "max_step_s": (1e-3, LARGEST),
    "history_events": (2, 100_000),
}


@dataclass(frozen=True)
class WhiteNoise:
    """Standard deviations of the white part of one source's errors."""

    yaw_rad: float = 0.01
    yaw_rate_radps: float = 0.01
    velocity_mps: float = 0.05
    position_m: float = 0.1
    body_velocity_mps: float = 0.05

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not SMALLEST <= value <= LARGEST:
                raise BadInput(f"[filter.sources] {name} = {value}: expected a positive number")

    def of(self, kind: MeasurementKind) -> float:
        """Standard deviation in the unit of that kind."""
        return float(getattr(self, FIELD_OF_KIND[kind]))


FIELD_OF_KIND = {
    MeasurementKind.YAW: "yaw_rad",
    MeasurementKind.YAW_RATE: "yaw_rate_radps",
    MeasurementKind.VELOCITY: "velocity_mps",
    MeasurementKind.POSITION: "position_m",
    MeasurementKind.BODY_VELOCITY: "body_velocity_mps",
}

# White parts on top of the coloured errors below. An autopilot's filter gives smooth outputs; the
# values are several times what ArduRover shows in simulation, whose sensors are clean.
SOURCES: Mapping[str, WhiteNoise] = {
    "ATTITUDE": WhiteNoise(yaw_rad=0.001, yaw_rate_radps=0.006),
    "ATTITUDE_QUATERNION": WhiteNoise(yaw_rad=0.001, yaw_rate_radps=0.006),
    "LOCAL_POSITION_NED": WhiteNoise(velocity_mps=0.015, position_m=0.02),
    "ODOMETRY": WhiteNoise(
        yaw_rad=0.001, velocity_mps=0.015, body_velocity_mps=0.015, position_m=0.02
    ),
    "GLOBAL_POSITION_INT": WhiteNoise(yaw_rad=0.005, velocity_mps=0.015, position_m=0.02),
    "GPS_RAW_INT": WhiteNoise(velocity_mps=0.1, position_m=0.3),
    "VFR_HUD": WhiteNoise(yaw_rad=0.01, velocity_mps=0.03, body_velocity_mps=0.1),
    "RAW_IMU": WhiteNoise(yaw_rate_radps=0.006),
    "SCALED_IMU": WhiteNoise(yaw_rate_radps=0.006),
    "SCALED_IMU2": WhiteNoise(yaw_rate_radps=0.006),
    "SCALED_IMU3": WhiteNoise(yaw_rate_radps=0.006),
    "HIGHRES_IMU": WhiteNoise(yaw_rate_radps=0.006),
    "XKF1": WhiteNoise(yaw_rad=0.001, velocity_mps=0.015, position_m=0.02),
    "ATT": WhiteNoise(yaw_rad=0.001),
    "IMU": WhiteNoise(yaw_rate_radps=0.006),
    "GPS": WhiteNoise(velocity_mps=0.1, position_m=0.3),
}


class FilterModel(NamedTuple):
    """The settings as the compiled kernels take them: all floats; gates as bounds of the NIS."""

    surge_acceleration_mps2: float
    surge_tau_s: float
    sway_acceleration_mps2: float
    sway_tau_s: float
    yaw_acceleration_radps2: float
    yaw_tau_s: float
    position_error_m: float
    position_error_tau_s: float
    velocity_error_mps: float
    velocity_error_tau_s: float
    heading_error_rad: float
    gyro_delay_s: float
    gyro_delay_std_s: float
    gated_in_a_row: float
    gated_for_s: float
    max_late_s: float
    gap_s: float
    refused_in_a_row: float
    max_step_s: float
    prior_position_m: float
    prior_speed_mps: float
    prior_yaw_rate_radps: float
    gate_one: float  # NIS of a measurement with one component
    gate_two: float


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
    heading_error_rad: float = 0.02  # slow; see `filter.heading_slope`
    gyro_delay_s: float = 0.0  # of the reported yaw rate; see `with_parameters`
    gyro_delay_std_s: float = 0.0  # of what is not known of that delay
    sources: Mapping[str, WhiteNoise] = field(default_factory=lambda: SOURCES)
    gate_probability: float = 0.999999  # share of measurements with the assumed errors that pass
    gated_in_a_row: int = 10  # so many outliers …
    gated_for_s: float = 1.0  # … over so long are a discontinuity of the source
    max_late_s: float = 1.0  # later events are refused
    gap_s: float = 60.0  # a longer silence, or a clock step back by more, starts afresh
    refused_in_a_row: int = 50  # so many late events: the filter's own clock is wrong
    history_events: int = 256  # how far back a late event can rewind, in events
    max_step_s: float = 0.1  # longer predictions are cut into steps
    prior_position_m: float = 1e4
    prior_speed_mps: float = 5.0
    prior_yaw_rate_radps: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            low, high = BOUNDS.get(name, (SMALLEST, LARGEST))
            if name != "sources" and not low <= value <= high:
                raise BadInput(
                    f"[filter] {name} = {value}: expected a positive number, {low:g} to {high:g}"
                )
        if self.gate_probability >= 1.0:
            raise BadInput(f"[filter] gate_probability = {self.gate_probability}: expected < 1")

    def with_parameters(
        self, parameters: Mapping[str, float], autopilot: str = ""
    ) -> "FilterSettings":
        """The same with the delay of the autopilot's gyro filter, assumed where nothing tells it.

        A delay that was set already stays.
        """
        if self.gyro_delay_s > 0.0 or self.gyro_delay_std_s > 0.0:
            return self
        delay = gyro_delay_of(parameters, autopilot)
        return replace(self, gyro_delay_s=delay.seconds, gyro_delay_std_s=delay.std_s)

    def white_std(self, kind: MeasurementKind, source: str) -> float:
        """Standard deviation of the white error of one kind of measurement from one message."""
        return self.sources.get(source, WhiteNoise()).of(kind)

    def kernel_model(self) -> FilterModel:
        """The numbers for the compiled kernels."""
        settings = (float(getattr(self, name)) for name in FilterModel._fields[:-2])
        gates = (float(chdtri(components, 1.0 - self.gate_probability)) for components in (1, 2))
        return FilterModel(*settings, *gates)
