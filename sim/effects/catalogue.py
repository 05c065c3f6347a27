"""The one list of all effects. A new effect is one new file and one line here."""

from collections.abc import Iterable

from sim.effects import cubic_drag, heading_offset, steady_current, thruster_lag
from sim.effects.effect import Effect

EFFECTS: tuple[Effect, ...] = (
    steady_current.EFFECT,
    cubic_drag.EFFECT,
    thruster_lag.EFFECT,
    heading_offset.EFFECT,
)


def named(name: str, more: Iterable[Effect] = ()) -> Effect:
    """The effect of that name, from the list or from `more`; KeyError names those there are."""
    known = {effect.name: effect for effect in (*EFFECTS, *more)}
    if name not in known:
        raise KeyError(f"no effect named {name!r}: there are {', '.join(sorted(known))}")
    return known[name]
