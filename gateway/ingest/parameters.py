"""Output channels by the autopilot's parameters (for `shadow init`), and its banner."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from gateway.samples import CHANNELS


class OutputFunction(StrEnum):
    """What an output channel moves."""

    THROTTLE = "throttle"
    THROTTLE_LEFT = "throttle left"
    THROTTLE_RIGHT = "throttle right"
    MOTOR = "motor"
    STEERING = "steering"
    PASSTHROUGH = "passthrough"


THRUST_FUNCTIONS = (
    OutputFunction.THROTTLE,
    OutputFunction.THROTTLE_LEFT,
    OutputFunction.THROTTLE_RIGHT,
    OutputFunction.MOTOR,
)
FUNCTIONS: Mapping[int, OutputFunction] = {  # SERVOn_FUNCTION
    70: OutputFunction.THROTTLE,
    73: OutputFunction.THROTTLE_LEFT,
    74: OutputFunction.THROTTLE_RIGHT,
    26: OutputFunction.STEERING,
    1: OutputFunction.PASSTHROUGH,
    **dict.fromkeys(range(33, 37), OutputFunction.MOTOR),
    **dict.fromkeys(range(51, 67), OutputFunction.PASSTHROUGH),
}
LIMITS_US = (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))  # ArduPilot's own, where unset
BANNER = re.compile(r"(Ardu\w+|APM\w*|PX4|Blimp)\b.*\d+\.\d+")  # "ArduRover V4.6.3 (3fc7011a)"


@dataclass(frozen=True)
class Actuator:
    """One output channel that moves the boat."""

    channel: int  # 1-based
    function: int  # SERVOn_FUNCTION
    kind: OutputFunction
    pwm: tuple[float, float, float]  # lowest, neutral, highest [µs]
    reversed: bool

    @property
    def motor(self) -> int | None:
        """Number of the motor (1 to 4) where its function is a motor's."""
        return self.function - 32 if self.kind is OutputFunction.MOTOR else None


def actuators(parameters: Mapping[str, float]) -> list[Actuator]:
    """Parameters -> the channels that move the boat, in order."""
    found = []
    for channel in range(1, CHANNELS + 1):
        function = int(parameters.get(f"SERVO{channel}_FUNCTION", 0))
        if function in FUNCTIONS:
            low, neutral, high = (
                float(parameters.get(f"SERVO{channel}_{name}", default))
                for name, default in LIMITS_US
            )
            reversed_ = bool(parameters.get(f"SERVO{channel}_REVERSED", 0.0))
            pwm = (low, neutral, high)
            found.append(Actuator(channel, function, FUNCTIONS[function], pwm, reversed_))
    return found


def banner(lines: Iterable[str]) -> str:
    """The first text that names an autopilot's software and its version; empty without one."""
    return next((line for line in lines if BANNER.match(line)), "")
