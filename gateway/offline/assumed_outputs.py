"""Which output drives what, where a log holds no parameters that say it: assumed, then checked.

The two outputs that move most are the port and the starboard motor, or steering and throttle as
ArduPilot has them by default; which it is, and which way round, is what the boat's own turns and
speeds follow best. A single output that moves is a motor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.parameters import Actuator, OutputFunction
from sim.identification.wiring import CommandResponse, command_response
from sim.state import Floats, Nu
from sim.trial import Trial

MOVES_US = 5.0  # standard deviation of an output that moves anything; chosen, not measured
USUAL_US = (1100.0, 1500.0, 1900.0)


def assumed_actuators(trial: Trial) -> tuple[list[Actuator], str]:
    """Outputs of a trial that move the boat, and the sentence that says what was assumed."""
    spread = np.nan_to_num(np.nanstd(trial.pwm[trial.usable], axis=0))
    moving = [i for i in np.argsort(-spread, kind="stable") if spread[i] > MOVES_US][:2]
    if not moving:
        raise BadInput(f"{trial.name}: no output ever changes: nothing can be learnt from that")
    outputs = [_output(trial, i) for i in sorted(moving)]
    if len(outputs) == 1:
        (one,) = outputs
        return [one], f"output {one.channel} is taken for the motor"
    first, second = outputs
    pulses = [_share(trial, i) for i in sorted(moving)]
    turn_apart = _followed(trial, pulses[0] - pulses[1], Nu.R)
    turn_alone = _followed(trial, pulses[0], Nu.R)
    if abs(turn_alone.correlation) > abs(turn_apart.correlation):
        return _steered(trial, first, second, pulses, turn_alone)
    return _apart(trial, first, second, pulses, turn_apart)


def _apart(
    trial: Trial, first: Actuator, second: Actuator, pulses: Sequence[Floats], turn: CommandResponse
) -> tuple[list[Actuator], str]:
    """Two motors side by side: their difference turns the boat, their sum drives it."""
    ahead = _followed(trial, pulses[0] + pulses[1], Nu.U)
    backwards = ahead.correlation < 0.0
    swapped = (turn.correlation < 0.0) != backwards
    left, right = (second, first) if swapped else (first, second)
    text = (
        f"output {left.channel} is taken for the port motor and output {right.channel} for the "
        f"starboard motor{', both reversed' if backwards else ''}, from how the boat turns"
    )
    return [
        replace(left, kind=OutputFunction.THROTTLE_LEFT, reversed=backwards),
        replace(right, kind=OutputFunction.THROTTLE_RIGHT, reversed=backwards),
    ], text


def _steered(
    trial: Trial, first: Actuator, second: Actuator, pulses: Sequence[Floats], turn: CommandResponse
) -> tuple[list[Actuator], str]:
    """Steering on the first of the two outputs, throttle on the second."""
    backwards = _followed(trial, pulses[1], Nu.U).correlation < 0.0
    text = (
        f"output {first.channel} is taken for the steering and output {second.channel} for the "
        "motor, from how the boat turns"
    )
    steering = replace(first, kind=OutputFunction.STEERING, reversed=turn.correlation < 0.0)
    return [steering, replace(second, reversed=backwards)], text


def _output(trial: Trial, i: int) -> Actuator:
    """A motor of the usual pulses, wider where the log's are."""
    low, neutral, high = USUAL_US
    pwm = trial.pwm[trial.usable, i]
    limits = (min(low, float(np.nanmin(pwm))), neutral, max(high, float(np.nanmax(pwm))))
    return Actuator(trial.channels[i], 70, OutputFunction.THROTTLE, limits, False)


def _share(trial: Trial, i: int) -> Floats:
    """Pulses as shares of full (T,), neutral where there are none."""
    low, neutral, high = USUAL_US
    return np.nan_to_num((trial.pwm[:, i] - neutral) / (high - low) * 2.0)


def _followed(trial: Trial, command: Floats, axis: Nu) -> CommandResponse:
    """How clearly a motion follows a command; nothing where neither was excited."""
    found = command_response(command, trial.nu[:, axis], trial.usable, trial.dt, axis)
    return found or CommandResponse(0.0, 0.0)
