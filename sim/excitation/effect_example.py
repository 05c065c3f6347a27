"""What an effect does to a boat: the same run of a small boat, plain and with the effect.

The effect is made just strong enough to be visible: from where a fit of it would start, away in
steps of its own scale, until the strongest channel differs by a quarter of its size.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.effect import Effect, ForceAxis, Kind, Parameter, Role
from sim.excitation.sticks import helm_gain, mix_sticks
from sim.model import Model
from sim.state import Floats
from sim.vessel import AddedEffect, Dynamics, Hull, Rudder, Servo, Thruster, Vessel

DT = 0.1  # s
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
    time = np.asarray(DT * np.arange(len(plain)), np.float64)
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
        np.tile([throttle, helm_gain(boat) * steer], (round(seconds / DT), 1))
        for seconds, throttle, steer in PARTS
    ])  # fmt: skip
    volts = np.linspace(*BATTERY, len(sticks))
    _, reports = Model.of(boat).simulate(mix_sticks(boat, sticks), DT, voltage=volts)
    return np.asarray(reports[0, : len(sticks), 3:6])
