"""Pictures of a plan: the sticks and the predicted motion over time, the predicted track."""

import numpy as np

from gateway.figures.error_against import DEGREES
from gateway.figures.figure_data import Axis, FigureData, Line, Panel, Role
from sim.excitation.manoeuvre import Stick
from sim.excitation.plan import Plan
from sim.state import Floats

TIME = Axis("time", "s")
EAST, NORTH = Axis("east of the start", "m"), Axis("north of the start", "m")


def motion(plan: Plan) -> FigureData:
    """Throttle, steer, surge and yaw rate, one below the other."""

    def panel(axis: Axis, values: Floats, role: Role, label: str) -> Panel:
        return Panel(TIME, axis, (Line(plan.time, values, role, label),))

    model = f"{plan.vessel.name}, predicted"
    return FigureData(
        _title(plan),
        (
            panel(Axis("throttle"), plan.sticks[:, Stick.THROTTLE], Role.CONTEXT, "sticks"),
            panel(Axis("steer"), plan.sticks[:, Stick.STEER], Role.CONTEXT, "sticks"),
            panel(Axis("surge u", "m/s"), plan.motion[:, 3], Role.MODEL, model),
            panel(Axis("yaw rate r", "°/s"), DEGREES * plan.motion[:, 5], Role.MODEL, model),
        ),
        shared_x=True,
        says=plan.manoeuvre.tells,
    )  # fmt: skip


def track(plan: Plan, radius_m: float) -> FigureData:
    """From above, bow to the north at the start, and the circle that it may not leave."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = Line(radius_m * np.sin(angle), radius_m * np.cos(angle), Role.CONTEXT,
                  f"{radius_m:g} m: beyond, the script stops")  # fmt: skip
    start = plan.motion[0]
    path = Line(plan.motion[:, 1] - start[1], plan.motion[:, 0] - start[0], Role.MODEL,
                f"{plan.vessel.name}, predicted")  # fmt: skip
    says = f"at most {plan.reach:.0f} m from the start; wind and current come on top"
    return FigureData(_title(plan), (Panel(EAST, NORTH, (circle, path), equal=True),), says=says)


def _title(plan: Plan) -> str:
    return f"{plan.manoeuvre.name}, {plan.seconds:.0f} s, {plan.vessel.name}"
