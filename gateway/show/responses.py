"""How a vessel answers to a step of throttle and of the helm, as a table."""

import math

from rich.table import Table

from sim.excitation.step_response import STEER, THROTTLE, Response, StepResponses
from sim.vessel import Vessel


def responses_table(vessel: Vessel, answers: StepResponses) -> Table:
    """Rise and settling times in seconds, overshoot in percent."""
    table = Table("step", "from rest to", "rise 10–90 %", "settles to 5 %", "to 2 %", "overshoot")
    table.title = "how the vessel answers to a step, predicted"
    surge, yaw = answers
    table.add_row(f"throttle {THROTTLE:g}", f"{surge.after:.2f} m/s", *_times(surge))
    under_way = ", under way" if vessel.rudders else ""
    table.add_row(f"steer {STEER:g}{under_way}", f"{math.degrees(yaw.after):.1f} °/s", *_times(yaw))
    return table


def _times(one: Response) -> tuple[str, ...]:
    if not one.settled:
        return ("does not come to rest", "–", "–", "–")
    times = (one.rise, one.settling_5, one.settling_2)
    return (*(f"{seconds:.1f} s" for seconds in times), f"{100 * one.overshoot:.0f} %")
