"""What an effect does: the same run of a small boat, plain and with the effect."""

from gateway.figures.figure_data import FigureData, Line, Panel, Role
from gateway.figures.velocities import CHANNELS, TIME
from sim.excitation.effect_example import Seen


def what_it_does(seen: Seen, looks_like: str = "") -> FigureData:
    """u, v, r over time: ahead, a turn to either side, full ahead, astern, coast, slowly ahead."""
    panels = tuple(
        Panel(
            TIME, axis,
            (
                Line(seen.time, seen.plain[:, i - 3] * factor, Role.CONTEXT, "without it"),
                Line(seen.time, seen.changed[:, i - 3] * factor, Role.MODEL, f"with {said(seen)}"),
            ),
        )
        for i, axis, factor in CHANNELS
    )  # fmt: skip
    return FigureData(f"{seen.effect}: what it does", panels, shared_x=True, says=looks_like)


def said(seen: Seen) -> str:
    """The effect with its numbers."""
    return f"{seen.effect} ({', '.join(f'{k} {v:.3g}' for k, v in seen.values.items())})"
