"""Everything that can be hidden: name -> a function of its parameters that gives the cause.

The names are those of the catalogue where it holds the cause, so that an answer can be scored.
`UNKNOWN` and `UNLISTED` are those that no catalogue holds; of `SEAS` it holds a part.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from benchmarks.hidden.causes import (
    hull,
    motors,
    sensors,
    unasked,
    unheard,
    unknown,
    unlisted,
    unnamed,
    untold,
    water,
)
from benchmarks.hidden.nature import Cause

KNOWN: Mapping[str, Callable[..., Cause]] = {
    **water.CAUSES, **hull.CAUSES, **motors.CAUSES, **sensors.CAUSES,
}  # fmt: skip
UNKNOWN: Mapping[str, Callable[..., Cause]] = unknown.CAUSES
UNLISTED: Mapping[str, Callable[..., Cause]] = {
    **unlisted.CAUSES, **unheard.CAUSES, **unnamed.CAUSES, **untold.CAUSES,
    **unasked.CAUSES,
}  # fmt: skip
SEAS: Mapping[str, Callable[..., Cause]] = water.SEAS


class Hidden(NamedTuple):
    """A cause by name with its parameters."""

    name: str
    values: Mapping[str, float]


def is_strange(hidden: Iterable[Hidden]) -> bool:
    """Whether something is hidden that no catalogue holds, not even a part of it."""
    return any(h.name in UNKNOWN or h.name in UNLISTED for h in hidden)


def causes_of(hidden: Iterable[Hidden]) -> list[Cause]:
    """Names and parameters -> causes; ValueError where a name or parameter does not exist."""
    known = {**KNOWN, **UNKNOWN, **UNLISTED, **SEAS}
    for item in hidden:
        if item.name not in known:
            raise ValueError(f"nothing named {item.name!r} can be hidden: {', '.join(known)}")
    try:
        return [known[item.name](**item.values) for item in hidden]
    except TypeError as error:
        raise ValueError(str(error)) from None
