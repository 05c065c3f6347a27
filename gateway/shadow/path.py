"""The one path from measurements to shadow, shared by live and replay.

    measurements → estimate → ν_ref → follower → plant → rows of every topic

State is a value and a pure function of the ordered inputs: it does not matter how they are cut
into chunks. Live gives what a datagram brought, replay a few thousand measurements at a time.

Residuals of the vessel's model are missing force, and errors of free predictions that come due.
"""

from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.estimation import FilterSettings, Flag, MeasurementKind
from gateway.estimation.filter import Estimator, FilterRows, FilterState
from gateway.samples import CHANNELS as CHANNEL_COUNT
from gateway.shadow import FilterInputs
from gateway.shadow.residuals import ModelResiduals, ResidualEvaluator, ResidualState
from gateway.shadow.sensor_checks import SensorMemory
from sim.following.follower import (
    Follower,
    FollowerOptions,
    Reference,
    ReferenceMode,
    ReferenceState,
)
from sim.following.stepwise import follower_for
from sim.model import Model
from sim.plants import VESSEL, PlantChoice, PlantKind
from sim.state import Floats
from sim.vessel import Vessel

STALE_S = 1.0  # without a measurement for this long, telemetry is not fresh …
LOST_S = 5.0  # … nor without heading, or without velocity and position, for this long
COMMANDS_KEPT_S = 15.0  # for those that act late: more than the longest delay of an effect
CHANNELS = range(1, CHANNEL_COUNT + 1)
USED, VALID, BROKEN = int(Flag.USED), int(Flag.VALID), int(Flag.JUMP | Flag.RESTART)
MOTION = (MeasurementKind.VELOCITY, MeasurementKind.BODY_VELOCITY, MeasurementKind.POSITION)


class Freshness(NamedTuple):
    """Time [s] of the last used measurement: any, of heading, of velocity or position.

    After a silence the first measurements are mostly of the heading alone: until all have come,
    the estimate is still the one that ran blind.
    """

    last: float = -np.inf
    heading: float = -np.inf
    motion: float = -np.inf
    back: float = -np.inf  # when the last silence ended

    def after(self, time: float, kind: int) -> "Freshness":
        """A measurement of that kind was used."""
        return Freshness(
            time,
            time if kind == MeasurementKind.YAW else self.heading,
            time if kind in MOTION else self.motion,
            time if time - self.last > STALE_S else self.back,
        )

    def fresh(self, time: float) -> bool:
        """Does the estimate at that time rest on measurements?"""
        oldest = min(self.heading, self.motion)
        return time - self.last <= STALE_S and oldest >= max(self.back, time - LOST_S)


def discontinuous(inputs: FilterInputs, rows: FilterRows) -> NDArray[np.bool_]:
    """Rows (K,) where heading, velocity or position jumped. A jump of r is a sharp turn."""
    return np.asarray(rows.has(Flag.JUMP) & (inputs.events.kind != MeasurementKind.YAW_RATE))


def _broken(inputs: FilterInputs, rows: FilterRows) -> list[bool]:
    """Rows where the estimate jumped or the filter started anew; empty: none."""
    if not (rows.flags & BROKEN).any():
        return []
    broken: list[bool] = (discontinuous(inputs, rows) | rows.has(Flag.RESTART)).tolist()
    return broken


@dataclass(frozen=True)
class PathState:
    """Everything that the path remembers."""

    filter: FilterState
    reference: ReferenceState
    follower: Any
    residuals: ResidualState
    command_times: Floats  # of the recent rows …
    commands: Floats  # … and what was commanded then
    published: float = -np.inf  # time of the last row that went out [s]
    freshness: Freshness = field(default_factory=Freshness)
    jumped: bool = False  # a discontinuity since the last row that went out
    sensors: SensorMemory = field(default_factory=SensorMemory)


@dataclass(frozen=True)
class ShadowRows:
    """K rows that go out: estimate, reference and shadow (K, 9), forces (K, 3), and their times.

    row (K,) is the place of each in the chunk; `fresh` where the estimate rests on measurements,
    `limited` where the plant's thrust limits bind, `jumped` where the estimate is discontinuous,
    `diverged` where the model or the plant had left what a boat can do and began anew, `fit` where
    the boat's data are fresh and fit to judge its model by.
    """

    row: NDArray[np.int64]
    time_s: Floats
    vehicle_time_ns: NDArray[np.int64]
    receive_time_ns: NDArray[np.int64]
    estimate: Floats
    std: Floats
    fresh: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    reference: Floats
    from_model: NDArray[np.bool_]
    shadow: Floats
    control: Floats
    limited: NDArray[np.bool_]
    diverged: NDArray[np.bool_]
    residuals: ModelResiduals
    commands: Floats  # (K, na)
    fit: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.row)

    @classmethod
    def none(cls, horizons: int) -> "ShadowRows":
        """No row."""
        number, motion, force = np.zeros(0, np.int64), np.zeros((0, 9)), np.zeros((0, 3))
        flag = np.zeros(0, np.bool_)
        return cls(
            number, np.zeros(0), number, number, motion, motion, flag, flag, motion, flag, motion,
            force, flag, flag, ModelResiduals(force, force, force, np.zeros((0, 3 * horizons))),
            np.zeros((0, 1)), flag,
        )  # fmt: skip


class RowChoice(NamedTuple):
    """Rows (K,) of a chunk that go out, whether each is fresh and jumped; then what `PathState`
    remembers of it.
    """

    row: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    published: float
    freshness: Freshness
    still_jumped: bool  # a discontinuity after the last of these rows

    @property
    def part(self) -> NDArray[np.int64] | slice:
        """What picks them from a column: a slice where there is one, which costs a tenth."""
        if len(self.row) == 1:
            return slice(int(self.row[0]), int(self.row[0]) + 1)
        return self.row


class ShadowPath:
    """Estimator, reference, follower and residuals in a row. Holds settings, no state."""

    def __init__(
        self,
        model: Model,
        reference: Reference,
        follower: Follower,
        settings: FilterSettings | None = None,
        rate_hz: float = 50.0,
        own_plant: FollowerOptions | None = None,
    ) -> None:
        """`own_plant`: how the vessel itself is driven, where it is the plant."""
        self.model = model
        self.estimator = Estimator(settings)
        self.reference = reference
        self.follower = follower
        self.own_plant = own_plant
        self.residuals = ResidualEvaluator(model)
        self.min_interval_s = 0.9 / rate_hz
        self._no_rows = ShadowRows.none(len(self.residuals.horizons))
        self._commands_by_pulses = lru_cache(maxsize=64)(self._commands_of_row)

    @classmethod
    def of(
        cls,
        vessel: Vessel,
        plant: PlantChoice,
        settings: FilterSettings,
        *,
        reference: ReferenceMode,
        follower: FollowerOptions,
        rate_hz: float,
    ) -> "ShadowPath":
        """The path of a vessel whose shadow that plant plays."""
        model = Model.of(vessel)
        plant_model = model if plant.vessel is None else Model.of(plant.vessel)
        return cls(
            model,
            Reference(model, reference),
            follower_of(plant_model, follower, plant.kind),
            settings,
            rate_hz,
            follower if plant.vessel is None and plant.kind is VESSEL else None,
        )

    def with_numbers_of(self, vessel: Vessel) -> "ShadowPath":
        """The same path, its shadow moving as a vessel of other numbers but the same structure.

        Residuals stay those of the vessel that was given.
        """
        path, model = copy(self), Model.of(vessel)
        path.reference = replace(self.reference, model=model)
        if self.own_plant is not None:
            path.follower = follower_of(model, self.own_plant)
        return path

    def start(self) -> PathState:
        """Before the first measurement."""
        return PathState(
            self.estimator.start(),
            self.reference.start(),
            self.follower.start(),
            self.residuals.start(),
            np.zeros(0),
            np.zeros((0, self.model.actuator_count)),
        )

    def advance(
        self, state: PathState, inputs: FilterInputs, spend: bool = False
    ) -> tuple[PathState, ShadowRows, FilterRows]:
        """Take in K measurements -> the state after them, the rows that go out, the filter's rows.

        `spend`: the caller has no more use for `state`, see `Estimator.advance`.
        """
        filter_state, estimates = self.estimator.advance(state.filter, inputs.events, True, spend)
        sensors, faults = state.sensors.check(inputs)
        rows = estimates.with_faults(faults)
        choice = self._choose(state, inputs, rows)
        if not len(choice.row):
            state = replace(
                state, filter=filter_state, sensors=sensors, published=choice.published,
                freshness=choice.freshness, jumped=choice.still_jumped,
            )  # fmt: skip
            return state, self._no_rows, rows
        fresh, jumped, chosen = choice.fresh, choice.jumped, choice.part
        times, estimate = rows.time_s[chosen], rows.motion[chosen]
        fit = fresh & (faults[chosen] == 0)
        voltage, wind = inputs.voltage[chosen], inputs.wind[chosen]
        kept_times, kept, commands = self._acting_commands(state, times, inputs.pulses[chosen])
        reference = self.reference.advance(
            state.reference, times, estimate, fresh, commands, voltage, wind, jumped
        )
        from_model = reference.from_model
        following = self.follower.advance(
            state.follower, times, reference.references, jumped & ~from_model, voltage, wind
        )
        residual_state, residuals = self.residuals.advance(
            state.residuals, times, estimate, rows.covariance[chosen], commands, voltage, wind
        )
        residuals.missing[~fit] = np.nan
        state = PathState(
            filter_state, reference.state, following.state, residual_state, kept_times, kept,
            choice.published, choice.freshness, choice.still_jumped, sensors,
        )  # fmt: skip
        return (
            state,
            ShadowRows(
                choice.row,
                times,
                inputs.vehicle_time_ns[chosen],
                inputs.receive_time_ns[chosen],
                estimate,
                rows.std[chosen],
                fresh,
                jumped,
                reference.references,
                from_model,
                following.shadows,
                following.forces,
                following.limited,
                following.diverged | reference.diverged,
                residuals,
                commands,
                fit,
            ),
            rows,
        )

    def _choose(self, state: PathState, inputs: FilterInputs, rows: FilterRows) -> RowChoice:
        """Rows that go out: valid, at the end of a message, not faster than the rate asked for."""
        published, freshness, jumped = state.published, state.freshness, state.jumped
        kinds, complete = inputs.events.kind.tolist(), inputs.complete.tolist()
        flags, broken = rows.flags.tolist(), _broken(inputs, rows)
        out: list[tuple[int, bool, bool]] = []
        for k, time in enumerate(rows.time_s.tolist()):
            freshness = freshness.after(time, kinds[k]) if flags[k] & USED else freshness
            if broken and broken[k]:
                jumped = True
                published = min(published, time - self.min_interval_s)
            if flags[k] & VALID and complete[k] and time - published >= self.min_interval_s:
                out.append((k, freshness.fresh(time), jumped))
                published, jumped = time, False
        row, fresh, leapt = zip(*out, strict=True) if out else ((), (), ())
        return RowChoice(
            np.array(row, np.int64), np.array(fresh, np.bool_), np.array(leapt, np.bool_),
            published, freshness, jumped,
        )  # fmt: skip

    def _commands_of_row(self, pulses: bytes) -> Floats:
        """Pulses of one row -> commands (1, na)."""
        commands = self.model.vessel.commands(CHANNELS, np.frombuffer(pulses)[np.newaxis])
        commands.flags.writeable = False
        return commands

    def _acting_commands(
        self, state: PathState, times: Floats, pulses: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Commands (K, na) that act at each row: the latest, or those before the vessel's delay.

        -> times and commands that are kept for later rows, and those commands.
        """
        if len(pulses) == 1:  # live: the same pulses stand for some rows
            commands = self._commands_by_pulses(pulses.tobytes()).copy()  # kernels want to own it
        else:
            commands = self.model.vessel.commands(CHANNELS, pulses)
        delay = self.model.delay
        if delay <= 0.0:
            return state.command_times, state.commands, commands
        kept_times = np.concatenate([state.command_times, times])
        kept = np.concatenate([state.commands, commands])
        at = np.searchsorted(kept_times, times - delay, side="right") - 1
        acting = kept[np.maximum(at, 0)]
        recent = kept_times > (times[-1] if len(times) else -np.inf) - COMMANDS_KEPT_S
        return kept_times[recent], kept[recent], acting


def follower_of(model: Model, options: FollowerOptions, kind: PlantKind = VESSEL) -> Follower:
    """The follower of a plant made from that model; BadInput where it cannot do what is asked."""
    try:
        return follower_for(model, options, kind)
    except ValueError as error:
        raise BadInput(f"{model.vessel.name}: {error}") from None
