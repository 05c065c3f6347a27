"""Rise time, settling time and overshoot of the response to a step, of a signal or of a vessel.

    y₀ value before, y∞ value at the end of the hold, Δ = y∞ − y₀
    rise       from the first crossing of y₀ + 0.1 Δ to that of y₀ + 0.9 Δ
    settling   the last moment outside y∞ ± 0.02 |Δ| (or 0.05), after the step
    overshoot  the furthest beyond y∞, as a share of |Δ|

Not a number where the response has not settled within the hold, or does not change. Valid for
smooth signals. Source: Ogata, Modern Control Engineering, 5th ed., §5-3.
"""

from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from sim.excitation.sticks import helm_gain, mix_sticks
from sim.model import Model
from sim.state import Floats

SETTLED_SHARE = 0.005  # of the change, which the last fifth of a settled response may still move
MIN_CHANGE = 1e-6  # in the signal's unit: rounding of a signal that does not change
DT = 0.05  # s
HOLDS_S = (60.0, 240.0, 960.0)  # the shortest in which the response settles is used
THROTTLE, STEER = 0.5, 0.25
SURGE, YAW_RATE = 3, 5  # columns of a report


@dataclass(frozen=True)
class StepResponse:
    """Response to one step: its start [s], values in the signal's unit, times in seconds."""

    start: float
    before: float
    after: float
    rise: float
    settling_2: float
    settling_5: float
    overshoot: float

    @property
    def settled(self) -> bool:
        """Whether it settled within the hold."""
        return bool(np.isfinite(self.settling_2))


def step_response(time: Floats, signal: Floats) -> StepResponse:
    """Response to a step at time[0]: times (T,) [s] and signal (T,) of its hold."""
    before, after = float(signal[0]), float(np.median(signal[-max(len(signal) // 10, 1) :]))
    change = after - before
    tail = signal[-max(len(signal) // 5, 2) :]
    still_moving = not np.abs(tail - after).max() <= SETTLED_SHARE * abs(change)
    if not abs(change) >= MIN_CHANGE or still_moving:
        return StepResponse(float(time[0]), before, after, np.nan, np.nan, np.nan, np.nan)
    share = (signal - before) / change
    since = time - time[0]
    return StepResponse(
        start=float(time[0]),
        before=before,
        after=after,
        rise=_crossing(since, share, 0.9) - _crossing(since, share, 0.1),
        settling_2=_settling(since, share, 0.02),
        settling_5=_settling(since, share, 0.05),
        overshoot=max(float(share.max()) - 1.0, 0.0),
    )


def responses_to(command: Floats, time: Floats, signal: Floats) -> list[StepResponse]:
    """Responses of a signal (T,) at times (T,) [s] to each step of a command (T,) or (T, n).

    A step is a change that is then held; the hold ends with the next change.
    """
    table = command if command.ndim == 2 else command[:, None]
    changes = np.flatnonzero(np.any(np.diff(table, axis=0) != 0.0, axis=1)) + 1
    ends = np.append(changes[1:], len(time) - 1)
    # the row of the change is the last one of the state before it
    return [
        step_response(time[a : b + 1], signal[a : b + 1])
        for a, b in zip(changes, ends, strict=True)
        if b - a >= 10
    ]


def _crossing(time: Floats, share: Floats, level: float) -> float:
    """Time at which the share first reaches the level, between rows."""
    k = int(np.argmax(share >= level))
    part = (level - share[k - 1]) / (share[k] - share[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))


def _settling(time: Floats, share: Floats, band: float) -> float:
    """The last moment outside 1 ± band, between rows."""
    off = np.abs(share - 1.0)
    k = int(np.flatnonzero(off > band)[-1])
    part = (off[k] - band) / (off[k] - off[k + 1])
    return float(time[k] + part * (time[k + 1] - time[k]))


class StepResponses(NamedTuple):
    """Surge to a step of throttle from rest [m/s], yaw rate to one of the helm [rad/s]."""

    surge: StepResponse
    yaw: StepResponse

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Plain values without what is not a number."""
        return {
            name: {key: value for key, value in asdict(one).items() if np.isfinite(value)}
            for name, one in self._asdict().items()
        }


def step_responses(model: Model, throttle: float = THROTTLE, steer: float = STEER) -> StepResponses:
    """Responses of a vessel: one with rudders turns under way, others from rest."""
    helm = min(helm_gain(model.vessel) * steer, 1.0)
    under_way = throttle if model.vessel.rudders else 0.0
    surge = _response(model, SURGE, (0.0, 0.0), (throttle, 0.0))
    return StepResponses(surge, _response(model, YAW_RATE, (under_way, 0.0), (under_way, helm)))


def _response(
    model: Model, column: int, before: tuple[float, float], after: tuple[float, float]
) -> StepResponse:
    """Settle under the sticks before, then step to those after and hold them."""
    for hold in HOLDS_S:
        count = round(hold / DT)
        sticks = np.repeat(np.array([before, after]), count, axis=0)
        signal = model.simulate(mix_sticks(model.vessel, sticks), DT)[1][0, count:, column]
        response = step_response(DT * np.arange(len(signal), dtype=float), signal)
        if response.settled:
            break
    return response
