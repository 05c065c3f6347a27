"""Pictures of motions over one another: velocities over time, and the track."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gateway.figures import Axis, FigureData, Line, Panel, SeriesRole
from sim.state import Floats

TIME = Axis("time", "s")
AXES = ((3, Axis("surge u", "m/s")), (4, Axis("sway v", "m/s")), (5, Axis("yaw rate r", "rad/s")))


class Motion(NamedTuple):
    """A motion (T, 6 or more) at times (T,) [s] and how it is drawn."""

    label: str
    role: SeriesRole
    time: Floats
    motion: Floats


def velocities(title: str, motions: Sequence[Motion], says: str = "") -> FigureData:
    """u, v, r below one another."""
    panels = tuple(
        Panel(TIME, axis, tuple(Line(m.time, m.motion[:, i], m.role, m.label) for m in motions))
        for i, axis in AXES
    )
    return FigureData(title, panels, shared_x=True, caption=says)


def tracks(title: str, maps: Sequence[tuple[str, Sequence[Motion]]]) -> FigureData:
    """Maps side by side, north up."""
    panels = tuple(
        Panel(
            Axis("east", "m"), Axis("north", "m"),
            tuple(Line(m.motion[:, 1], m.motion[:, 0], m.role, m.label) for m in motions),
            name, equal=True,
        )
        for name, motions in maps
    )  # fmt: skip
    return FigureData(title, panels, columns=min(len(panels), 2))


def position_errors(
    title: str, time: Floats, trials: Mapping[str, Mapping[str, Floats]]
) -> FigureData:
    """Distance from the reference over time, trial by trial; errors (T, 6) by way to follow."""
    roles = (SeriesRole.SHADOW, SeriesRole.MODEL)
    panels = tuple(
        Panel(
            TIME, Axis("position error", "m"),
            tuple(
                Line(time, np.linalg.norm(error[:, :2], axis=1), role, way)
                for role, (way, error) in zip(roles, runs.items(), strict=True)
            ),
            trial,
        )
        for trial, runs in trials.items()
    )  # fmt: skip
    return FigureData(title, panels, columns=2)
