"""How a vessel answers to a step of throttle, and to one of the helm."""

from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from sim.excitation.mixing import helm_gain, mixed
from sim.excitation.response import Response, response
from sim.model import Model
from sim.state import Floats

DT = 0.05  # s
HOLDS = (60.0, 240.0, 960.0)  # s: the shortest in which the response comes to rest
THROTTLE, STEER = 0.5, 0.25
SURGE, YAW_RATE = 3, 5  # columns of a report


class StepResponses(NamedTuple):
    """Surge to a step of throttle from rest [m/s], yaw rate to one of the helm [rad/s]."""

    surge: Response
    yaw: Response

    def as_dict(self) -> dict[str, dict[str, float]]:
        """For JSON: what is not a number is left out."""
        return {
            name: {key: value for key, value in asdict(one).items() if np.isfinite(value)}
            for name, one in self._asdict().items()
        }


def step_responses(model: Model, throttle: float = THROTTLE, steer: float = STEER) -> StepResponses:
    """A vessel -> its responses. One with rudders turns under way, others from rest."""
    helm = min(helm_gain(model.vessel) * steer, 1.0)
    under_way = throttle if model.vessel.rudders else 0.0
    surge = _response(model, SURGE, (0.0, 0.0), (throttle, 0.0))
    return StepResponses(surge, _response(model, YAW_RATE, (under_way, 0.0), (under_way, helm)))


def _response(
    model: Model, column: int, before: tuple[float, float], after: tuple[float, float]
) -> Response:
    """Come to rest under the sticks before, then step to those after and hold them."""
    for hold in HOLDS:
        count = round(hold / DT)
        sticks = np.repeat(np.array([before, after]), count, axis=0)
        motion = _reported(model, sticks)[count:, column]
        found = response(DT * np.arange(len(motion), dtype=float), motion)
        if found.settled:
            break
    return found


def _reported(model: Model, sticks: Floats) -> Floats:
    """Sticks (T, 2) -> reports (T+1, 9)."""
    return model.simulate(mixed(model.vessel, sticks), DT)[1][0]
