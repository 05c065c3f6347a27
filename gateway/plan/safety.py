"""What ends a plan aboard, and the pulses it may not leave."""

from dataclasses import dataclass, fields

import numpy as np

from gateway.plan.plan import Plan
from sim.vessel import Vessel

SPEED_MARGIN = 1.3  # over the fastest predicted
LEAST_SPEED_MPS = 1.0
PULSE_SLACK_US = 25
LATE_S = 5.0  # how much longer than planned it may take


@dataclass(frozen=True)
class Safety:
    """Bounds of a run; `lowest_voltage_v` None: the autopilot's own BATT_LOW_VOLT."""

    radius_m: float
    highest_speed_mps: float
    time_out_s: float
    lowest_voltage_v: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{field.name} = {value}: expected a number above 0")


def safety_for(
    plan: Plan, radius_m: float, speed_mps: float | None, voltage_v: float | None
) -> Safety:
    """The bounds for a plan: what was asked for, else a margin over what is predicted."""
    expected = max(SPEED_MARGIN * float(plan.speed.max()), LEAST_SPEED_MPS)
    speed = round(expected, 2) if speed_mps is None else speed_mps
    return Safety(radius_m, speed, plan.seconds + LATE_S, voltage_v)


def pulse_bounds(plan: Plan) -> dict[int, tuple[int, int]]:
    """Channel -> lowest and highest pulse [µs] of the plan, neutral among them, with some slack."""
    channels, pulses = plan.vessel.pulses(plan.commands)
    own = _ends(plan.vessel)
    return {
        channel: (
            max(round(float(pulses[:, k].min())) - PULSE_SLACK_US, own[channel][0]),
            min(round(float(pulses[:, k].max())) + PULSE_SLACK_US, own[channel][1]),
        )
        for k, channel in enumerate(channels)
    }


def _ends(vessel: Vessel) -> dict[int, tuple[int, int]]:
    """Channel -> the ends of its travel in the vessel file [µs]."""
    servos = [actuator.servo for actuator in vessel.actuators]
    return {s.channel: (round(s.pwm[0]), round(s.pwm[2])) for s in servos}
