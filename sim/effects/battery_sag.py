"""Battery sag: shaft speed goes with the battery's voltage, so thrust goes with its square.

    F → F (V / nominal)²

V measured [V], nominal [V] where the vessel file's thrust holds. Where the voltage was not measured
there is no sag. Valid for: speed controllers that command a duty cycle, not a speed. `nominal` and
the scale of all thrusts are not separable where the voltage hardly changes: what the data tell is
the sag relative to the mean. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021,
ch. 9 (thrust ∝ n², n ∝ armature voltage).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Separation,
    Shown,
    Values,
)
from sim.effects.words import FittedValues

MOST_SHARE = 4.2  # of the thrust in the file, or its inverse: as on a battery of twice the voltage


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust and voltage (NaN: not measured) -> thrust [N]."""
    known = 1.0 * np.isfinite(flow.voltage)
    ratio = np.fmax(flow.voltage, 0.0) / p.nominal  # fmax: NaN becomes 0
    return F * (1.0 + known * (ratio * ratio - 1.0))


def disbelieved(values: Values, trials: Sequence[Any]) -> str:
    """That the motors would push so much harder or weaker throughout that it is no battery's."""
    voltage = np.concatenate([t.voltage[t.usable] for t in trials])
    known = voltage[np.isfinite(voltage)]
    if len(known) == 0:  # then there is no sag
        return ""
    share = float(np.median(known) / values["nominal"]) ** 2
    if 1.0 / MOST_SHARE < share < MOST_SHARE:
        return ""
    return f"the motors would give {100.0 * share:.0f} % of the thrust in the file throughout"


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"thrust falls with the battery: it is full at {p.size('nominal', 'V')}"


EFFECT = Effect(
    name="battery_sag",
    scope=Scope.BOAT,
    thrust=thrust,
    parameters=(Parameter("nominal", "V", lower=3.0, upper=100.0, start=14.8, scale=0.2),),
    looks_like="weaker as the voltage falls: slower for the same throttle late in the voyage, and "
    "whenever all motors pull",
    mistaken_for=("thrust_curve", "drag_growth", "thruster_fault"),
    shown_by=(Shown.VOLTAGE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "voltage"),
    separated={
        "drag_growth": Separation(
            "the same run at the beginning and at the end, with a coast to a stop in each; and "
            "once with a fresh battery at the end",
            "steps",
        ),
        "thrust_curve": Separation("one run with a full and one with a tired battery", "ramp"),
    },
    disbelieved=disbelieved,
    in_words=in_words,
)
