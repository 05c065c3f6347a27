"""Figures of predicted motion: a plan's sticks, motion and track, and what an effect does."""

import numpy as np

from gateway.figures.figure_data import Axis, FigureData, Line, Panel, SeriesRole
from gateway.figures.motion import MotionSeries, track_line, velocity_panels
from gateway.figures.quantities import SURGE, TIME, YAW_RATE
from sim.excitation.effect_example import EffectExample
from sim.excitation.manoeuvre import Stick
from sim.excitation.plan import Plan
from sim.state import Floats


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
    """From above, bow to the north at the start, and the circle that it may not leave."""
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
