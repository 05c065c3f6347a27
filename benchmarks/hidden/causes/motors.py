"""Between the command and the thrust."""

import math
from collections.abc import Callable, Mapping

from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Scene


def thruster_lag(tau: float) -> Cause:
    """The shaft (not the thrust) follows as a first-order lag, `tau` [s]."""
    return Cause(shaft_lag=tau)


def command_delay(delay: float) -> Cause:
    """The motors hear every command `delay` [s] late."""
    return Cause(delay=delay)


def steering_lag(tau: float) -> Cause:
    """Rudders, or motors that turn, follow as a first-order lag, `tau` [s]."""
    return Cause(rudder_lag=tau)


def steering_play(play: float) -> Cause:
    """Rudders, or motors that turn, hang loose by `play` [rad] to either side."""
    return Cause(rudder_play=play)


def steering_rate(rate: float) -> Cause:
    """Rudders, or motors that turn, do so by `rate` [rad/s] at most."""
    return Cause(rudder_rate=rate)


def steering_offset(angle: float) -> Cause:
    """Amidships the rudders stand `angle` [rad] to starboard."""
    return Cause(rudder_turned=angle)


def steering_scale(gain: float) -> Cause:
    """The rudders turn `gain` times as far."""
    return Cause(rudder_gain=gain)


def thruster_misalignment(angle: float) -> Cause:
    """All motors turned clockwise by `angle` [rad]."""
    return Cause(turned=angle)


def lever_arm(gain: float) -> Cause:
    """All motors `gain` times as far from the centre line."""
    return Cause(arms=gain)


def thruster_deadband(width: float) -> Cause:
    """Nothing up to `width`; beyond it thrust as commanded, not rescaled."""
    return Cause(command=lambda cs: [c if abs(c) > width else 0.0 for c in cs])


def thrust_curve(exponent: float) -> Cause:
    """Thrust ∝ |c|^`exponent`."""
    return Cause(command=lambda cs: [math.copysign(abs(c) ** exponent, c) for c in cs])


def actuator_wiring() -> Cause:
    """The two plugs swapped: every motor does what its opposite should."""
    return Cause(command=lambda cs: cs[::-1])


def thruster_imbalance(port_gain: float) -> Cause:
    """The motors to port thrust `port_gain` times as much."""
    return Cause(thrust=lambda F, motor, s: F * port_gain if motor.y < 0.0 else F)


def thrust_scale(gain: float) -> Cause:
    """All motors thrust `gain` times as much."""
    return Cause(thrust=lambda F, motor, s: F * gain)


def reverse_loss(factor: float) -> Cause:
    """Astern thrust × `factor`."""
    return Cause(thrust=lambda F, motor, s: F * factor if F < 0.0 else F)


def thruster_fault(channel: float, gain: float, time: float) -> Cause:
    """From `time` [s] on the motor on `channel` thrusts `gain` times as much."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * gain if motor.channel == int(channel) and s.time >= time else F

    return Cause(thrust=thrust)


def battery_sag(nominal: float, tired: float = 1.0) -> Cause:
    """Shaft speed goes with the voltage, so thrust with (V/nominal)²; the battery is `tired`."""
    return Cause(tired=tired, thrust=lambda F, motor, s: F * (s.voltage / nominal) ** 2)


def advance_loss(per_mps: float) -> Cause:
    """A propeller that runs ahead loses thrust with its own inflow."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        inflow = max(s.u - motor.y * s.r, 0.0)
        return F * max(1.0 - per_mps * inflow, 0.0) if F > 0.0 else F

    return Cause(thrust=thrust)


def astern_stall(per_mps: float, above: float) -> Cause:
    """A propeller that turns astern while water comes from ahead of it stalls."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        inflow = max(s.u - motor.y * s.r - above, 0.0)
        return F * max(1.0 - per_mps * inflow, 0.0) if F < 0.0 else F

    return Cause(thrust=thrust)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        thruster_lag, command_delay, thruster_misalignment, thruster_deadband, thrust_curve,
        actuator_wiring, thruster_imbalance, reverse_loss, thruster_fault, battery_sag,
        advance_loss, astern_stall, steering_lag, steering_offset, thrust_scale, steering_scale,
        lever_arm, steering_play, steering_rate,
    )
}  # fmt: skip
