"""What PX4's parameters say of its outputs: which of them drives which motor or servo.

    PWM_MAIN_FUNC3 = 102    output 3 of the driver PWM_MAIN drives motor 2

101 … 112 are motors, 201 … 208 servos. Nothing says where a motor is: motor 1 of a differential
rover is to port in some versions of PX4 and to starboard in others.

Source: PX4-Autopilot, src/lib/mixer_module/output_functions.yaml, src/modules/control_allocator.
"""

import re
from collections.abc import Mapping, Sequence

MOTORS, SERVOS = range(101, 113), range(201, 209)
DRIVERS = "PWM_MAIN|PWM_AUX|PWM_EXTRA|PCA9685|UAVCAN_EC|UAVCAN_SV|SIM_GZ_EC|SIM_GZ_SV|HIL_ACT"
FUNCTION = re.compile(rf"({DRIVERS})_FUNC(\d+)")
# decide what a value of an output does; those of limits do where they change by a few µs
DIRECTIONS = re.compile(rf"({DRIVERS})_(FUNC|REV|TIM)\d*|CA_R_REV|CA_AIRFRAME")
LIMITS = re.compile(rf"({DRIVERS})_(MIN|MAX|DIS|DISARM|CENT|TRIM)\d*|PWM_MIN|PWM_MAX")
MOST_NAMED = 4  # in one sentence


def named_outputs(parameters: Mapping[str, float]) -> tuple[str, ...]:
    """Parameters -> "motor 1 on output 3 of PWM_MAIN", … in order; empty where none is named."""
    found = []
    for name, value in parameters.items():
        match = FUNCTION.fullmatch(name)
        if match is None or (value not in MOTORS and value not in SERVOS):
            continue
        kind, first = ("motor", MOTORS[0]) if value in MOTORS else ("servo", SERVOS[0])
        driver, output = match.groups()
        found.append((kind, int(value) - first + 1, driver, int(output)))
    return tuple(
        f"{kind} {number} on output {output} of {driver}"
        for kind, number, driver, output in sorted(found)
    )


def named_only(outputs: Sequence[str]) -> str:
    """That outputs have names but no places, as half a sentence; empty without any."""
    if not outputs:
        return ""
    more = f" and {len(outputs) - MOST_NAMED} more" if len(outputs) > MOST_NAMED else ""
    return f"PX4 names {', '.join(outputs[:MOST_NAMED])}{more}, but not where on the boat they are"
