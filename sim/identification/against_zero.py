"""Is a channel predicted at all? A free run must beat saying "zero" on a recording it never saw.

    told on a recording:   RMSE(measured − model) < 0.9 · RMS(measured)

A parameter may fit what it was shown and still say nothing of another day. A channel that no
validation recording confirms is called not identifiable from these data, whatever its intervals.
"""

from collections.abc import Sequence

import numpy as np

from sim.diagnosis.free_run import FreeRun
from sim.diagnosis.ruler import SMALLEST
from sim.identification.validation import Validation

ENOUGH = 0.9  # of what predicting zero leaves
OWN = {"u": "m11, X_u and X_uu", "v": "m22, Y_v and Y_vv", "r": "m33, N_r and N_rr"}
CHANNELS = {"u": ("surge", "m/s", 3), "v": ("sway", "m/s", 4), "r": ("yaw rate", "rad/s", 5)}


def errors(run: FreeRun, channel: str) -> tuple[float, float]:
    """RMSE of a free run on a channel, and that of predicting zero."""
    column = CHANNELS[channel][2]
    measured = run.model[:, column] + run.error[:, column]
    return float(np.sqrt(np.mean(run.error[:, column] ** 2))), float(np.sqrt(np.mean(measured**2)))


def told(run: FreeRun, channel: str) -> bool | None:
    """Better than zero by a tenth; None: it hardly moved."""
    if run.diverged or not len(run.error):
        return False
    model, zero = errors(run, channel)
    return None if zero < 0.5 * SMALLEST[CHANNELS[channel][2] - 3] else model < ENOUGH * zero


def untold_channels(validation: Sequence[Validation]) -> tuple[str, ...]:
    """A sentence for each channel that no recording confirms; none without a free run."""
    runs = [v.after.free_run for v in validation]
    said = []
    for channel, (name, unit, _) in CHANNELS.items():
        verdicts = [(run, told(run, channel)) for run in runs if run is not None]
        verdicts = [(run, verdict) for run, verdict in verdicts if verdict is not None]
        if verdicts and not any(verdict for _, verdict in verdicts):
            how = _how([run for run, _ in verdicts], channel, unit)
            said.append(f"{name} is {how}: {OWN[channel]} mean nothing beyond the runs fitted")
    return tuple(said)


def _how(runs: Sequence[FreeRun], channel: str, unit: str) -> str:
    whole = [errors(run, channel) for run in runs if len(run.error) and not run.diverged]
    figures = ", ".join(f"{model:.3f} against {zero:.3f} {unit}" for model, zero in whole)
    return (
        "not identifiable from these data: on recordings that the fit did not see the model is no "
        f"better than predicting zero ({figures or 'its free runs leave the track'})"
    )
