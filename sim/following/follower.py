"""The follower: makes a plant move as the reference does, by the law in `sim.following.law`.

`VesselFollower` drives a vessel in one compiled loop; `sim.following.stepwise` drives any plant.
Both are pure: a state goes in, a new state comes out, and how rows are cut into chunks makes no
difference, not in the last bit.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.following.limits import Limits
from sim.following.options import Following
from sim.model import Model
from sim.rows import air, flags, floats, frozen
from sim.state import Floats

__all__ = ["Followed", "Follower", "FollowerState", "Following", "VesselFollower"]


@dataclass(frozen=True)
class FollowerState:
    """What is carried from row to row (read-only), and the state of a plant of another kind."""

    carry: Floats
    plant: Any = None


class Followed(NamedTuple):
    """What came of some rows: the next state, the shadow, the force on it, whether limits bound.

    shadows (K, 9) pose, velocity, acceleration; forces (K, 3) τ_c [N, N, N m]; bound (K,).
    """

    state: FollowerState
    shadows: Floats
    forces: Floats
    bound: NDArray[np.bool_]


class Follower(Protocol):
    """Makes a plant follow references."""

    def start(self) -> FollowerState:
        """The state before the first reference."""
        ...

    def prepare(self) -> None:
        """Do now what would hold up the first row."""
        ...

    def advance(
        self,
        state: FollowerState,
        times: Floats,
        references: Floats,
        jumps: NDArray[np.bool_] | None = None,
        voltage: Floats | None = None,
        wind: Floats | None = None,
    ) -> Followed:
        """References (K, 9) at times (K,) [s] -> the shadow there.

        The plant starts at the first reference. `jumps` (K,) marks references that did not come
        about by motion (an origin shift): there the plant is set anew.
        """
        ...


@dataclass(frozen=True)
class VesselFollower:
    """Follows with a vessel as the plant, compiled."""

    model: Model
    options: Following
    limits: Limits

    @classmethod
    def of(cls, model: Model, options: Following | None = None) -> "VesselFollower":
        """Follow with that vessel; ValueError where its thrusters cannot, and limits are asked."""
        chosen = options or Following()
        return cls(model, chosen, Limits.of(model.vessel) if chosen.limits else Limits.none())

    def start(self) -> FollowerState:
        """The state before the first reference."""
        carry = np.zeros(self.model.state_size + 16)
        carry[self.model.state_size + 6] = np.nan
        return FollowerState(frozen(carry))

    def prepare(self) -> None:
        """Compile now rather than at the first row."""
        self.advance(self.start(), np.empty(0), np.empty((0, 9)))

    def advance(
        self,
        state: FollowerState,
        times: Floats,
        references: Floats,
        jumps: NDArray[np.bool_] | None = None,
        voltage: Floats | None = None,
        wind: Floats | None = None,
    ) -> Followed:
        """References (K, 9) at times (K,) [s] -> the shadow there, see `Follower`."""
        count, carry = len(times), state.carry.copy()
        shadows, forces = np.empty((count, 9)), np.empty((count, 3))
        bound = np.zeros(count, np.bool_)
        self.model.kernel.module.follow(
            self.model.theta, carry, np.array(self.options.gains), floats(times),
            floats(references), flags(jumps, count), *air(voltage, wind, count),
            *self.limits, shadows, forces, bound,
        )  # fmt: skip
        return Followed(FollowerState(frozen(carry)), shadows, forces, bound)
