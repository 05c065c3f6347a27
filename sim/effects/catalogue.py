"""The one list of all effects, in the order in which they act. A new one: one file, one word."""

from collections.abc import Iterable
from importlib import import_module

from sim.effects.effect import Effect, Symptom
from sim.near_names import did_you_mean

NAMES = """
    steady_current varying_current current_change steady_wind wind_change
    inertial_force wave_motion crossing_waves
    cross_damping crossflow_drag hull_lift cg_offset
    cubic_drag drag_growth payload_change towed_load
    actuator_wiring thruster_deadband thrust_curve reverse_loss thruster_imbalance thruster_fault
    thrust_scale lever_arm battery_sag advance_loss astern_stall
    thruster_lag command_delay thruster_misalignment
    steering_scale steering_offset steering_lag steering_play steering_rate
    antenna_offset velocity_latency compass_deviation heading_offset yaw_rate_bias
    learned learned_drag learned_spot learned_profile learned_map learned_history
    learned_rhythm learned_pair learned_reading learned_anomaly
"""

EFFECTS: tuple[Effect, ...] = tuple(
    import_module(f"sim.effects.{name}").EFFECT for name in NAMES.split()
)


def named(name: str, more: Iterable[Effect] = ()) -> Effect:
    """The effect of that name, from the list or from `more`; KeyError names those there are."""
    known = {effect.name: effect for effect in (*EFFECTS, *more)}
    if name not in known:
        there = f"{did_you_mean(name, known)}there are {', '.join(sorted(known))}"
        raise KeyError(f"no effect named {name!r}: {there}")
    return known[name]


def mistaken_for(effect: Effect, among: Iterable[Effect] = EFFECTS) -> tuple[str, ...]:
    """Names of the effects that look like this one: those it names, then those that name it."""
    naming = (one.name for one in among if effect.name in one.mistaken_for)
    return tuple(dict.fromkeys((*effect.mistaken_for, *naming)))


def explaining(symptom: Symptom) -> str:
    """Names of the effects that a symptom of a base fit may come from, as a list in words."""
    return ", ".join(effect.name for effect in EFFECTS if symptom in effect.explains)
