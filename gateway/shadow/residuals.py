"""What the vessel's model lacks, row by row: missing force, errors of predictions that come due.

The missing force is what the vessel would need beside its commanded forces to move as it was
measured; a prediction starts each second and is held against the estimate at each horizon.
"""

from dataclasses import dataclass, field

import numpy as np

from gateway.topics import HORIZONS_S
from sim.model import Model
from sim.state import Floats

PREDICTION_EVERY_S = 1.0  # a free prediction starts this often: as often as the monitor reads them
HORIZONS = np.array(HORIZONS_S, dtype=float)


@dataclass(frozen=True)
class ResidualState:
    """Memory of the missing force and the predictions under way."""

    carry: Floats  # (nx + 1,)
    predictions: Floats  # (S, nx + 2)
    errors: Floats  # (H, 3), the latest that came due


@dataclass(frozen=True)
class ModelResiduals:
    """Missing force with its standard deviation, τ(commands) (K, 3); errors (K, 3 H) of u, v, r."""

    missing: Floats
    missing_std: Floats
    commanded: Floats
    errors: Floats


@dataclass(frozen=True)
class ResidualEvaluator:
    """Compares the vessel's model with the estimate, row by row."""

    model: Model
    horizons: Floats = field(default_factory=lambda: HORIZONS)

    def start(self) -> ResidualState:
        """Before the first row."""
        slots = int(self.horizons[-1] / PREDICTION_EVERY_S) + 3
        return ResidualState(
            self.model.initial_carry(),
            np.full((slots, self.model.state_size + 2), np.nan),
            np.full((len(self.horizons), 3), np.nan),
        )

    def advance(
        self,
        state: ResidualState,
        times: Floats,
        motion: Floats,
        covariance: Floats,
        commands: Floats,
        voltage: Floats,
        wind: Floats,
    ) -> tuple[ResidualState, ModelResiduals]:
        """Estimates (K, 9) with covariance (K, 9, 9) and commands (K, na) at times (K,) [s]."""
        after = ResidualState(state.carry.copy(), state.predictions.copy(), state.errors.copy())
        inputs = {"voltage": voltage, "wind": wind}
        missing, commanded = self.model.missing_force(
            motion, times, commands, commands, carry=after.carry, **inputs
        )
        std = self.model.missing_force_std(motion, covariance, times, commands, **inputs)
        errors = np.empty((len(times), len(self.horizons), 3))
        self.model.kernel.module.forecast(
            self.model.theta, after.predictions, after.errors, self.horizons, PREDICTION_EVERY_S,
            times, motion, commands, voltage, wind, errors,
        )  # fmt: skip
        by_row = errors.reshape(len(times), 3 * len(self.horizons))
        return after, ModelResiduals(missing, std, commanded, by_row)
