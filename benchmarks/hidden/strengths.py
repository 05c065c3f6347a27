"""How strong a cause is at full strength, on which boat: what its owner would clearly notice.

Every recipe takes a boat, dice, a share of the full strength and the length of the voyage [s], and
gives the cause's parameters. A share of 1 lies between the two numbers of each range; sides and
directions are thrown. Sizes follow the boat: forces its thrust, lengths its own length.
"""

import math
from collections.abc import Mapping

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import BOATS, FLEET, STEERED, Boat
from benchmarks.hidden.dice import Recipe, Values, bearing, of, side
from benchmarks.hidden.unasked import UNASKED
from benchmarks.hidden.unheard import UNHEARD
from benchmarks.hidden.unnamed import UNNAMED
from benchmarks.hidden.untold import UNTOLD


def _middle(dice: Dice, seconds: float) -> float:
    return seconds * of(dice, 0.35, 0.6)


def _steady_current(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": k * of(d, 0.2, 0.4), "direction": bearing(d)}


def _varying_current(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    period = seconds * of(d, 0.25, 0.7)
    return {"speed": k * of(d, 0.25, 0.4), "direction": bearing(d),
            "period": period, "phase": bearing(d)}  # fmt: skip


def _steady_wind(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": math.sqrt(k) * of(d, 8.0, 12.0), "direction": bearing(d)}


def _inertial_force(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.1, 0.2), "direction": bearing(d)}


def _wave_motion(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.35, 0.6), "omega": of(d, 1.2, 2.2),
            "direction": bearing(d), "phase": bearing(d)}  # fmt: skip


def _crossing_waves(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return _wave_motion(b, d, 0.7 * k, seconds) | {"omega": of(d, 2.4, 3.2)}


def _cubic_drag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"X_uuu": -k * of(d, 0.6, 1.0) * b.ahead / b.top_speed() ** 3}


def _drag_growth(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"rate": k * of(d, 0.8, 1.6) / seconds}


def _payload_change(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"factor": 1.0 + k * of(d, 0.4, 0.7), "time": _middle(d, seconds)}


def _cg_offset(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    most = 0.5 * math.sqrt(b.hull.m22 * b.hull.m33) / b.hull.mass  # the inertia stays positive
    return {"x_g": k * side(d) * min(of(d, 0.12, 0.2) * b.hull.length, most)}


def _cross_damping(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    size = k * math.sqrt(b.hull.Y_v * b.hull.N_r)
    return {"Y_r": size * side(d) * of(d, 0.3, 0.6), "N_v": size * side(d) * of(d, 0.3, 0.6)}


def _hull_lift(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    size = k * math.sqrt(b.hull.Y_v * b.hull.N_r)
    return {
        "Y_uv": k * b.hull.Y_v * of(d, 0.5, 1.0), "Y_ur": size * side(d) * of(d, 0.2, 0.4),
        "N_uv": size * side(d) * of(d, 0.2, 0.4), "N_ur": k * b.hull.N_r * of(d, 0.3, 0.6),
    }  # fmt: skip


def _towed_load(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    drag = k * of(d, 0.4, 0.8) * b.ahead / b.top_speed() ** 2
    return {"drag": drag, "x": -of(d, 0.5, 0.9) * b.hull.length}


def _thruster_lag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"tau": k * of(d, 0.4, 0.8)}


def _command_delay(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"delay": k * of(d, 0.3, 0.5)}


def _thruster_misalignment(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"angle": k * side(d) * of(d, 0.08, 0.16)}


def _thruster_deadband(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"width": k * of(d, 0.2, 0.35)}


def _thrust_curve(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"exponent": (1.0 + k * of(d, 0.4, 0.7)) ** side(d)}


def _actuator_wiring(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {}


def _thruster_imbalance(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"port_gain": 1.0 + k * side(d) * of(d, 0.12, 0.25)}


def _reverse_loss(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"factor": 1.0 - k * of(d, 0.35, 0.6)}


def _thruster_fault(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    channel = float(d.choice([m.channel for m in b.motors]))
    return {"channel": channel, "gain": 1.0 - k * of(d, 0.35, 0.6), "time": _middle(d, seconds)}


def _battery_sag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"nominal": of(d, 15.5, 16.5), "tired": 1.0 + k * of(d, 2.0, 3.5)}


def _advance_loss(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"per_mps": k * of(d, 0.25, 0.4)}


def _astern_stall(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"per_mps": k * of(d, 0.8, 1.5), "above": of(d, 0.0, 0.2)}


def _steering_lag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"tau": k * of(d, 0.5, 1.0)}


def _steering_offset(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"angle": k * side(d) * of(d, 0.06, 0.12)}


def _heading_offset(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"angle": k * side(d) * of(d, 0.08, 0.16)}


def _compass_deviation(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    size, at = k * of(d, 0.12, 0.2), bearing(d)
    return {"b": size * math.cos(at), "c": size * math.sin(at)}


def _antenna_offset(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    size, at = k * of(d, 0.3, 0.5) * b.hull.length, bearing(d)
    return {"x": size * math.cos(at), "y": 0.5 * size * math.sin(at)}


def _velocity_latency(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"delay": k * of(d, 0.3, 0.6)}


def _yaw_rate_bias(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"bias": k * side(d) * of(d, 0.03, 0.06)}


RECIPES: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _steady_current, _varying_current, _steady_wind, _inertial_force, _wave_motion,
        _cubic_drag, _drag_growth, _payload_change, _cg_offset, _cross_damping, _hull_lift,
        _towed_load, _thruster_lag, _command_delay, _thruster_misalignment, _thruster_deadband,
        _thrust_curve, _actuator_wiring, _thruster_imbalance, _reverse_loss, _thruster_fault,
        _battery_sag, _advance_loss, _astern_stall, _steering_lag, _steering_offset,
        _heading_offset, _compass_deviation, _antenna_offset, _velocity_latency, _yaw_rate_bias,
    )
}  # fmt: skip

TRAINS: Mapping[str, Recipe] = {"crossing_waves": _crossing_waves}  # never alone

# true of one day only: another voyage has its own
OF_A_VOYAGE = frozenset({
    "steady_current", "varying_current", "steady_wind", "inertial_force", "wave_motion",
    "crossing_waves", "drag_growth", "payload_change", "towed_load", "thruster_fault",
    "yaw_rate_bias",
    "current_change", "wind_change", "learned_drag", "learned_spot", "learned_profile",
    "learned_map", "learned_history", "learned_rhythm", "learned_anomaly",
})  # fmt: skip
WHOLE = frozenset({"actuator_wiring"})  # there, or not there: never weak

# too stiff a hull, or stops so quickly that it hardly runs ahead while its motors pull astern: at
# full strength who knows the effect gains less than a tenth there
UNSEEN = {"cg_offset": ("iacquabot",), "astern_stall": ("teal", "grebe", "heron", "dory")}
SKID_ONLY = frozenset({
    "actuator_wiring", "thruster_imbalance", "thruster_fault", "lever_arm", "wake_of_the_other",
    "power_budget",
})  # fmt: skip
STEERED_ONLY = frozenset({"steering_lag", "steering_offset", "steering_scale", "steering_play",
                          "steering_rate"})  # fmt: skip
GROUPS: Mapping[str, tuple[str, ...]] = {
    "water": ("steady_current", "varying_current", "steady_wind", "inertial_force", "wave_motion"),
    "hull": ("cubic_drag", "drag_growth", "payload_change", "cg_offset", "cross_damping",
             "hull_lift", "towed_load"),
    "motors": ("thruster_lag", "command_delay", "thruster_misalignment", "thruster_deadband",
               "thrust_curve", "actuator_wiring", "thruster_imbalance", "reverse_loss",
               "thruster_fault", "battery_sag", "advance_loss", "astern_stall", "steering_lag",
               "steering_offset"),
    "sensors": ("heading_offset", "compass_deviation", "antenna_offset", "velocity_latency",
                "yaw_rate_bias"),
}  # fmt: skip


def _current_change(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    """Off by 0.2 m/s and more, whatever the two are."""
    speed, direction = of(d, 0.0, 0.35), bearing(d)
    step, towards = k * of(d, 0.2, 0.4), bearing(d)
    north = speed * math.cos(direction) + step * math.cos(towards)
    east = speed * math.sin(direction) + step * math.sin(towards)
    return {"speed": speed, "direction": direction, "later_speed": math.hypot(north, east),
            "later_direction": math.atan2(east, north), "time": _moment(d, seconds)}  # fmt: skip


def _wind_change(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    """It rises, falls asleep, or turns by a quarter and more."""
    speed, direction = math.sqrt(k) * of(d, 8.0, 12.0), bearing(d)
    calm = of(d, 0.0, 3.0)
    turn = direction + side(d) * of(d, 0.5, 1.0) * math.pi
    first, then = [(calm, speed), (speed, calm), (speed, speed)][int(d.integers(3))]
    return {"speed": first, "direction": direction, "later_speed": then,
            "later_direction": turn, "time": _moment(d, seconds)}  # fmt: skip


def _moment(dice: Dice, seconds: float) -> float:
    return seconds * of(dice, 0.25, 0.75)


# days that change; the recipes above stay in the order that numbers their cases
CHANGES: Mapping[str, Recipe] = {
    "current_change": _current_change,
    "wind_change": _wind_change,
    "thruster_fault": _thruster_fault,
    "payload_change": _payload_change,
}
# what stands beside a change: of another kind than any of them
LASTING = ("heading_offset", "reverse_loss", "towed_load", "cubic_drag", "compass_deviation")


def _crossflow_drag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"drag": -k * b.hull.Y_vv * of(d, 0.8, 1.5)}


# effects that came to the catalogue later; the recipes above stay as they are
LATER: Mapping[str, Recipe] = {"crossflow_drag": _crossflow_drag}


def _thrust_scale(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": 1.0 - k * of(d, 0.35, 0.45)}


def _steering_scale(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": 1.0 + k * side(d) * of(d, 0.2, 0.35)}


def _lever_arm(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": (1.0 - k * of(d, 0.35, 0.5)) ** side(d)}


SCALES: Mapping[str, Recipe] = {  # came later still
    "thrust_scale": _thrust_scale,
    "steering_scale": _steering_scale,
}
ARMS: Mapping[str, Recipe] = {"lever_arm": _lever_arm}  # and later than these


def _steering_play(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"play": k * of(d, 0.04, 0.1)}


def _steering_rate(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"rate": of(d, 0.12, 0.25) / k}


PLAYS: Mapping[str, Recipe] = {  # the latest
    "steering_play": _steering_play,
    "steering_rate": _steering_rate,
}


def _sea(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    """Steep for its length, as wind seas on lakes are; lengths from the boat's to three of it."""
    period = math.sqrt(2.0 * math.pi * b.hull.length * of(d, 1.2, 3.0) / 9.81)
    height = k * of(d, 0.02, 0.04) * 9.81 * period**2 / (2.0 * math.pi)
    return {"height": height, "period": period, "direction": bearing(d),
            "spread": of(d, 0.2, 0.6), "seed": float(d.integers(1_000_000))}  # fmt: skip


SEAS: Mapping[str, Recipe] = {"sea": _sea}  # no effect of the catalogue: partly waves, else noise
IN_A_SEA = (
    "steady_current", "thruster_imbalance", "compass_deviation", "cubic_drag", "reverse_loss",
    "heading_offset", "towed_load", "steady_wind",
)  # fmt: skip


def boats_for(names: tuple[str, ...]) -> tuple[str, ...]:
    """The boats on which all of these act so that one can see it."""
    able = set(FLEET)
    for name in names:
        able -= set(UNSEEN.get(name, ()))
        if name in SKID_ONLY:
            able &= set(BOATS)
        if name in STEERED_ONLY:
            able &= set(STEERED)
    return tuple(boat for boat in FLEET if boat in able)


def _shoal(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    place = {"north": of(d, -12.0, 12.0), "east": of(d, -12.0, 12.0)}
    return {**place, "radius": of(d, 15.0, 25.0), "gain": k * of(d, 2.0, 3.5)}


def _tether(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"north": of(d, -4.0, 4.0), "east": of(d, -4.0, 4.0),
            "slack": of(d, 8.0, 15.0), "stiffness": k * b.ahead * of(d, 0.02, 0.05)}  # fmt: skip


def _shear_current(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gradient": k * side(d) * of(d, 0.012, 0.02), "north": of(d, -5.0, 5.0)}


def _propeller_walk(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * side(d) * of(d, 0.12, 0.2)}


def _stuttering_motor(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    channel = float(d.choice([m.channel for m in b.motors]))
    period = of(d, 6.0, 11.0)
    return {"channel": channel, "period": period, "hold": k * period * of(d, 0.2, 0.35)}


def _bent_skeg(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    size = k * of(d, 0.15, 0.3) * b.ahead / b.top_speed() ** 2
    return {"Y_uu": size * side(d), "x": -of(d, 0.35, 0.5) * b.hull.length}


def _resistance_hump(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    top = b.top_speed()
    return {"height": k * b.ahead * of(d, 0.2, 0.35), "speed": top * of(d, 0.45, 0.65),
            "width": top * of(d, 0.08, 0.15)}  # fmt: skip


STRANGE: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _shoal, _tether, _shear_current, _propeller_walk, _stuttering_motor, _bent_skeg,
        _resistance_hump,
    )
}  # fmt: skip


def _ventilation(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": b.top_speed() * of(d, 0.5, 0.7), "share": k * of(d, 0.35, 0.55)}


def _turning_loss(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.5, 0.7), "rate": of(d, 0.15, 0.3)}


def _wake_of_the_other(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.25, 0.4)}


def _river_mouth(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"north": of(d, -8.0, 8.0), "east": of(d, -8.0, 8.0), "towards": bearing(d),
            "width": of(d, 6.0, 12.0), "speed": k * of(d, 0.4, 0.7)}  # fmt: skip


def _wind_shadow(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.12, 0.22), "towards": bearing(d),
            "east": of(d, -8.0, 8.0), "width": 3.0}  # fmt: skip


def _planing(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": b.top_speed() * of(d, 0.45, 0.65), "share": k * of(d, 0.4, 0.6)}


def _lopsided_turning(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * of(d, 0.8, 1.5)}


def _stiff_turning(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"moment": -k * of(d, 0.06, 0.12) * b.hull.N_r}


def _weed(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    period = of(d, 30.0, 60.0)
    return {"gain": k * of(d, 1.5, 3.0), "period": period, "holds": period * of(d, 0.2, 0.35)}


def _compass_lag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"lag": k * of(d, 0.3, 0.6)}


UNLISTED: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _ventilation, _turning_loss, _wake_of_the_other, _river_mouth, _wind_shadow, _planing,
        _lopsided_turning, _stiff_turning, _weed, _compass_lag,
    )
}  # fmt: skip


def strong(name: str, boat: Boat, dice: Dice, share: float, seconds: float) -> Values:
    """Parameters of a cause at a share of its full strength."""
    known = {
        **RECIPES, **CHANGES, **LATER, **SCALES, **ARMS, **PLAYS, **SEAS, **TRAINS,
        **STRANGE, **UNLISTED, **UNHEARD, **UNNAMED, **UNTOLD, **UNASKED,
    }  # fmt: skip
    return known[name](boat, dice, 1.0 if name in WHOLE else share, seconds)
