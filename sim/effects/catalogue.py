"""The one list of all effects, in the order in which they act. A new one: one file, one line."""

from collections.abc import Iterable

from sim.effects import (
    actuator_wiring,
    advance_loss,
    antenna_offset,
    astern_stall,
    battery_sag,
    cg_offset,
    command_delay,
    compass_deviation,
    cross_damping,
    cubic_drag,
    drag_growth,
    heading_offset,
    hull_lift,
    inertial_force,
    payload_change,
    reverse_loss,
    steady_current,
    steady_wind,
    steering_lag,
    steering_offset,
    thrust_curve,
    thruster_deadband,
    thruster_fault,
    thruster_imbalance,
    thruster_lag,
    thruster_misalignment,
    towed_load,
    varying_current,
    velocity_latency,
    wave_motion,
    yaw_rate_bias,
)
from sim.effects.effect import Effect, Symptom

EFFECTS: tuple[Effect, ...] = (
    steady_current.EFFECT,
    varying_current.EFFECT,
    steady_wind.EFFECT,
    inertial_force.EFFECT,
    wave_motion.EFFECT,
    cross_damping.EFFECT,
    hull_lift.EFFECT,
    cg_offset.EFFECT,
    cubic_drag.EFFECT,
    drag_growth.EFFECT,
    payload_change.EFFECT,
    towed_load.EFFECT,
    actuator_wiring.EFFECT,
    thruster_deadband.EFFECT,
    thrust_curve.EFFECT,
    reverse_loss.EFFECT,
    thruster_imbalance.EFFECT,
    thruster_fault.EFFECT,
    battery_sag.EFFECT,
    advance_loss.EFFECT,
    astern_stall.EFFECT,
    thruster_lag.EFFECT,
    command_delay.EFFECT,
    thruster_misalignment.EFFECT,
    steering_offset.EFFECT,
    steering_lag.EFFECT,
    antenna_offset.EFFECT,
    velocity_latency.EFFECT,
    compass_deviation.EFFECT,
    heading_offset.EFFECT,
    yaw_rate_bias.EFFECT,
)


def named(name: str, more: Iterable[Effect] = ()) -> Effect:
    """The effect of that name, from the list or from `more`; KeyError names those there are."""
    known = {effect.name: effect for effect in (*EFFECTS, *more)}
    if name not in known:
        raise KeyError(f"no effect named {name!r}: there are {', '.join(sorted(known))}")
    return known[name]


def explaining(symptom: Symptom) -> str:
    """Names of the effects that a symptom of a base fit may come from, as a list in words."""
    return ", ".join(effect.name for effect in EFFECTS if symptom in effect.explains)
