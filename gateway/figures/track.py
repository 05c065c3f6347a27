"""The track from above: measured against the model, and the error coloured along it."""

import numpy as np

from gateway.figures.figure_data import Axis, Coloured, FigureData, Line, Panel, Role
from gateway.figures.velocities import pieces
from sim.comparison.compare import Comparison
from sim.comparison.where import along_trial
from sim.state import Eta
from sim.trial import Trial

EAST, NORTH = Axis("east", "m"), Axis("north", "m")
ERROR = Axis("velocity error", "nrmse scales")


def track(trial: Trial, comparison: Comparison) -> FigureData:
    """Two maps side by side, north up."""
    _, model = pieces(trial, comparison.prediction)
    measured = np.where(trial.usable[:, None], trial.eta, np.nan)
    boat = Line(measured[:, Eta.EAST], measured[:, Eta.NORTH], Role.MEASURED, "measured")
    error = along_trial(comparison.prediction, comparison.ruler.scales, len(trial))
    known = np.flatnonzero(np.isfinite(error))
    context = Line(boat.x, boat.y, Role.CONTEXT)
    runs = f"{comparison.vessel}, free for {comparison.ruler.settings.horizon:g} s at a time"
    places = Panel(
        EAST, NORTH,
        (boat, Line(model[:, Eta.EAST], model[:, Eta.NORTH], Role.MODEL, runs)),
        "Track", equal=True,
    )  # fmt: skip
    errors = Panel(
        EAST, NORTH,
        (context, Coloured(trial.eta[known, Eta.EAST], trial.eta[known, Eta.NORTH],
                           error[known], ERROR)),
        "Where the model is wrong", equal=True,
    )  # fmt: skip
    return FigureData(f"{comparison.log}: track, {comparison.vessel}", (places, errors), columns=2)
