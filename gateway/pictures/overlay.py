"""Measured, the model as it was, and the model as it is now, in one picture."""

from dataclasses import replace

from gateway.pictures.figure_data import FigureData, Line, Role


def overlay(before: FigureData, now: FigureData) -> FigureData:
    """Two pictures of the same panels, each with a measured and a model line."""
    panels = tuple(
        replace(new, marks=(*_as_context(old.marks), *new.marks))
        for old, new in zip(before.panels, now.panels, strict=True)
    )
    return replace(now, panels=panels)


def _as_context(marks: tuple[object, ...]) -> tuple[Line, ...]:
    return tuple(
        replace(mark, role=Role.CONTEXT, label="as given")
        for mark in marks
        if isinstance(mark, Line) and mark.role is Role.MODEL
    )
