"""The delay of the yaw rate that an autopilot reports: that of the low-pass filter of its gyros.

    d = √2 / (2π f)    f [Hz] the cut-off of a second-order Butterworth low-pass, d [s]

Valid for: motion much slower than f. The parameter that holds f is in most logs; where it is not,
the usual cut-off of the firmware is assumed, and that it may be another is an error of the yaw
rate in proportion to the boat's angular acceleration (`events.update_gated`). Without that a turn
of a heading that comes 56 ms before its rate looks like a compass that jumps.

Sources of the usual ones: ArduPilot 4.6, AP_InertialSensor.cpp (DEFAULT_GYRO_FILTER of Rover, which
drives boats); PX4 1.15, imu_gyro_parameters.c.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

# Beyond these it is a damaged number: no boat can be steered with less, and no firmware takes more.
# 0 stands for none.
LOWEST_CUTOFF_HZ, HIGHEST_CUTOFF_HZ = 0.5, 1000.0
CUTOFF = {"ArduPilot": ("INS_GYRO_FILTER", 4.0), "PX4": ("IMU_GYRO_CUTOFF", 40.0)}  # usual [Hz]
GYRO_FILTERS = tuple(name for name, _ in CUTOFF.values())
ALLOWED_S = 0.06  # chosen: no filter where 4 Hz are assumed, and the other way round
# Three times as wide as delays up to that are spread: the error is common to some ten measurements
# in a row, each of which the filter takes for independent. Of a boat whose gyro lags by 56 ms and
# nobody tells it, yaw rates are then off by 0.9 to 1.5 times what they say, else by 5 to 8 times.
UNKNOWN_STD_S = 0.1


class GyroDelay(NamedTuple):
    """A delay [s] and the standard deviation [s] of what is not known of it."""

    seconds: float
    std_s: float = 0.0


def gyro_delay_s(cutoff_hz: float) -> float:
    """Cut-off of the autopilot's gyro filter [Hz], 0 for none -> delay of its yaw rate [s]."""
    if cutoff_hz == 0.0:
        return 0.0
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff_hz)


def tells_delay(parameters: Mapping[str, float]) -> bool:
    """Whether the autopilot's parameters say what the delay is."""
    return _cutoff_hz(parameters) is not None


def _cutoff_hz(parameters: Mapping[str, float]) -> float | None:
    """The cut-off that they tell, 0 for no filter; None where they tell none that can be."""
    told = (parameters[name] for name in GYRO_FILTERS if name in parameters)
    can_be = (f for f in told if f == 0.0 or LOWEST_CUTOFF_HZ <= f <= HIGHEST_CUTOFF_HZ)
    return next(can_be, None)


def gyro_delay_of(parameters: Mapping[str, float], autopilot: str = "") -> GyroDelay:
    """What the autopilot's parameters say of the delay; what is assumed where they do not."""
    told = _cutoff_hz(parameters)
    if told is not None:
        return GyroDelay(gyro_delay_s(told))
    _, usual = CUTOFF.get(autopilot, ("", 0.0))
    return GyroDelay(gyro_delay_s(usual), UNKNOWN_STD_S)


def assumed_texts(parameters: Mapping[str, float], autopilot: str) -> tuple[str, ...]:
    """A sentence on what is assumed of the delay; none where the parameters tell it."""
    if tells_delay(parameters):
        return ()
    name, usual = CUTOFF.get(autopilot, (" or ".join(GYRO_FILTERS), 0.0))
    unknown = f"no parameter tells the delay of the yaw rate ({name})"
    allowed = f"{1e3 * ALLOWED_S:.0f} ms"
    if not usual:
        return (f"{unknown}: up to {allowed} are allowed for",)
    return (
        f"{unknown}: the {1e3 * gyro_delay_s(usual):.0f} ms of {autopilot}'s usual {usual:g} Hz "
        f"are taken, and {allowed} more or less allowed for",
    )
