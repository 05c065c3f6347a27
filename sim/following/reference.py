"""The reference ν_ref: the estimate, the vessel's own prediction, or one after the other.

    measured   the estimate, as it is
    model      the vessel predicts from the boat's commands, from the first estimate on
    auto       the estimate while telemetry is fresh, the prediction while the link is down

At a hand-over the reference goes on where it was, pose, velocity and acceleration, and the offset
decays within seconds (`sim.following.law`). Pure: a state goes in, a new state comes out, and how
rows are cut into chunks does not change a bit.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.kernel.arrays import air, flags, floats, frozen
from sim.model import Model
from sim.state import Floats

FADE_S = 1.0  # time constant of a hand-over; chosen, not measured


class ReferenceMode(StrEnum):
    """Where the reference comes from."""

    MEASURED = "measured"
    MODEL = "model"
    AUTO = "auto"


@dataclass(frozen=True)
class ReferenceState:
    """The carried row (read-only)."""

    carry: Floats


class ReferenceResult(NamedTuple):
    """The state after some rows, and the reference at each.

    references  (K, 9)
    from_model  (K,)  the model gives it
    diverged    (K,)  … and had left what a boat can do: it began anew at the estimate
    """

    state: ReferenceState
    references: Floats
    from_model: NDArray[np.bool_]
    diverged: NDArray[np.bool_]


@dataclass(frozen=True)
class Reference:
    """Estimates and commands in, the reference out."""

    model: Model
    mode: ReferenceMode = ReferenceMode.AUTO
    fade: float = FADE_S

    def start(self) -> ReferenceState:
        """The state before the first row."""
        return ReferenceState(frozen(np.full(self.model.state_size + 21, np.nan)))

    def prepare(self) -> None:
        """Compile the loop."""
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
    ) -> ReferenceResult:
        """Estimates (K, 9) at times (K,) [s] -> references (K, 9).

        fresh (K,): telemetry is up to date at that row. Commands (K, na) hold over the interval
        that ends at their row, taken as they act: a command delay is the caller's. jumps (K,):
        estimates that did not come about by motion; the model is set to them.
        """
        count, carry = len(times), state.carry.copy()
        from_model = self._from_model(flags(fresh, count))
        out, diverged = np.empty((count, 9)), np.zeros(count, np.bool_)
        self.model.kernel.module.compute_reference(
            self.model.theta, carry, self.fade, floats(times), floats(estimates), from_model,
            ~from_model, flags(jumps, count), floats(commands), *air(voltage, wind, count), out,
            diverged,
        )  # fmt: skip
        return ReferenceResult(ReferenceState(frozen(carry)), out, from_model, diverged)

    def _from_model(self, fresh: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which rows the model gives (K,); at the others it is set to the estimate."""
        if self.mode is ReferenceMode.AUTO:
            return ~fresh
        return np.full_like(fresh, self.mode is ReferenceMode.MODEL)
