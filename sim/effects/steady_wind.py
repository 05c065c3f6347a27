"""Steady wind: the air pushes the boat sideways and turns it on quartering headings.

    X = ½ ρ V² C_X A_F,   Y = ½ ρ V² C_Y A_L,   N = ½ ρ V² C_N A_L L
    C_X = −c_x cos γ,     C_Y = c_y sin γ,      C_N = c_n sin 2γ + centre C_Y
    γ = −atan2(v_rw, u_rw)

V, u_rw, v_rw [m/s] of the boat through the air; A_F, A_L [m²] frontal and lateral area, L [m]
length of the hull; ρ = 1.225 kg/m³; c_x = 0.7, c_y = 0.825, c_n = 0.125, the middle of the
published ranges, where nothing else is given; the centre of the lateral area lies midships then.
c_x, c_n and centre [lengths ahead] are found along with the wind, near those values: the moment of
a hull is known no better, and what it lacks would be taken for lift or damping of the hull. c_y
stays: a force abeam tells ½ ρ V² c_y A_L and no more. The wind blows at speed [m/s] from direction
[rad from north]; where the boat measured the wind, that wind acts and the two parameters do not
count. Gusts are not modelled: what they leave is no sign of anything else (`unsteady`). Valid for:
hulls symmetric to the sides. Areas that nobody measured are assumed from length and beam
(`sim.wind`): the motion then tells a force and a direction, and the speed as a range. Where the
wind was measured, the areas are what is fitted. Source: Fossen, Handbook of Marine Craft
Hydrodynamics, 2nd ed. 2021, §10.1 (wind coefficients of symmetrical craft; the lever of the lateral
area is s_L of Blendermann, J. Wind Eng. Ind. Aerodyn. 51, 1994).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    QUARTERS,
    Assumption,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Intervals,
    Measured,
    Need,
    Parameter,
    Scope,
    Separation,
    Shown,
    Values,
    circular_parameter,
)
from sim.effects.words import FittedValues
from sim.state import Wrench
from sim.wind import (
    AIR_DENSITY,
    AREA_FACTOR,
    C_N,
    C_X,
    C_Y,
    COEFFICIENT_FACTOR,
    areas_text,
    wind_load,
)

SPEED_FACTOR = float(np.sqrt(AREA_FACTOR * COEFFICIENT_FACTOR))  # of a speed told from a force

LIGHT, STRONG = 1.0, 10.0  # m/s, of further starts
UNSTEADY = 0.16  # (2 I)² of gusts with an intensity I of 20 %: the force goes with V²


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity over ground and of the air -> X, Y, N [N, N, N m]."""
    assumed = (flow.wind_known - 1.0) * p.speed  # it blows from there: hence the sign
    north = flow.wind_known * flow.wind_north + assumed * np.cos(p.direction)
    east = flow.wind_known * flow.wind_east + assumed * np.sin(p.direction)
    return wind_load(flow, north, east, p.c_x, p.c_n, p.centre)


def more_starts(length: float) -> Sequence[Values]:
    """A light and a strong wind from each quarter."""
    return [{"speed": speed, "direction": d} for speed in (LIGHT, STRONG) for d in QUARTERS]


def assumption(vessel: Any, values: Values, ci95: Intervals) -> Assumption | None:
    """What a wind is worth of which only the force is known: [N] on the boat at rest, and the
    speeds [m/s] that it may be: areas and coefficients may be off by their factors.
    """
    if vessel.hull.has_wind_area:
        return None
    front, side = vessel.hull.areas
    low, high = ci95.get("speed", (values["speed"], values["speed"]))
    low, high = max(low, 0.0) / SPEED_FACTOR, high * SPEED_FACTOR
    pressure = 0.5 * AIR_DENSITY * values["speed"] ** 2
    ahead, abeam = pressure * values["c_x"] * front, pressure * C_Y * side
    come_from = np.degrees(values["direction"]) % 360.0
    return Assumption(
        f"from {come_from:.0f}° with about {_newtons(abeam)} abeam and {_newtons(ahead)} from "
        f"ahead on the boat at rest, a wind of {low:.1f} … {high:.1f} m/s: "
        f"{areas_text(front, side)}; half to twice that is allowed for",
        {"speed": (low, high)},
        {
            "area_front_m2": front, "area_side_m2": side, "force_abeam_N": float(abeam),
            "force_ahead_N": float(ahead), "from_deg": float(come_from), "speed_low_mps": low,
            "speed_high_mps": high,
        },
    )  # fmt: skip


def _newtons(force: float) -> str:
    """A force in words, no finer than it is known."""
    return f"{force:.0f} N" if force >= 10.0 else f"{force:.1f} N"


# The published range of C_N is two standard deviations, that of C_X one: the ratio of the areas
# counts with it, and is off too. A mast or a cabin lies by a few tenths of the length off midships.
COEFFICIENTS = (
    Parameter(
        "c_x", "1", lower=0.1, upper=1.5, start=C_X, scale=0.1, default=C_X,
        prior=0.2, description="coefficient ahead",
    ),
    Parameter(
        "c_n", "1", lower=-0.1, upper=0.4, start=C_N, scale=0.02, default=C_N,
        prior=0.04, description="coefficient of the moment",
    ),
    Parameter(
        "centre", "1", lower=-0.4, upper=0.4, start=0.0, scale=0.02, default=0.0,
        prior=0.08, description="of the lateral area, lengths ahead of midships",
    ),
)  # fmt: skip
CIRCLES = Separation(
    "full circles: wind changes its side, a motor does not; then motors off", "circles"
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"a wind of {p.size('speed', 'm/s')} blows from {p.towards('direction')}"


EFFECT = Effect(
    name="steady_wind",
    scope=Scope.VOYAGE,
    force=force,
    needs=(Need.WIND_AREA,),
    parameters=(
        Parameter(
            "speed", "m/s", lower=0.0, upper=40.0, start=5.0, scale=0.5, direction="direction"
        ),
        circular_parameter("direction", "from, clockwise from north", starts=QUARTERS, sided=True),
        *COEFFICIENTS,
    ),
    looks_like="pushed away from one side of the world, most when lying across it, and turned on "
    "quartering headings; a boat with stopped motors drifts that way",
    mistaken_for=(
        "steady_current",
        "wind_change",
        "inertial_force",
        "compass_deviation",
        "thruster_imbalance",
        "thruster_misalignment",
    ),
    shown_by=(Shown.OPPOSITE,),
    unsteady=UNSTEADY,
    evidence=EvidenceAxis(ForceAxis.SURGE, "heading"),
    separated={
        "inertial_force": Separation(
            "full circles at two speeds: the apparent wind grows with the boat's own speed",
            "circles",
        ),
        "compass_deviation": Separation(
            "full circles, ahead and astern, and a drift with the motors off", "circles"
        ),
        "thruster_imbalance": CIRCLES,
        "thruster_misalignment": CIRCLES,
    },
    more_starts=more_starts,
    in_words=in_words,
    measured=Measured(
        "wind", ("area_front", "area_side", "c_n", "centre"), {"speed": 0.0, "direction": 0.0}
    ),
    assumption=assumption,
    pattern_for=("heading",),
)
