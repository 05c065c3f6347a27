"""Rows of made-up rankings: what an effect is worth, and no fit behind it."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from sim.diagnosis.heldout import Gain, RankedEffect
from sim.effects.catalogue import named
from tests.sim.voyages import WAM_V

FIRST: Any = SimpleNamespace(names=(), added=(), nrmse=0.5)
BLOCK = np.repeat(np.arange(8), 10)


def row(name: str, gain: Gain, left: float = 1.0, nrmse: float = 0.495) -> RankedEffect:
    """One of a ranking; `left` of the residual on unseen time, with that error there."""
    residual = np.full(len(BLOCK), left)
    problem = SimpleNamespace(block=BLOCK, vessel=WAM_V)
    fit: Any = SimpleNamespace(
        name=name, problem=problem, heldout_residual=residual, nrmse=nrmse, values=starts
    )
    return RankedEffect(named(name), fit, gain, 0.5)


def starts(effect: str) -> dict[str, float]:
    """The numbers of an effect a little from where it does nothing."""
    return {p.name: min(p.start + 3.0 * p.scale, p.upper) for p in named(effect).parameters}


SOME = row("heading_offset", Gain(1.1, 0.075, 4.1, 104.0, 0.06))
