"""Responses of a vessel: to a step of its sticks, and of a small boat with and without an effect.

**Step**: rise time, settling time and overshoot, of a signal or of a vessel.

    y₀ value before, y∞ value at the end of the hold, Δ = y∞ − y₀
    rise       from the first crossing of y₀ + 0.1 Δ to that of y₀ + 0.9 Δ
    settling   the last moment outside y∞ ± 0.02 |Δ| (or 0.05), after the step
    overshoot  the furthest beyond y∞, as a share of |Δ|

Not a number where the response has not settled within the hold, or does not change. Valid for
smooth signals. Source: Ogata, Modern Control Engineering, 5th ed., §5-3.

**Effect**: the same run of a small boat, plain and with the effect, which is made just strong
enough to be visible: from where a fit of it would start, away in steps of its own scale, until the
strongest channel differs by a quarter of its size.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.effects.effect import Effect, ForceAxis, Kind, Parameter, Role
from sim.excitation import helm_gain, mix_sticks
from sim.model import Model
from sim.state import Floats
from sim.vessel import AddedEffect, Dynamics, Hull, Rudder, Servo, Thruster, Vessel

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


EXAMPLE_DT = 0.1  # s
PARTS = (  # seconds, throttle, steer
    (3.0, 0.0, 0.0), (13.0, 0.6, 0.0), (10.0, 0.5, 0.25), (10.0, 0.5, -0.25), (10.0, 0.9, 0.0),
    (8.0, -0.6, 0.0), (8.0, 0.0, 0.0), (10.0, 0.2, 0.0),
)  # fmt: skip
BATTERY = 16.4, 13.6  # V at the beginning and at the end
MIN_SIZE = np.array([0.1, 0.05, 0.05])  # m/s, m/s, rad/s, of a channel that hardly moves
VISIBLE = 0.25  # of a channel's size; chosen by eye
PREFERRED = 0.5  # of the strongest channel: so strong, the channel that it acts on is shown instead
STEPS = (0, 1, 2, 4, 8, 16, 32, 64)  # scales away from the start
MAX_PERIOD_S = 40.0  # that is shown
BOAT = Vessel(
    name="small boat",
    hull=Hull(1.6, 0.9, 38.0, wind_area=(0.2, 0.5)),
    dynamics=Dynamics(42.0, 46.0, 12.0, -9.0, -14.0, -60.0, -60.0, -25.0, -14.0),
    thrusters=(
        Thruster("left", Servo(1), (-0.5, -0.4), (-30.0, 40.0)),
        Thruster("right", Servo(3), (-0.5, 0.4), (-30.0, 40.0)),
    ),
)
STEERED = replace(
    BOAT,
    thrusters=(Thruster("screw", Servo(3), (-0.7, 0.0), (-60.0, 80.0)),),
    rudders=(Rudder("rudder", Servo(1), (-0.8, 0.0), (-0.6, 0.6), area=0.02, wash="screw"),),
)


@dataclass(frozen=True)
class EffectExample:
    """One run, plain and with the effect.

    time     (T,)    s
    plain    (T, 3)  reported u, v, r [m/s, m/s, rad/s]
    changed  (T, 3)  the same with the effect
    channel          0 u, 1 v, 2 r: the one that shows it
    """

    effect: str
    values: Mapping[str, float]
    time: Floats
    plain: Floats
    changed: Floats
    channel: int


def run_example(effect: Effect) -> EffectExample:
    """The run of a boat that the effect can act on."""
    boat = STEERED if BOAT.unmet_needs(effect) else BOAT
    plain = _run(boat)
    time = np.asarray(EXAMPLE_DT * np.arange(len(plain)), np.float64)
    example = EffectExample(effect.name, values_of(effect, 0), time, plain, plain, 0)
    for step in STEPS:
        values = values_of(effect, step)
        changed = _run(boat.with_effects(AddedEffect(effect, values)))
        if not np.isfinite(changed).all():
            break
        share = _shares(plain, changed)
        channel = _channel(effect, values, share)
        example = EffectExample(effect.name, values, time, plain, changed, channel)
        if share.max() > VISIBLE:
            break
    return example


def _channel(effect: Effect, values: Mapping[str, float], share: Floats) -> int:
    """The channel that it acts on, if it is strong there; else the strongest."""
    against = effect.evidence_axis(values)
    acts = against.axis if against else ForceAxis.SURGE
    strongest = int(np.argmax(share))
    preferred = acts < len(share) and share[acts] > PREFERRED * share[strongest]
    return acts if preferred else strongest


def values_of(effect: Effect, step: int) -> dict[str, float]:
    """Its parameters, those that make it strong `step` scales away from their start."""
    if effect.example is not None:
        return dict(effect.example)
    strong = [p for p in effect.parameters if p.neutral is not None and p.kind is Kind.NUMBER]
    strong = strong or [p for p in effect.parameters if p.kind is Kind.NUMBER]
    seconds = sum(part[0] for part in PARTS)
    return {
        p.name: _strengthened(p, step) if p in strong else _fixed(p, seconds)
        for p in effect.parameters
    }


def _strengthened(p: Parameter, step: int) -> float:
    """Away from where it does nothing, within its bounds."""
    neutral = p.start if p.neutral is None else p.neutral
    up = p.start > neutral or (p.start == neutral and p.upper > p.start)
    return float(np.clip(p.start + (step if up else -step) * p.scale, p.lower, p.upper))


def _fixed(p: Parameter, seconds: float) -> float:
    if p.kind is Kind.MOMENT:
        return 0.4 * seconds
    return min(p.start, MAX_PERIOD_S) if p.role is Role.PERIOD else p.start


def _shares(plain: Floats, changed: Floats) -> Floats:
    """Difference of each channel over its own size: (3,)."""
    size = np.maximum(plain.std(axis=0), MIN_SIZE)
    return np.asarray(np.sqrt(np.mean((changed - plain) ** 2, axis=0)) / size)


def _run(boat: Vessel) -> Floats:
    """Reported u, v, r (T, 3) over the parts of the run."""
    sticks = np.concatenate([
        np.tile([throttle, helm_gain(boat) * steer], (round(seconds / EXAMPLE_DT), 1))
        for seconds, throttle, steer in PARTS
    ])  # fmt: skip
    volts = np.linspace(*BATTERY, len(sticks))
    _, reports = Model.of(boat).simulate(mix_sticks(boat, sticks), EXAMPLE_DT, voltage=volts)
    return np.asarray(reports[0, : len(sticks), 3:6])
