"""Figures of predicted motion: a plan's sticks, motion and track, and what an effect does.

Figures of an identification: measured, before and after; and the parameters with intervals.
"""

from collections.abc import Sequence

import numpy as np

from gateway.figures.figure_data import Axis, Dots, FigureData, Level, Line, Panel, SeriesRole
from gateway.figures.motion import (
    MotionSeries,
    joined_runs,
    map_panel,
    measured_series,
    track_line,
    velocity_panels,
)
from gateway.figures.style import SURGE, TIME, YAW_RATE
from sim.excitation.effect_example import EffectExample
from sim.excitation.manoeuvre import Stick
from sim.excitation.sticks import Plan
from sim.identification.intervals import Estimate
from sim.prediction.free_runs import Prediction
from sim.state import Floats
from sim.trial import Trial


def plan_motion(plan: Plan) -> FigureData:
    """Throttle, steer, surge and yaw rate, one below the other."""

    def panel(axis: Axis, values: Floats, role: SeriesRole, label: str) -> Panel:
        return Panel(TIME, axis, (Line(plan.time, values * axis.factor, role, label),))

    model, sticks = (SeriesRole.MODEL, _label(plan)), (SeriesRole.CONTEXT, "sticks")
    panels = (
        panel(Axis("throttle"), plan.sticks[:, Stick.THROTTLE], *sticks),
        panel(Axis("steer"), plan.sticks[:, Stick.STEER], *sticks),
        panel(SURGE, plan.motion[:, 3], *model),
        panel(YAW_RATE, plan.motion[:, 5], *model),
    )
    return FigureData(_title(plan), panels, shared_x=True, caption=plan.manoeuvre.reveals)


def plan_track(plan: Plan, radius_m: float) -> FigureData:
    """The planned track from above, bow to the north at the start, and the circle around it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = Line(radius_m * np.sin(angle), radius_m * np.cos(angle), SeriesRole.CONTEXT,
                  f"{radius_m:g} m: beyond, the script stops")  # fmt: skip
    path = track_line(plan.motion[:, :2] - plan.motion[0, :2], SeriesRole.MODEL, _label(plan))
    east, north = Axis("east of the start", "m"), Axis("north of the start", "m")
    caption = f"at most {plan.reach:.0f} m from the start; wind and current come on top"
    panel = Panel(east, north, (circle, path), equal=True)
    return FigureData(_title(plan), (panel,), caption=caption)


def _title(plan: Plan) -> str:
    return f"{plan.manoeuvre.name}, {plan.seconds:.0f} s, {plan.vessel.name}"


def _label(plan: Plan) -> str:
    return f"{plan.vessel.name}, predicted"


def effect_example_figure(example: EffectExample, looks_like: str = "") -> FigureData:
    """u, v, r of the same run of a small boat, plain and with the effect.

    Ahead, a turn to either side, full ahead, astern, coast, slowly ahead.
    """
    label = f"with {effect_with_values(example)}"
    panels = velocity_panels([
        MotionSeries(example.time, example.plain, SeriesRole.CONTEXT, "without it"),
        MotionSeries(example.time, example.changed, SeriesRole.MODEL, label),
    ])  # fmt: skip
    title = f"{example.effect}: what it does"
    return FigureData(title, panels, shared_x=True, caption=looks_like)


def effect_with_values(example: EffectExample) -> str:
    """The effect with its numbers: `NAME (PARAMETER 0.8)`."""
    values = ", ".join(f"{name} {value:.3g}" for name, value in example.values.items())
    return f"{example.effect} ({values})"


CHANGE = Axis("against the vessel file before", "%")
LONGEST_WHISKER = 3.0  # times the largest change, at least 30 %; chosen for readability


def identification_figures(
    trial: Trial, before: Prediction, after: Prediction, horizon: float
) -> dict[str, FigureData]:
    """Velocities and tracks of one recording, models running freely for `horizon` seconds."""
    measured = measured_series(trial)
    models = [
        MotionSeries(*joined_runs(trial, before), SeriesRole.CONTEXT, "before"),
        MotionSeries(*joined_runs(trial, after), SeriesRole.MODEL, "after"),
    ]
    boat = track_line(measured.motion, measured.role, measured.label)
    maps = tuple(
        map_panel((track_line(m.motion, m.role, m.label), boat), m.label.capitalize())
        for m in models
    )
    caption = f"models run free for {horizon:g} s at a time"
    return {
        "velocities": FigureData(
            f"{trial.name}: velocities", velocity_panels([*models, measured]), shared_x=True,
            caption=caption,
        ),
        "track": FigureData(f"{trial.name}: track", maps, columns=2, caption=caption),
    }  # fmt: skip


def parameter_changes(vessel: str, estimates: Sequence[Estimate]) -> FigureData:
    """Each number with its 95 % interval, in per cent of what it was."""
    before = np.array([e.before for e in estimates])
    size = np.array([abs(e.before) or abs(e.value) or 1.0 for e in estimates])
    value, low, high = (
        100.0 * (np.array(numbers) - before) / size
        for numbers in (
            [e.value for e in estimates],
            [e.ci95[0] for e in estimates],
            [e.ci95[1] for e in estimates],
        )
    )
    reach = LONGEST_WHISKER * max(float(np.abs(value).max(initial=0.0)), 10.0)
    dots = Dots(
        np.arange(len(estimates), dtype=float), value, np.clip(low, -reach, value),
        np.clip(high, value, reach), SeriesRole.MODEL, "after, with its 95 % interval",
    )  # fmt: skip
    identifiable = all(e.identifiable for e in estimates)
    label = "parameter" if identifiable else "parameter (?: these data do not tell it)"
    marks = (Level(0.0, SeriesRole.CONTEXT, "before"), dots)
    panel = Panel(Axis(label), CHANGE, marks, names=tuple(map(_name, estimates)))
    return FigureData(f"{vessel}: parameters", (panel,))


def _name(e: Estimate) -> str:
    lines = [e.name if e.identifiable else f"{e.name} ?", *([e.trial] if e.trial else [])]
    return "\n".join(lines).replace(".", ".\n")
