"""What would tell two effects apart that explain the same recording: in words, and as a manoeuvre.

One row per pair, from DESIGN §13 and from the laws: where the two differ at all, and what makes the
boat go there. A pair that is in no row has no such place that is known.
"""

from itertools import combinations
from typing import NamedTuple


class Separation(NamedTuple):
    """What to do, and the excitation of `shadow plan` that comes nearest to it."""

    says: str
    excitation: str


ROUND = "full circles at two speeds: one turns with the boat, the other stays with the compass rose"
DRIFT = "drift with the motors off, then run one course at two speeds"
EITHER = "spin on the spot to the left and to the right, and go astern"
SPOT = "turn on the spot, then the same turns at speed"
EDGES = "steps and quick swings: a lag rounds them, a delay only moves them"
LONG = "the same run at the beginning and at the end, with a coast to a stop in each"
COAST = "accelerate to full speed, then coast to a stop: without thrust only drag is left"
RAMP = "a slow ramp of the throttle through neutral and up to full"

PAIRS: dict[tuple[str, str], Separation] = {
    ("steady_current", "varying_current"): Separation(
        "stay out longer than one period: the same circles again and again", "circles"
    ),
    ("steady_current", "steady_wind"): Separation(DRIFT, "still"),
    ("steady_current", "inertial_force"): Separation(DRIFT, "still"),
    ("steady_current", "heading_offset"): Separation(ROUND, "circles"),
    ("steady_current", "compass_deviation"): Separation(
        "full circles, ahead and astern: a deviation keeps its sign astern", "circles"
    ),
    ("steady_wind", "inertial_force"): Separation(
        "full circles at two speeds: the apparent wind grows with the boat's own speed", "circles"
    ),
    ("steady_wind", "compass_deviation"): Separation(
        "full circles, ahead and astern, and a drift with the motors off", "circles"
    ),
    ("steady_wind", "thruster_imbalance"): Separation(
        "full circles: wind changes its side, a motor does not; then motors off", "circles"
    ),
    ("steady_wind", "thruster_misalignment"): Separation(
        "full circles: wind changes its side, a motor does not; then motors off", "circles"
    ),
    ("cross_damping", "cg_offset"): Separation(SPOT, "spin"),
    ("cross_damping", "antenna_offset"): Separation(
        "spin on the spot: an antenna moves although no force acts on the boat", "spin"
    ),
    ("cross_damping", "hull_lift"): Separation(SPOT, "spin"),
    ("cg_offset", "antenna_offset"): Separation(SPOT, "spin"),
    ("cg_offset", "heading_offset"): Separation(
        "long straight runs, ahead and astern: an offset of the heading shows there", "steps"
    ),
    ("cg_offset", "thruster_imbalance"): Separation(EITHER, "spin"),
    ("cg_offset", "thruster_misalignment"): Separation(EITHER, "spin"),
    ("cubic_drag", "thrust_curve"): Separation(COAST, "steps"),
    ("cubic_drag", "advance_loss"): Separation(COAST, "steps"),
    ("towed_load", "advance_loss"): Separation(COAST, "steps"),
    ("drag_growth", "payload_change"): Separation(LONG, "steps"),
    ("drag_growth", "battery_sag"): Separation(
        LONG + "; and once with a fresh battery at the end", "steps"
    ),
    ("drag_growth", "thruster_fault"): Separation(
        LONG + "; a motor that fails also turns the boat", "steps"
    ),
    ("payload_change", "thruster_fault"): Separation(
        LONG + "; a motor that fails also turns the boat", "steps"
    ),
    ("battery_sag", "thruster_fault"): Separation(
        "one run with a full and one with a tired battery", "steps"
    ),
    ("battery_sag", "thrust_curve"): Separation(
        "one run with a full and one with a tired battery", "ramp"
    ),
    ("thruster_deadband", "thrust_curve"): Separation(RAMP, "ramp"),
    ("reverse_loss", "astern_stall"): Separation(
        "astern from rest, and astern while still running ahead", "reversals"
    ),
    ("thruster_imbalance", "thruster_misalignment"): Separation(EITHER, "reversals"),
    ("thruster_imbalance", "steering_offset"): Separation(
        "straight runs at two throttles, then coast with the helm amidships", "steps"
    ),
    ("thruster_misalignment", "steering_offset"): Separation(
        "straight runs at two throttles, then coast with the helm amidships", "steps"
    ),
    ("thruster_lag", "command_delay"): Separation(EDGES, "chirp"),
    ("thruster_lag", "velocity_latency"): Separation(
        "quick turns with a gyro in the log: a gyro is not late, a receiver's velocity is", "zigzag"
    ),
    ("command_delay", "velocity_latency"): Separation(
        "quick turns with a gyro in the log: a gyro is not late, a receiver's velocity is", "zigzag"
    ),
    ("thruster_lag", "steering_lag"): Separation(
        "steps of the throttle with the helm still, then of the helm at one throttle", "steps"
    ),
    ("command_delay", "steering_lag"): Separation(
        "steps of the throttle with the helm still, then of the helm at one throttle", "steps"
    ),
    ("compass_deviation", "heading_offset"): Separation(
        "full circles: a deviation changes with the heading, an offset does not", "circles"
    ),
}


def separation(one: str, other: str) -> Separation | None:
    """Of two effects, in any order."""
    return PAIRS.get((one, other)) or PAIRS.get((other, one))


def separations(names: list[str]) -> dict[tuple[str, str], Separation]:
    """Every pair among the names that a manoeuvre is known for."""
    pairs = [(a, b, separation(a, b)) for a, b in combinations(names, 2)]
    return {(a, b): found for a, b, found in pairs if found is not None}
