"""The course of one number of a boat over its recordings, with the change that is believed."""

from gateway.figures.figure_data import (
    Axis,
    Band,
    Dots,
    FigureData,
    Line,
    Panel,
    SeriesRole,
)
from sim.wear import NORMAL_95, Course, Series


def course_figure(
    title: str, unit: str, since: str, series: Series, course: Course, caption: str
) -> FigureData:
    """What each recording says with its interval, and the course; `since`: its first day."""
    half = NORMAL_95 * series.std
    marks = (
        Band(series.time, course.low, course.high, SeriesRole.INTERVAL, "course, 95 %"),
        Line(series.time, course.mean, SeriesRole.MODEL, "course"),
        Dots(
            series.time, series.value, series.value - half, series.value + half,
            SeriesRole.MEASURED, "recordings",
        ),
    )  # fmt: skip
    days = Axis(f"time since {since}", "days")
    return FigureData(title, (Panel(days, Axis("value", unit), marks),), caption=caption)
