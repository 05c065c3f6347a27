"""All manoeuvres, and the list of them, one line each; the first is several of them in one.

Those whose sticks are a function of time: held levels and ramps, sines, random sequences, drawn by
a seed, for validation. Those of turning: full circles, zigzag, on the spot.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation import (
    Leg,
    LegManoeuvre,
    Manoeuvre,
    StickLimits,
    held_sticks,
    helm_gain,
    mix_sticks,
    within_travel,
)
from sim.model import Model
from sim.state import Eta, Floats
from sim.vessel import Vessel


@final
@dataclass(frozen=True)
class MotorsOff(Manoeuvre):
    """Sticks in neutral: the boat drifts."""

    name: ClassVar = "still"
    reveals: ClassVar = (
        "current and wind alone: the drift, and how the boat lies in it; sensor noise"
    )
    seconds: float = 60.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        return np.zeros((len(time), 2))


@final
@dataclass(frozen=True)
class Constant(Manoeuvre):
    """Throttle and helm held: one steady turn (the paper's constant excitation)."""

    name: ClassVar = "constant"
    reveals: ClassVar = "steady speed and turn rate: thrust against drag alone, no inertia"
    throttle: float = 0.6
    steer: float = 0.1
    seconds: float = 60.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        return np.tile([self.throttle, self.steer], (len(time), 1))


@final
@dataclass(frozen=True)
class Steps(LegManoeuvre):
    """Throttle in steps of `hold` [s], coasting for `coast` [s] in between, a little helm."""

    name: ClassVar = "steps"
    reveals: ClassVar = (
        "surge: m11, X_u, X_uu; accelerating against coasting parts drag from thrust (advance loss)"
    )
    levels: tuple[float, ...] = (0.3, 0.6, 0.9, 0.45, 0.0, -0.4, 0.2, 1.0, 0.0, 0.5)
    helm: float = 0.1
    hold: float = 8.0
    coast: float = 12.0

    @property
    def legs(self) -> list[Leg]:
        return [
            (self.hold, level, self.helm * (-1) ** k) if level else (self.coast, 0.0, 0.0)
            for k, level in enumerate(self.levels)
        ]


@final
@dataclass(frozen=True)
class Square(Manoeuvre):
    """Throttle and helm jump between two levels each (the paper's square excitation).

    Their periods [s] are not multiples of one another: all four corners come up.
    """

    name: ClassVar = "square"
    reveals: ClassVar = "lag and delay at the edges, damping on the plateaus: m11, m33, X_uu, N_r"
    high: float = 0.8
    low: float = 0.2
    helm: float = 0.3
    throttle_period: float = 24.0
    helm_period: float = 15.0
    seconds: float = 120.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        upper = time % self.throttle_period < 0.5 * self.throttle_period
        starboard = time % self.helm_period < 0.5 * self.helm_period
        helm = np.where(starboard, self.helm, -self.helm)
        return np.stack([np.where(upper, self.high, self.low), helm], axis=-1)


@final
@dataclass(frozen=True)
class Ramp(Manoeuvre):
    """A slow ramp of throttle through neutral: 0, +level, 0, −level, 0 in `seconds`."""

    name: ClassVar = "ramp"
    reveals: ClassVar = "small commands: dead-band, thrust curve, trim; drag at every speed"
    level: float = 0.5
    seconds: float = 100.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        corners = self.seconds * np.array([0.0, 0.25, 0.75, 1.0])
        throttle = np.interp(time, corners, (0.0, self.level, -self.level, 0.0))
        return np.stack([throttle, np.zeros_like(throttle)], axis=-1)


@final
@dataclass(frozen=True)
class Reversals(LegManoeuvre):
    """Straight ahead, astern, ahead, at two levels, each for `hold` [s]."""

    name: ClassVar = "reversals"
    reveals: ClassVar = "thrust astern against ahead: reverse loss, astern stall; X_u, X_uu"
    levels: tuple[float, ...] = (0.5, 0.8)
    hold: float = 10.0

    @property
    def legs(self) -> list[Leg]:
        sides = (1.0, -1.0, 1.0, -1.0)
        return [(self.hold, side * level, 0.0) for level in self.levels for side in sides]


@final
@dataclass(frozen=True)
class Sinusoid(Manoeuvre):
    """Throttle and helm swing at a period [s] each (the paper's sinusoidal excitation).

    throttle = mean + swing sin(2πt / T₁),  steer = helm sin(2πt / T₂)
    """

    name: ClassVar = "sinusoid"
    reveals: ClassVar = "inertia against damping at one frequency each: m11, m33, X_u, N_r"
    mean: float = 0.45
    swing: float = 0.4
    helm: float = 0.3
    throttle_period: float = 24.0
    helm_period: float = 15.0
    seconds: float = 120.0  # a whole number of both periods

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        turns = 2.0 * np.pi * time
        throttle = self.mean + self.swing * np.sin(turns / self.throttle_period)
        return np.stack([throttle, self.helm * np.sin(turns / self.helm_period)], axis=-1)


@final
@dataclass(frozen=True)
class Chirp(Manoeuvre):
    """Helm and throttle swing faster and faster, from `low` to `high` [Hz].

    phase = 2π (f₀ t + ½ (f₁ − f₀) t² / T),  steer ∝ sin phase,  throttle ∝ sin 0.7 phase
    """

    name: ClassVar = "chirp"
    reveals: ClassVar = "lag against delay (a lag attenuates, a delay does not); m33, m11"
    low: float = 0.03
    high: float = 0.5
    mean: float = 0.5
    swing: float = 0.3
    helm: float = 0.3
    seconds: float = 60.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        rise = 0.5 * (self.high - self.low) / self.seconds
        phase = 2.0 * np.pi * (self.low * time + rise * time**2)
        throttle = self.mean + self.swing * np.sin(0.7 * phase)
        return np.stack([throttle, self.helm * np.sin(phase)], axis=-1)


@final
@dataclass(frozen=True)
class Random(Manoeuvre):
    """Levels held for 2 to 6 s (the paper's random excitation); ranges are lowest and highest."""

    name: ClassVar = "random"
    reveals: ClassVar = "a bit of everything at many frequencies; for validation"
    throttle: tuple[float, float] = (-0.3, 0.9)
    steer: tuple[float, float] = (-0.4, 0.4)
    hold: tuple[float, float] = (2.0, 6.0)
    seconds: float = 120.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        count = int(np.ceil(self.seconds / self.hold[0]))  # enough, however short they are
        ranges = (self.hold, self.throttle, self.steer)
        seconds, throttle, steer = (rng.uniform(*ends, count).tolist() for ends in ranges)
        return held_sticks(time, list(zip(seconds, throttle, steer, strict=True)))


@final
@dataclass(frozen=True)
class Joystick(Manoeuvre):
    """The stick moves to a new place within `move` [s] and rests there for `rest` [s].

    Smooth and monotone between places, without overshoot (PCHIP, Fritsch and Butland 1984). Ranges
    are lowest and highest.
    """

    name: ClassVar = "joystick"
    reveals: ClassVar = "what a pilot does by hand: slow changes, little astern; for validation"
    throttle: tuple[float, float] = (-0.1, 0.8)
    steer: tuple[float, float] = (-0.35, 0.35)
    move: tuple[float, float] = (0.7, 2.0)
    rest: tuple[float, float] = (1.0, 5.0)
    seconds: float = 120.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        return np.stack([self._axis(time, rng, ends) for ends in (self.throttle, self.steer)], -1)

    def _axis(self, time: Floats, rng: Generator, ends: tuple[float, float]) -> Floats:
        from scipy.interpolate import PchipInterpolator  # half a second, for this course alone

        count = int(np.ceil(self.seconds / (self.move[0] + self.rest[0])))
        spans = np.stack([rng.uniform(*self.move, count), rng.uniform(*self.rest, count)], -1)
        knots = np.concatenate([[0.0], np.cumsum(spans)])
        places = np.concatenate([[0.0], np.repeat(rng.uniform(*ends, count), 2)])
        return PchipInterpolator(knots, places)(time)


DT = 0.1  # s
MIN_TURN_S, MAX_TURN_S = 8.0, 120.0  # of a circle: beyond, a boat is taken not to come round
STEERAGE_THROTTLE = 0.2  # of a spin with a rudder, which turns nothing without a flow


def full_turn_seconds(vessel: Vessel, limits: StickLimits, throttle: float, steer: float) -> float:
    """Duration [s] of a full turn with sticks held: the slower of two starts.

    From rest, and out of a steady turn to the other side; slew is allowed for.
    """
    helm = min(helm_gain(vessel) * steer * limits.steer, limits.steer)
    ahead, count = throttle * limits.throttle, round(MAX_TURN_S / DT)
    other, turn = within_travel(vessel, np.array([[ahead, -helm], [ahead, helm]]))
    before = np.stack([np.zeros(2), other])  # (2, 2): one row per run
    sticks = np.concatenate([np.repeat(row[:, None], count, axis=1)
                             for row in (before, np.stack([turn, turn]))], axis=1)  # fmt: skip
    yaw = Model.of(vessel).simulate(mix_sticks(vessel, sticks), DT)[0][:, count:, Eta.YAW]
    turned = np.abs(yaw - yaw[:, :1]) >= 2.0 * np.pi
    steps = np.where(turned.any(axis=1), turned.argmax(axis=1), count)
    slew = max(2.0 * helm / limits.steer_rate, ahead / limits.throttle_rate)
    return min(max(float(steps.max()) * DT + slew, MIN_TURN_S), MAX_TURN_S)


@final
@dataclass(frozen=True)
class Circles(LegManoeuvre):
    """Full circles to starboard and to port at each speed, `holds` [s] as the vessel needs."""

    name: ClassVar = "circles"
    reveals: ClassVar = (
        "current, wind, heading offset, compass deviation: every heading, two speeds"
    )
    speeds: tuple[float, ...] = (0.4, 0.7)
    helm: float = 0.3
    holds: tuple[float, ...] = (20.0, 20.0)

    @property
    def legs(self) -> list[Leg]:
        pairs = list(zip(self.speeds, self.holds, strict=True))
        return [(hold, speed, side * self.helm) for speed, hold in pairs for side in (1, -1)]

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        holds = (full_turn_seconds(vessel, limits, speed, self.helm) for speed in self.speeds)
        return replace(self, holds=tuple(holds))


@final
@dataclass(frozen=True)
class Zigzag(LegManoeuvre):
    """Helm from side to side at two speeds (after Kempf's zigzag, open loop).

    It lies over for twice `hold` [s], on the first and the last side for half of that.
    """

    name: ClassVar = "zigzag"
    reveals: ClassVar = "yaw and sway: m33, m22, N_r, Y_v, cross damping; steering lag and offset"
    speeds: tuple[float, ...] = (0.5, 0.8)
    helm: float = 0.35
    hold: float = 5.0

    @property
    def legs(self) -> list[Leg]:
        sides = (1, -1, -1, 1, 1, -1)
        return [(self.hold, speed, side * self.helm) for speed in self.speeds for side in sides]


@final
@dataclass(frozen=True)
class Spin(LegManoeuvre):
    """Turns on the spot to starboard and to port: helm for `hold` [s], neutral for `coast` [s]."""

    name: ClassVar = "spin"
    reveals: ClassVar = (
        "yaw alone: m33, N_r, N_rr; left against right: imbalance, misalignment; "
        "sway with it: cross damping, centre of gravity, antenna"
    )
    helm: float = 0.5
    throttle: float = 0.0
    hold: float = 12.0
    coast: float = 8.0

    @property
    def legs(self) -> list[Leg]:
        coast = (self.coast, 0.0, 0.0)
        return [leg for side in (1, -1)
                for leg in ((self.hold, self.throttle, side * self.helm), coast)]  # fmt: skip

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        return replace(self, throttle=STEERAGE_THROTTLE) if vessel.rudders else self


@final
@dataclass(frozen=True)
class Mixed(Manoeuvre):
    """Manoeuvres one after the other (the paper's mixed excitation)."""

    name: ClassVar = "mixed"
    reveals: ClassVar = "all base parameters in one go; begin with this one"
    parts: tuple[Manoeuvre, ...] = (Steps(), Zigzag(), Circles(), Spin(), Chirp(), Random())

    @property
    def seconds(self) -> float:
        return sum(part.seconds for part in self.parts)

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        out, start = np.zeros((len(time), 2)), 0.0
        for part in self.parts:
            into = time - start
            inside = (into >= 0.0) & (into < part.seconds)
            out[inside] = part.sticks(into[inside], rng)  # also where empty: it draws all the same
            start += part.seconds
        return out

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        return replace(self, parts=tuple(part.adapted_to(vessel, limits) for part in self.parts))


MANOEUVRES: tuple[Manoeuvre, ...] = (
    Mixed(),
    Steps(),
    Reversals(),
    Zigzag(),
    Ramp(),
    Chirp(),
    Circles(),
    Spin(),
    MotorsOff(),
    Sinusoid(),
    Square(),
    Constant(),
    Random(),
    Joystick(),
)
BY_NAME = {manoeuvre.name: manoeuvre for manoeuvre in MANOEUVRES}
