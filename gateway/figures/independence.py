"""Do errors follow the commands? Correlation at each lag, with the band of independent series."""

import numpy as np

from gateway.figures.figure_data import Axis, Band, Dots, FigureData, Panel, Role
from sim.comparison.compare import Comparison
from sim.comparison.independence import LAGS
from sim.state import Floats

LAG = Axis("error after command", "s")
CORRELATION = Axis("correlation", "1")
LIKELY = "99 % of independent series"


def correlations(comparison: Comparison) -> FigureData:
    """One panel per pair of error and commanded force: a peak at a lag is thrust that comes late.

    Both were whitened; a peak on both sides of 0 is the smoother's, one at negative lags alone is
    an autopilot that answers the error.
    """
    found = comparison.independence
    assert found is not None
    lags = np.asarray(found.step * np.arange(-LAGS, LAGS + 1), dtype=float)
    level: Floats = np.full(len(lags), found.band)
    none = np.zeros(len(lags))
    panels = [
        Panel(
            LAG,
            CORRELATION,
            (
                Band(lags, -level, level, Role.INTERVAL, LIKELY),
                Dots(lags, p.correlation, np.minimum(p.correlation, none),
                     np.maximum(p.correlation, none), Role.ERROR, "correlation"),
            ),
            f"{p.error} after {p.input}",
        )
        for p in found.pairs
    ]  # fmt: skip
    title = f"{comparison.log}: do errors follow the commands? {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=1, shared_x=True, says=found.says)
