"""Vessels for the tests: one of every shape, and the two of the paper (FLU turned into FRD)."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect
from sim.vessel import AddedEffect, Dynamics, Hull, Rudder, Sensors, Servo, Thruster, Vessel

IACQUABOT = Vessel(
    name="IAcquaBot",
    hull=Hull(1.5, 0.67, 21.0, wind_area=(0.1, 0.3)),
    dynamics=Dynamics(
        124.5923, 120.0275, 141.5164,
        -25.9335, -35.9833, -37.0247, -25.7968, -200.2944, -18.5319,
    ),
    thrusters=tuple(
        Thruster(name, Servo(i + 1), (x, y), (-28.4, 36.4))
        for i, (name, x, y) in enumerate(
            [
                ("front_left", 0.5, -0.335),
                ("front_right", 0.5, 0.335),
                ("rear_left", -0.5, -0.335),
                ("rear_right", -0.5, 0.335),
            ]
        )
    ),
)  # fmt: skip
WAMV = Vessel(
    name="WAM-V",
    hull=Hull(4.9, 2.3, 180.0, wind_area=(0.8, 1.6)),
    dynamics=Dynamics(
        125.9712, 121.4476, 70.5019,
        -26.5692, -35.8778, -36.4337, -27.4138, -99.1686, -10.6007,
    ),
    thrusters=(
        Thruster("left", Servo(1), (-0.7, -0.7), (-85.0, 90.0)),
        Thruster("right", Servo(2), (-0.7, 0.7), (-85.0, 90.0)),
    ),
)  # fmt: skip
SLENDER = Dynamics(60.0, 95.0, 30.0, -12.0, -9.0, -40.0, -60.0, -25.0, -15.0)
CENTRE = Thruster("screw", Servo(1), (-1.0, 0.0), (-60.0, 120.0), curve="quadratic")
RUDDER_BOAT = Vessel(
    name="rudder boat",
    hull=Hull(2.4, 0.8, 45.0, wind_area=(0.2, 0.6)),
    dynamics=SLENDER,
    thrusters=(CENTRE,),
    rudders=(
        Rudder("rudder", Servo(3), (-1.2, 0.0), (-0.6, 0.6), area=0.02, wash="screw"),
    ),
)  # fmt: skip
STEERED_BOAT = Vessel(
    name="outboard boat",
    hull=Hull(2.4, 0.8, 45.0, wind_area=(0.2, 0.6)),
    dynamics=SLENDER,
    thrusters=(CENTRE,),
    rudders=(Rudder("steering", Servo(3), (-1.0, 0.0), (-0.6, 0.6), motor="screw"),),
)
# thrusters on both sides and a rudder: every effect of the catalogue can act on it at once
TWIN_WITH_RUDDER = replace(
    WAMV,
    name="twin with a rudder",
    rudders=(Rudder("rudder", Servo(3), (-1.2, 0.0), (-0.6, 0.6), area=0.02, wash="left"),),
)
ANTENNA = Sensors(antenna=(0.6, -0.3))
SHAPES = (WAMV, IACQUABOT, RUDDER_BOAT, STEERED_BOAT)
VALUES = {  # off the neutral value, where `start` is neutral or weak; within a short voyage
    "actuator_wiring": {"order": 21.0, "reversed": 2.0},
    "antenna_offset": {"x": 0.4, "y": -0.3},
    "astern_stall": {"per_mps": 0.6, "above": 0.1},
    "battery_sag": {"nominal": 16.0},
    "cg_offset": {"x_g": -0.15},
    "compass_deviation": {"b": 0.12, "c": -0.08},
    "current_change": {
        "speed": 0.3,
        "direction": 1.2,
        "later_speed": 0.5,
        "later_direction": 4.0,
        "time": 4.01,
    },
    "cross_damping": {"Y_r": -14.0, "N_v": 11.0},
    "crossflow_drag": {"drag": 40.0},
    "cubic_drag": {"X_uuu": -8.0},
    "drag_growth": {"rate": 0.02},
    "heading_offset": {"angle": 0.15},
    "hull_lift": {"Y_uv": -30.0, "Y_ur": 12.0, "N_uv": 15.0, "N_ur": -20.0},
    "inertial_force": {"force": 8.0, "direction": 2.0},
    "learned": {
        "by": 1.0,
        "acts": 1.0,
        "low": 0.0,
        "high": 2.0,
        "full": 100.0,
        "x": 0.0,
        **{f"f{k}": -0.1 * k for k in range(9)},
    },
    "learned_drag": {"north": 1.0, "east": -0.5, "radius": 3.0, "edge": 2.0, "more": 1.2},
    "learned_history": {
        "acts": 1.0,
        "until": 12.0,
        "full": 100.0,
        "x": 0.0,
        **{f"{c}{k}": 0.05 * k - 0.2 * (c == "g") for c in "fg" for k in range(9)},
    },
    "learned_map": {
        "acts": 1.0,
        "south": -3.0,
        "north": 6.0,
        "west": -5.0,
        "east": 4.0,
        "full": 100.0,
        "x": 0.0,
        **{
            f"{c}{i}{j}": 0.1 * i - 0.15 * j * (c == "e")
            for c in "ne"
            for i in range(4)
            for j in range(4)
        },
    },
    "learned_pair": {
        "by": 1.0,
        "acts": 4.0,
        "a_low": 0.0,
        "a_high": 2.0,
        "b_low": -1.0,
        "b_high": 1.0,
        "full": 100.0,
        "x": 0.0,
        **{f"h{i}{j}": -0.1 - 0.08 * i + 0.05 * j for i in range(4) for j in range(4)},
    },
    "learned_profile": {
        "acts": 1.0,
        "direction": 0.5 * math.pi,
        "low": -5.0,
        "high": 4.0,
        "full": 100.0,
        "x": 0.0,
        **{f"{c}{k}": 0.05 * k - 0.2 * (c == "e") for c in "ne" for k in range(9)},
    },
    "learned_anomaly": {
        "north": 2.0,
        "east": -1.0,
        "reach": 60.0,
        **{f"f{k}": 0.2 - 0.03 * k for k in range(9)},
    },
    "learned_reading": {
        "by": 2.0,
        "acts": 1.0,
        "low": -0.6,
        "high": 0.6,
        **{f"f{k}": 0.02 * k - 0.07 for k in range(9)},
    },
    "learned_rhythm": {
        "acts": 1.0,
        "thruster": 1.0,
        "since": 1.3,
        "until": 16.3,
        "times": 3.0,
        "lasts": 2.1,
        "width": 0.3,
        "size": 0.3,
        "direction": 1.1,
        "full": 100.0,
    },
    "learned_spot": {
        "acts": 1.0,
        "north": 2.0,
        "east": -1.0,
        "reach": 6.0,
        "direction": 1.1,
        "full": 100.0,
        "x": 0.0,
        **{f"f{k}": 0.4 - 0.05 * k for k in range(9)},
    },
    "lever_arm": {"gain": 0.6, "which": 0.0},
    "crossing_waves": {"force": 9.0, "omega": 1.5, "direction": 2.4, "phase": 1.0},
    "payload_change": {"factor": 1.4, "time": 4.01},
    "steady_current": {"speed": 0.3, "direction": 1.2},
    "steering_offset": {"angle": 0.1},
    "steering_scale": {"gain": 0.75},
    "thrust_curve": {"exponent": 1.5},
    "thruster_fault": {"thruster": 1.0, "gain": 0.3, "time": 4.01},
    "thrust_scale": {"gain": 0.7},
    "thruster_imbalance": {"port_gain": 0.8, "starboard": 0.0},
    "thruster_misalignment": {"angle": 0.12},
    "towed_load": {"drag": 9.0, "x": -1.5},
    "varying_current": {"speed": 0.3, "direction": 0.7, "period": 25.0, "phase": 0.4},
    "wave_motion": {"force": 12.0, "omega": 2.2, "direction": 0.6, "phase": 0.3},
    "wind_change": {
        "speed": 6.0,
        "direction": 2.2,
        "later_speed": 9.0,
        "later_direction": 4.0,
        "time": 4.01,
    },
    "yaw_rate_bias": {"bias": 0.03},
}


def each_effect(effects: Sequence[Effect] = EFFECTS) -> pytest.MarkDecorator:
    """A test for each effect: fast for the first with a law of its kind, slow for all others."""
    seen: set[str] = set()
    params = []
    for effect in effects:
        first = not effect.laws.keys() <= seen
        seen |= effect.laws.keys()
        params.append(pytest.param(effect, marks=() if first else pytest.mark.slow))
    return pytest.mark.parametrize("effect", params, ids=[effect.name for effect in effects])


def added(effect: Effect) -> AddedEffect:
    """An effect with values that make a difference: its start, moved by one scale."""
    values = {
        p.name: p.start + p.scale if p.start + p.scale <= p.upper else p.start - p.scale
        for p in effect.parameters
    }
    return AddedEffect(effect, VALUES.get(effect.name, values))


def every_effect(vessel: Vessel) -> tuple[AddedEffect, ...]:
    """All of the catalogue that can act on the vessel, with values that make a difference."""
    every = (added(effect) for effect in EFFECTS if not vessel.unmet_needs(effect))
    return tuple(wired_in(vessel, a) if a.effect.name == "actuator_wiring" else a for a in every)


def wired_in(vessel: Vessel, wiring: AddedEffect) -> AddedEffect:
    """The plugs in the sockets of that vessel, the other way round."""
    digits = (str(i) for i in range(len(vessel.actuators), 0, -1))
    return replace(wiring, values={**wiring.values, "order": float("".join(digits))})


def with_every_effect(vessel: Vessel) -> Vessel:
    """The vessel with all of these, its antenna off the middle."""
    return replace(vessel, sensors=ANTENNA).with_effects(*every_effect(vessel))


def excitation(vessel: Vessel, seconds: float, dt: float, seed: int = 7) -> np.ndarray:
    """Commands (T, na) in steps of 2 s, ahead more than astern."""
    rng = np.random.default_rng(seed)
    count, hold = round(seconds / dt), round(2.0 / dt)
    levels = rng.uniform(-0.4, 0.9, (count // hold + 1, max(len(vessel.actuators), 1)))
    return np.repeat(levels, hold, axis=0)[:count]
