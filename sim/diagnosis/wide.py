"""One vessel that holds every effect at once, each switched off until a hypothesis asks for it.

Compiled once, this wide model tries any effect beside any other without a new kernel: three
seconds on a new machine, then from the cache. An effect that cannot be switched off by its numbers
(a lag, a sagging battery), or that needs memory, comes beside all of these in a second one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.effect import Effect
from sim.model import Model
from sim.vessel import AddedEffect, Vessel


@dataclass(frozen=True)
class Wide:
    """A vessel, and the model that holds all `within` switched off beside it."""

    vessel: Vessel
    model: Model
    within: tuple[Effect, ...]

    @classmethod
    def of(cls, vessel: Vessel, effects: Iterable[Effect]) -> "Wide":
        """The vessel with every effect that can be switched off."""
        there = {added.effect.name for added in vessel.effects}
        within = tuple(
            e for e in effects
            if e.name not in there and neutral(e) is not None and not vessel.lacks(e)
        )  # fmt: skip
        added = [AddedEffect(e, neutral(e) or {}) for e in within]
        return cls(vessel, Model.of(vessel.with_effects(*added)), within)

    def with_added(self, added: Sequence[AddedEffect]) -> Model:
        """A model of the vessel with these effects, the others switched off."""
        names = {e.name for e in self.within}
        own = [a for a in added if a.effect.name not in names]
        model = Model.of(self.model.vessel.with_effects(*own)) if own else self.model
        values = {f"{a.effect.name}.{key}": v for a in added for key, v in a.values.items()}
        return replace(model, theta=_set(model, values))


def neutral(effect: Effect) -> Mapping[str, float] | None:
    """Parameters with which the effect does nothing; None where its numbers cannot say so.

    Still air resists a boat that moves, so wind cannot be switched off. Mixed-up plugs are few
    enough for a kernel of their own, and would slow all others down.
    """
    states = effect.thrust_rate or effect.angle_rate or effect.rate
    if states or effect.wiring or all(p.neutral is None for p in effect.parameters):
        return None
    return {p.name: p.start if p.neutral is None else p.neutral for p in effect.parameters}


def _set(model: Model, values: Mapping[str, float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    theta = model.theta.copy()
    for name, value in values.items():
        theta[model.names.index(name)] = value
    return theta
