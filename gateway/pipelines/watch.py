"""Watching the model while the boat moves: missing force, and predictions that come due."""

from dataclasses import dataclass, field

import numpy as np

from gateway.topics import HORIZONS_S
from sim.model import Model
from sim.state import Floats

PREDICTION_EVERY_S = 1.0  # a free prediction starts this often
HORIZONS = np.array(HORIZONS_S, dtype=float)


@dataclass(frozen=True)
class WatchState:
    """Memory of the missing force and the predictions under way."""

    carry: Floats  # (nx + 1,)
    bank: Floats  # (S, nx + 2)
    errors: Floats  # (H, 3)


@dataclass(frozen=True)
class Watched:
    """Missing force with its standard deviation, τ(commands) (K, 3); errors (K, 3 H) of u, v, r."""

    missing: Floats
    missing_std: Floats
    commanded: Floats
    errors: Floats


@dataclass(frozen=True)
class Watch:
    """Holds the vessel's model against the estimate, row by row."""

    model: Model
    horizons: Floats = field(default_factory=lambda: HORIZONS)

    def start(self) -> WatchState:
        """Nothing seen yet."""
        slots = int(self.horizons[-1] / PREDICTION_EVERY_S) + 3
        return WatchState(
            self.model.fresh_carry(),
            np.full((slots, self.model.state_size + 2), np.nan),
            np.full((len(self.horizons), 3), np.nan),
        )

    def advance(
        self,
        state: WatchState,
        times: Floats,
        motion: Floats,
        covariance: Floats,
        commands: Floats,
        voltage: Floats,
        wind: Floats,
    ) -> tuple[WatchState, Watched]:
        """Estimates (K, 9) with covariance (K, 9, 9) and commands (K, na) at times (K,) [s]."""
        after = WatchState(state.carry.copy(), state.bank.copy(), state.errors.copy())
        around = {"voltage": voltage, "wind": wind}
        missing, commanded = self.model.missing_force(
            motion, times, commands, commands, carry=after.carry, **around
        )
        spread = self.model.missing_spread(motion, covariance, times, commands, **around)
        errors = np.empty((len(times), len(self.horizons), 3))
        self.model.kernel.module.forecast(
            self.model.theta, after.bank, after.errors, self.horizons, PREDICTION_EVERY_S, times,
            motion, commands, voltage, wind, errors,
        )  # fmt: skip
        return after, Watched(
            missing, spread, commanded, errors.reshape(len(times), 3 * len(self.horizons))
        )
