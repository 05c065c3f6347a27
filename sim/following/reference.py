"""The reference ν_ref: measured, the vessel's own prediction, or whichever is to be had.

    measured   the estimate, as it is
    model      the vessel predicts from the boat's commands, from the first estimate on
    auto       the estimate while telemetry is fresh, the prediction while the link is down

At a hand-over the reference goes on where it was, pose, velocity and acceleration, and what it was
off fades within seconds (`sim.following.blend`). Pure, and the same whatever the chunks.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.kernel.arrays import air, flags, floats, frozen
from sim.model import Model
from sim.state import Floats

FADE = 1.0  # s: time constant of a hand-over


class Mode(StrEnum):
    """Where the reference comes from."""

    MEASURED = "measured"
    MODEL = "model"
    AUTO = "auto"


@dataclass(frozen=True)
class ReferenceState:
    """What is carried from row to row (read-only)."""

    carry: Floats


class Referred(NamedTuple):
    """The next state, references (K, 9), and which of them are the model's (K,)."""

    state: ReferenceState
    references: Floats
    from_model: NDArray[np.bool_]


@dataclass(frozen=True)
class Reference:
    """Estimates and commands in, the reference out."""

    model: Model
    mode: Mode = Mode.AUTO
    fade: float = FADE

    def start(self) -> ReferenceState:
        """The state before the first row."""
        return ReferenceState(frozen(np.full(self.model.state_size + 21, np.nan)))

    def prepare(self) -> None:
        """Compile now rather than at the first row."""
        rows, commands = np.empty((0, 9)), np.empty((0, self.model.actuator_count))
        self.advance(self.start(), np.empty(0), rows, np.zeros(0, np.bool_), commands)

    def advance(
        self,
        state: ReferenceState,
        times: Floats,
        estimates: Floats,
        fresh: NDArray[np.bool_],
        commands: Floats,
        voltage: Floats | None = None,
        wind: Floats | None = None,
        jumps: NDArray[np.bool_] | None = None,
    ) -> Referred:
        """Estimates (K, 9) at times (K,) [s] -> references (K, 9).

        fresh (K,): telemetry is up to date at that row. Commands (K, na) hold over the interval
        that ends at their row, taken as they act: a command delay is the caller's. jumps (K,):
        estimates that did not come about by motion; the model is set to them.
        """
        count, carry = len(times), state.carry.copy()
        up, leaps = flags(fresh, count), flags(jumps, count)
        modelled, anchored = self._roles(up)
        out = np.empty((count, 9))
        self.model.kernel.module.refer(
            self.model.theta, carry, self.fade, floats(times), floats(estimates), modelled,
            anchored, leaps, floats(commands), *air(voltage, wind, count), out,
        )  # fmt: skip
        return Referred(ReferenceState(frozen(carry)), out, modelled)

    def _roles(self, fresh: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which rows the model gives, and on which it is set to the estimate: (K,), (K,)."""
        if self.mode is Mode.MEASURED:
            return np.zeros_like(fresh), np.ones_like(fresh)
        if self.mode is Mode.MODEL:
            return np.ones_like(fresh), np.zeros_like(fresh)
        return ~fresh, fresh.copy()
