"""Damping that is over before a row of the data can show it, or next to nothing beside the other.

    rate = (|D| + 2 |D₂| U) / m,     share = min(1, limit / rate)

D, D₂ linear and quadratic damping along one axis, m its inertia, U the speed of the data. From a
certain rate on a row says no more than "as fast as it can tell": a fit holds damping there, by its
share of what a hull without inertia would have.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim.state import Floats

# Chosen, not measured:
AXES = (("m11", "X_u", "X_uu"), ("m22", "Y_v", "Y_vv"), ("m33", "N_r", "N_rr"))
# Of the damping of an axis at the speeds that were sailed. Fits leave one of its numbers at zero
# where the data do not tell them apart: what is less than this counts as … Chosen.
NEGLIGIBLE_DAMPING = 0.01
SIZE_OF_DAMPING = 0.1  # … so much
STRONG = 0.1  # of an axis's damping: a number that makes up less of it is not what is held there
MAX_DAMPING_RATE = 10.0  # 1/s at the speeds of the data: over in half a row of 0.2 s


class Axis(NamedTuple):
    """Inertia and two numbers of damping: columns of z, values given; and the speed of the data."""

    columns: Sequence[int | None]
    given: Sequence[float]
    speed: float

    @property
    def damping(self) -> list[int]:
        return [i for i in self.columns[1:] if i is not None]

    def share(self, values: Floats) -> Floats:
        """Named values (..., n) -> share (...) of the damping that rows show, or that was given."""
        now = self._rate(*self._numbers(values))
        limit = np.maximum(MAX_DAMPING_RATE, self._rate(*self.given))
        return np.minimum(1.0, limit / np.maximum(now, 1e-9))

    def strong(self, values: Floats) -> list[int]:
        """Columns of damping that is not next to nothing beside the other, of values (n,)."""
        inertia, *numbers = self._numbers(values)
        parts = self._rate(inertia, numbers[0], 0.0), self._rate(inertia, 0.0, numbers[1])
        pairs = zip(self.columns[1:], parts, strict=True)
        return [i for i, part in pairs if i is not None and part >= STRONG * sum(parts)]

    def _numbers(self, values: Floats) -> list[Any]:
        """Inertia, linear and quadratic damping (...) of named values (..., n)."""
        pairs = zip(self.columns, self.given, strict=True)
        return [given if i is None else values[..., i] for i, given in pairs]

    def _rate(self, inertia: Any, linear: Any, square: Any) -> Any:
        return (np.abs(linear) + 2.0 * np.abs(square) * self.speed) / np.abs(inertia)


def sizes_of_small_damping(
    values: Mapping[str, float], fastest: tuple[float, float, float] | None
) -> dict[str, float]:
    """Damping that is next to nothing beside the other of its axis -> what a prior is a share of.

    A fit that finds all damping linear leaves the quadratic one near zero, or the other way round:
    a share of that would hold it there. `fastest`: see `IdentifySettings`.
    """
    sizes = {}
    for (_, linear, quadratic), speed in zip(AXES, fastest or (), strict=False):
        if speed <= 0.0:
            continue
        per_unit = {linear: 1.0, quadratic: speed}
        parts = {name: abs(values[name]) * per for name, per in per_unit.items()}
        whole = sum(parts.values())
        for name, part in parts.items():
            if part < NEGLIGIBLE_DAMPING * whole:
                sizes[name] = SIZE_OF_DAMPING * whole / per_unit[name]
    return sizes
