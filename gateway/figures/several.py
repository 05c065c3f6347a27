"""Several recordings on one plot: velocities, or errors of a model, over an axis that they share.

Recordings are laid over one another at a moment of each, or along the way that they ran through.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gateway.figures.figure_data import Axis, FigureData, Line, Panel, SeriesRole
from gateway.figures.style import SEVERAL, VELOCITIES
from sim.state import Floats

SINCE = Axis("time after that moment", "s")
ALONG = Axis("way run through", "m")


class Course(NamedTuple):
    """One recording: its name, x (n,) of its rows, u, v, r (n, 3) [m/s, m/s, rad/s]."""

    name: str
    x: Floats
    velocity: Floats


def way_run(north: Floats, east: Floats) -> Floats:
    """Places (n,) [m] -> length of the track up to each (n,) [m]."""
    steps = np.hypot(np.diff(north), np.diff(east))
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])


def several_velocities(courses: Sequence[Course], axis: Axis, what: str) -> FigureData:
    """u, v, r of all courses, each in a colour of its own; `what` they are, as a title."""
    panels = tuple(
        Panel(
            axis, quantity,
            tuple(
                Line(one.x, one.velocity[:, i] * quantity.factor, SeriesRole.CONTEXT, one.name,
                     SEVERAL[k % len(SEVERAL)])
                for k, one in enumerate(courses)
            ),
        )
        for i, quantity in enumerate(VELOCITIES)
    )  # fmt: skip
    return FigureData(what, panels, shared_x=True)
