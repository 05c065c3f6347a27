"""What a day brings: current, wind, waves and faults, some of them from one moment on.

A day adds effects to the vessel and changes numbers of it at moments: those of an effect, or the
share of its thrust that a thruster still gives. A change may take a while (`over`): it is then a
straight line from what was to what will be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.effects.effect import Effect
from sim.model import Model
from sim.near_names import did_you_mean
from sim.plants.waves import Sea
from sim.state import Floats
from sim.vessel import AddedEffect, Vessel


@dataclass(frozen=True)
class Wind:
    """Air that moves at `speed` [m/s] from `direction` [rad from north]."""

    speed: float
    direction: float

    @property
    def velocity(self) -> tuple[float, float]:
        """North, east [m/s] of the air."""
        return -self.speed * np.cos(self.direction), -self.speed * np.sin(self.direction)


@dataclass(frozen=True)
class Moment:
    """From `at` [s] on, within `over` [s], numbers of an effect or of a thruster are others.

    effect     and its new values; where the vessel does not have it, it is added: without effect
               before the moment as far as its parameters have such a value
    thruster   and the share of its thrust that is left (`gain`)
    wind       the new wind
    """

    at: float
    over: float = 0.0
    effect: Effect | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    thruster: str | None = None
    gain: float = 1.0
    wind: Wind | None = None


@dataclass(frozen=True)
class Day:
    """Effects beside those of the vessel, moments, wind that the vane sees, waves, depth [m].

    `place` is where north and east are 0, for autopilots that ask for degrees.
    """

    effects: tuple[AddedEffect, ...] = ()
    moments: tuple[Moment, ...] = ()
    wind: Wind | None = None
    sea: Sea | None = None
    depth: float | None = None
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # north, east [m], yaw [rad]
    place: tuple[float, float] = (47.397742, 8.545594)  # latitude, longitude [deg]: PX4's home


def vessel_of_day(vessel: Vessel, day: Day) -> Vessel:
    """The vessel with the effects of the day; ValueError where one cannot act on it."""
    effects = [*vessel.effects, *day.effects]
    for moment in sorted(day.moments, key=lambda m: m.at):
        known = [added.effect for added in effects]
        if moment.effect is not None and moment.effect not in known:
            effects.append(_before(moment))
    names = [thruster.name for thruster in vessel.thrusters]
    for moment in day.moments:
        if moment.thruster is not None and moment.thruster not in names:
            meant = did_you_mean(moment.thruster, names)
            raise ValueError(
                f"no thruster {moment.thruster!r}: {meant}there are {', '.join(names)}"
            )
    return replace(vessel, effects=tuple(effects))


def _before(moment: Moment) -> AddedEffect:
    """The effect as it is before the moment that brings it: nothing, or air that stands still."""
    assert moment.effect is not None
    parameters = moment.effect.parameters
    still = {p.name: 0.0 for p in parameters if p.unit == "m/s"}
    neutral = {p.name: p.neutral for p in parameters if p.neutral is not None}
    return AddedEffect(moment.effect, {**moment.values, **(neutral or still)})


@dataclass(frozen=True)
class _Change:
    """A column of the schedule goes to `value` from `at` on, within `over` [s]."""

    at: float
    over: float
    column: int
    value: float
    factor: bool = False  # of what the vessel file says


class Schedule:
    """Parameters theta (P,) and wind (2,) at any time of a day; pure, cheap between moments."""

    def __init__(self, model: Model, day: Day) -> None:
        wind = day.wind.velocity if day.wind is not None else (np.nan, np.nan)
        self._base = np.array([*model.theta, *wind])
        self._names = (*model.names, "wind north", "wind east")
        changes = [c for m in day.moments for c in self._changes(model.vessel, m)]
        self._changes_in_order = sorted(changes, key=lambda c: c.at)

    def at(self, time: float) -> tuple[Floats, Floats, float]:
        """Time [s] -> theta, wind north and east [m/s], and until when they hold [s]."""
        values, until = self._base.copy(), np.inf
        for change in self._changes_in_order:
            if time < change.at:
                until = min(until, change.at)
                continue
            share = 1.0 if change.over <= 0.0 else min((time - change.at) / change.over, 1.0)
            target = change.value * (self._base[change.column] if change.factor else 1.0)
            before = values[change.column]
            begin = before if np.isfinite(before) else 0.0  # a day without wind is calm
            values[change.column] = begin + share * (target - begin)
            until = until if share == 1.0 else time
        return values[:-2], values[-2:], until

    def _changes(self, vessel: Vessel, moment: Moment) -> Sequence[_Change]:
        def change(name: str, value: float, factor: bool = False) -> _Change:
            column = self._names.index(name)
            return _Change(moment.at, moment.over, column, value, factor)

        out = []
        if moment.effect is not None:
            label = moment.effect.name
            out += [change(f"{label}.{name}", value) for name, value in moment.values.items()]
        if moment.thruster is not None:
            ends = (f"{moment.thruster}.astern", f"{moment.thruster}.ahead")
            out += [change(name, moment.gain, True) for name in ends]
        if moment.wind is not None:
            north, east = moment.wind.velocity
            out += [change("wind north", north), change("wind east", east)]
        return out
