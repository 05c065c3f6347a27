"""Wave motion: a train of long-crested waves that pushes the boat to and fro as it passes.

    F = force sin(omega t − k s + phase),   k = omega² / g

F, s and how a train is looked for: `sim.effects.wave_trains`. Valid for: one frequency, deep water,
waves longer than the boat. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021,
§10.2 (dispersion and frequency of encounter).
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
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Place, heading and time -> X, Y, N [N, N, N m]."""
    return train_force(flow, p)


EFFECT = Effect(
    name="wave_motion",
    scope=Scope.VOYAGE,
    force=force,
    parameters=TRAIN_PARAMETERS,
    looks_like="an oscillation of one frequency and zero mean that is faster against the waves "
    "than with them; like sensor noise, but in a narrow band",
    partial=True,
    evidence=PASSING,
    search=strongest_trains,
    in_words=words_of_train,
)
