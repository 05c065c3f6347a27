"""Crossing waves: a second train, with a period and a direction of its own, beside the first.

    F = force sin(omega t − k s + phase),   k = omega² / g

F, s and how a train is looked for: `sim.effects.wave_trains`. A sea is often a swell and a wind
sea, or two swells that cross: what one train leaves is looked through for another. Valid for: one
frequency, deep water, waves longer than the boat. Source: Fossen, Handbook of Marine Craft
Hydrodynamics, 2nd ed. 2021, §10.2 (swell and wind sea).
"""

from typing import Any

from sim.body import Flow
from sim.effects.effect import Effect, Scope
from sim.effects.wave_trains import (
    PASSING,
    TRAIN_PARAMETERS,
    strongest_trains,
    train_force,
    words_of_train,
)
from sim.effects.words import FittedValues
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Place, heading and time -> X, Y, N [N, N, N m]."""
    return train_force(flow, p)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"besides, {words_of_train(p)}"


EFFECT = Effect(
    name="crossing_waves",
    scope=Scope.VOYAGE,
    force=force,
    parameters=TRAIN_PARAMETERS,
    looks_like="beside one train of waves, a second oscillation of another frequency or from "
    "another direction",
    beside="wave_motion",
    partial=True,
    evidence=PASSING,
    search=strongest_trains,
    in_words=in_words,
)
