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
from gateway.shadow.driven import DrivenOutputs
from gateway.shadow.residuals import ModelResiduals, ResidualEvaluator, ResidualState
from gateway.shadow.sensor_checks import GAPS, SensorMemory, longest_gap, patience
from sim.following.follower import (
    Follower,
    FollowerOptions,
    Reference,
    ReferenceMode,
    ReferenceState,
)
from sim.following.stepwise import follower_for
from sim.kernel.compiled import compiled
from sim.model import Model
from sim.plants import VESSEL, PlantChoice, PlantKind
from sim.state import Floats, Ints
from sim.vessel import Vessel

STALE_S = 1.0  # without a measurement for this long, telemetry is not fresh; …
SLOW_STALE_S = 3.0  # … that of a slow stream is for some of its gaps, but not longer than this …
LOST_S = 5.0  # … nor without heading, or without velocity and position, for this long
COMMANDS_KEPT_S = 15.0  # for those that act late: more than the longest delay of an effect
CHANNELS = range(1, CHANNEL_COUNT + 1)
USED, VALID, BROKEN = int(Flag.USED), int(Flag.VALID), int(Flag.JUMP | Flag.RESTART)
YAW, POSITION = int(MeasurementKind.YAW), int(MeasurementKind.POSITION)
VELOCITY, BODY_VELOCITY = int(MeasurementKind.VELOCITY), int(MeasurementKind.BODY_VELOCITY)
NO_FLAGS = np.zeros(0, np.bool_)


class RowMemory(NamedTuple):
    """What is remembered to choose the rows that go out.

    Time [s] of the last used measurement: any, of heading, of velocity or position, and of the end
    of the last silence. After it the first measurements are mostly of the heading alone: until all
    have come, the estimate is still the one that ran blind. Gap [s]: the longest of late between
    two of heading, or two of motion; a stream that has just begun may be a slow one.
    """

    last: float = -np.inf
    heading: float = -np.inf
    motion: float = -np.inf
    back: float = -np.inf
    published: float = -np.inf  # time of the last row that went out [s]
    jumped: float = 0.0  # 1: a discontinuity since the last row that went out
    gap: float = SLOW_STALE_S / GAPS


@compiled
def choose_rows(
    before: tuple[float, ...], events: tuple[Any, ...], min_interval_s: float,
    out: tuple[Ints, NDArray[np.bool_], NDArray[np.bool_]],
) -> tuple[int, float, float, float, float, float, float, float]:  # fmt: skip
    """Rows that go out: valid, at the end of a message, not faster than the rate asked for.

    before  a `RowMemory`
    events  time, kind, complete and flags (K,), broken (K,), or (0,) where no row is
    out     (K,) their numbers, whether each is fresh (its estimate rests on measurements) and
            jumped, from the first on -> how many, and the `RowMemory` after all
    """
    last, heading, motion, back, published, jumped, gap = before
    times, kinds, complete, flags, broken = events
    rows, fresh, leapt = out
    count = 0
    for k in range(len(times)):
        time, kind = times[k], kinds[k]
        stale = patience(gap, STALE_S, SLOW_STALE_S)
        if flags[k] & USED:
            back = time if time - last > stale else back
            last, since = time, time
            if kind == YAW:
                since, heading = heading, time
            elif kind in (VELOCITY, BODY_VELOCITY, POSITION):
                since, motion = motion, time
            if 0.0 < time - since <= SLOW_STALE_S:
                gap = longest_gap(gap, time - since)
        if len(broken) and broken[k]:
            jumped = 1.0
            published = min(published, time - min_interval_s)
        if flags[k] & VALID and complete[k] and time - published >= min_interval_s:
            known = min(heading, motion) >= max(back, time - LOST_S)
            rows[count], fresh[count] = k, time - last <= stale and known
            leapt[count] = jumped > 0.0
            published, jumped, count = time, 0.0, count + 1
    return count, last, heading, motion, back, published, jumped, gap


def discontinuous(inputs: FilterInputs, rows: FilterRows) -> NDArray[np.bool_]:
    """Rows (K,) where heading, velocity or position jumped. A jump of r is a sharp turn."""
    return np.asarray(rows.has(Flag.JUMP) & (inputs.events.kind != MeasurementKind.YAW_RATE))


def _broken(inputs: FilterInputs, rows: FilterRows) -> NDArray[np.bool_]:
    """Rows where the estimate jumped or the filter started anew; empty: none."""
    if not np.count_nonzero(rows.flags & BROKEN):  # `any` takes five times as long for one
        return NO_FLAGS
    return discontinuous(inputs, rows) | rows.has(Flag.RESTART)


@dataclass(frozen=True)
class PathState:
    """Everything that the path remembers."""

    filter: FilterState
    reference: ReferenceState
    follower: Any
    residuals: ResidualState
    command_times: Floats  # of the recent rows …
    commands: Floats  # … and what was commanded then
    memory: RowMemory = field(default_factory=RowMemory)
    sensors: SensorMemory = field(default_factory=SensorMemory)
    outputs: DrivenOutputs = field(default_factory=DrivenOutputs)


@dataclass(frozen=True)
class ShadowRows:
    """K rows that go out: estimate, reference and shadow (K, 9), forces (K, 3), and their times.

    row (K,) is the place of each in the chunk; `fresh` where the estimate rests on measurements,
    `limited` where the plant's thrust limits bind, `jumped` where the estimate is discontinuous,
    `diverged` where the model or the plant had left what a boat can do and began anew, `reset`
    where the prediction was too far off to come back and was set to the measurement, `fit` where
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
    reset: NDArray[np.bool_]
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
            force, flag, flag, flag,
            ModelResiduals(force, force, force, np.zeros((0, 3 * horizons))), np.zeros((0, 1)),
            flag,
        )  # fmt: skip


class RowChoice(NamedTuple):
    """Rows (K,) of a chunk that go out, whether each is fresh and jumped; the memory after it."""

    row: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    memory: RowMemory

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
            outputs=DrivenOutputs.start(self.model.vessel),
        )

    def advance(
        self, state: PathState, inputs: FilterInputs, spend: bool = False
    ) -> tuple[PathState, ShadowRows, FilterRows]:
        """Take in K measurements -> the state after them, the rows that go out, the filter's rows.

        `spend`: the caller has no more use for `state`, see `Estimator.advance`.
        """
        filter_state, estimates = self.estimator.advance(state.filter, inputs.events, True, spend)
        sensors, faults = state.sensors.check(inputs)
        outputs, missed = state.outputs.check(inputs)
        if missed is not None:
            faults = faults | missed[0]
        rows = estimates.with_faults(faults)
        choice = self._choose(state, inputs, rows)
        if not len(choice.row):
            state = PathState(
                filter_state, state.reference, state.follower, state.residuals,
                state.command_times, state.commands, choice.memory, sensors, outputs,
            )  # fmt: skip
            return state, self._no_rows, rows
        fresh, jumped, chosen = choice.fresh, choice.jumped, choice.part
        times, estimate = rows.time_s[chosen], rows.motion[chosen]
        fit = fresh & (faults[chosen] == 0)
        voltage, wind = inputs.voltage[chosen], inputs.wind[chosen]
        pulses = inputs.pulse_table.pulses[inputs.pulse_row[chosen]]
        kept_times, kept, commands = self._acting_commands(state, times, pulses)
        reference = self.reference.advance(
            state.reference, times, estimate, fresh, commands, voltage, wind, jumped
        )
        from_model = reference.from_model
        following = self.follower.advance(
            state.follower,
            times,
            reference.references,
            (jumped & ~from_model) | reference.reset,
            voltage,
            wind,
        )
        residual_state, residuals = self.residuals.advance(
            state.residuals, times, estimate, rows.covariance[chosen], commands, voltage, wind
        )
        if False in fit.tolist():
            residuals.missing[~fit] = np.nan
        state = PathState(
            filter_state, reference.state, following.state, residual_state, kept_times, kept,
            choice.memory, sensors, outputs,
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
                reference.reset,
                residuals,
                commands,
                fit,
            ),
            rows,
        )

    def _choose(self, state: PathState, inputs: FilterInputs, rows: FilterRows) -> RowChoice:
        """Rows that go out, see `choose_rows`."""
        size, broken = len(rows), _broken(inputs, rows)
        events = rows.time_s, inputs.events.kind, inputs.complete, rows.flags, broken
        row, fresh, jumped = (
            np.empty(size, np.int64),
            np.empty(size, np.bool_),
            np.empty(size, np.bool_),
        )
        count, *memory = choose_rows(
            tuple(state.memory), events, self.min_interval_s, (row, fresh, jumped)
        )
        return RowChoice(row[:count], fresh[:count], jumped[:count], RowMemory(*memory))

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
