"""Watching the model while the boat moves: missing force, and predictions that come due.

The one path from facts to shadow, shared by live and replay.

    facts → estimate → ν_ref → follower → plant → rows of every topic

State is a value and a pure function of the ordered inputs: it does not matter how they are cut
into chunks. Live gives what a datagram brought, replay a few thousand facts at a time.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.estimation.filter import Estimator, FilterRows, FilterState
from gateway.estimation.names import Flag, MeasurementKind
from gateway.estimation.settings import FilterSettings
from gateway.samples import CHANNELS as CHANNEL_COUNT
from gateway.shadow.inputs import FilterInputs
from gateway.topics import HORIZONS_S
from sim.following.follower import Follower, FollowerOptions
from sim.following.reference import Reference, ReferenceMode, ReferenceState
from sim.following.stepwise import follower_for
from sim.model import Model
from sim.state import Floats
from sim.vessel import Vessel

PREDICTION_EVERY_S = 1.0  # a free prediction starts this often
HORIZONS = np.array(HORIZONS_S, dtype=float)


@dataclass(frozen=True)
class WatchState:
    """Memory of the missing force and the predictions under way."""

    carry: Floats  # (nx + 1,)
    bank: Floats  # (S, nx + 2)
    errors: Floats  # (H, 3)


@dataclass(frozen=True)
class Watched:
    """Missing force with its standard deviation, τ(commands) (K, 3); errors (K, 3 H) of u, v, r."""

    missing: Floats
    missing_std: Floats
    commanded: Floats
    errors: Floats


@dataclass(frozen=True)
class Watch:
    """Holds the vessel's model against the estimate, row by row."""

    model: Model
    horizons: Floats = field(default_factory=lambda: HORIZONS)

    def start(self) -> WatchState:
        """Nothing seen yet."""
        slots = int(self.horizons[-1] / PREDICTION_EVERY_S) + 3
        return WatchState(
            self.model.initial_carry(),
            np.full((slots, self.model.state_size + 2), np.nan),
            np.full((len(self.horizons), 3), np.nan),
        )

    def advance(
        self,
        state: WatchState,
        times: Floats,
        motion: Floats,
        covariance: Floats,
        commands: Floats,
        voltage: Floats,
        wind: Floats,
    ) -> tuple[WatchState, Watched]:
        """Estimates (K, 9) with covariance (K, 9, 9) and commands (K, na) at times (K,) [s]."""
        after = WatchState(state.carry.copy(), state.bank.copy(), state.errors.copy())
        around = {"voltage": voltage, "wind": wind}
        missing, commanded = self.model.missing_force(
            motion, times, commands, commands, carry=after.carry, **around
        )
        spread = self.model.missing_force_std(motion, covariance, times, commands, **around)
        errors = np.empty((len(times), len(self.horizons), 3))
        self.model.kernel.module.forecast(
            self.model.theta, after.bank, after.errors, self.horizons, PREDICTION_EVERY_S, times,
            motion, commands, voltage, wind, errors,
        )  # fmt: skip
        return after, Watched(
            missing, spread, commanded, errors.reshape(len(times), 3 * len(self.horizons))
        )


STALE_S = 1.0  # without a fact for this long, telemetry is not fresh …
LOST_S = 5.0  # … nor without heading, or without velocity and position, for this long
CHANNELS = range(1, CHANNEL_COUNT + 1)
MEMORY_S = 15.0  # how far back commands are remembered, for those that act late


class News(NamedTuple):
    """When the filter last used a fact [s]: any, of heading, of velocity or position.

    After a silence the first facts mostly tell the heading alone: until all have come, the
    estimate is still the one that ran blind.
    """

    last: float = -np.inf
    heading: float = -np.inf
    motion: float = -np.inf
    back: float = -np.inf  # when the last silence ended

    def heard(self, time: float, kind: int) -> "News":
        """A fact of that kind was used."""
        return News(
            time,
            time if kind == MeasurementKind.YAW else self.heading,
            time if kind in MOTION else self.motion,
            time if time - self.last > STALE_S else self.back,
        )

    def fresh(self, time: float) -> bool:
        """Does the estimate at that time rest on what the boat says?"""
        oldest = min(self.heading, self.motion)
        return time - self.last <= STALE_S and oldest >= max(self.back, time - LOST_S)


NOTHING = News()
USED, VALID, BROKEN = int(Flag.USED), int(Flag.VALID), int(Flag.JUMP | Flag.RESTART)
MOTION = (MeasurementKind.VELOCITY, MeasurementKind.BODY_VELOCITY, MeasurementKind.POSITION)


def discontinuous(feed: FilterInputs, rows: FilterRows) -> NDArray[np.bool_]:
    """Where heading, velocity or position jumped (K,). A turn rate that does is a sharp turn."""
    return np.asarray(rows.has(Flag.JUMP) & (feed.events.kind != MeasurementKind.YAW_RATE))


def _broken(feed: FilterInputs, rows: FilterRows) -> list[bool]:
    """Where motion did not lead to the row, or the filter began anew; empty: nowhere."""
    if not (rows.flags & BROKEN).any():
        return []
    broken: list[bool] = (discontinuous(feed, rows) | rows.has(Flag.RESTART)).tolist()
    return broken


@dataclass(frozen=True)
class PathState:
    """Everything that the path remembers."""

    filter: FilterState
    reference: ReferenceState
    follower: Any
    watch: WatchState
    tape_times: Floats  # recent rows …
    tape_commands: Floats  # … and what was commanded then
    published: float = -np.inf  # time of the last row that went out [s]
    news: News = NOTHING
    jumped: bool = False  # a discontinuity since the last row that went out


@dataclass(frozen=True)
class Shadowing:
    """K rows that go out: estimate, reference and shadow (K, 9), forces (K, 3), and their times.

    row (K,) is the place of each in the chunk; `fresh` tells measured from blind rows, `bound`
    where the plant's thrust limits were hit, `jumped` where the estimate did not move but jump.
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
    bound: NDArray[np.bool_]
    watched: Watched
    commands: Floats  # (K, na)

    def __len__(self) -> int:
        return len(self.row)

    @classmethod
    def none(cls, horizons: int) -> "Shadowing":
        """No row at all."""
        number, motion, force = np.zeros(0, np.int64), np.zeros((0, 9)), np.zeros((0, 3))
        flag = np.zeros(0, np.bool_)
        return cls(
            number, np.zeros(0), number, number, motion, motion, flag, flag, motion, flag, motion,
            force, flag, Watched(force, force, force, np.zeros((0, 3 * horizons))),
            np.zeros((0, 1)),
        )  # fmt: skip


class ShadowPath:
    """Estimator, reference, follower and watch in a row. Holds settings, no state."""

    def __init__(
        self,
        model: Model,
        reference: Reference,
        follower: Follower,
        settings: FilterSettings | None = None,
        rate_hz: float = 50.0,
    ) -> None:
        self.model = model
        self.estimator = Estimator(settings)
        self.reference = reference
        self.follower = follower
        self.watch = Watch(model)
        self.shortest_s = 0.9 / rate_hz
        self._nothing = Shadowing.none(len(self.watch.horizons))
        self._commanded = lru_cache(maxsize=64)(self._commanded_by)

    @classmethod
    def of(
        cls,
        vessel: Vessel,
        plant: Vessel | None,
        settings: FilterSettings,
        *,
        reference: ReferenceMode,
        follower: FollowerOptions,
        rate_hz: float,
    ) -> "ShadowPath":
        """The path of a vessel whose shadow is that plant, by default the vessel itself."""
        model = Model.of(vessel)
        plant_model = model if plant is None else Model.of(plant)
        return cls(
            model,
            Reference(model, reference),
            follower_of(plant_model, follower),
            settings,
            rate_hz,
        )

    def start(self) -> PathState:
        """Nothing seen yet."""
        return PathState(
            self.estimator.start(),
            self.reference.start(),
            self.follower.start(),
            self.watch.start(),
            np.zeros(0),
            np.zeros((0, self.model.actuator_count)),
        )

    def advance(
        self, state: PathState, feed: FilterInputs, spend: bool = False
    ) -> tuple[PathState, Shadowing, FilterRows]:
        """Take in K facts -> the state after them, the rows that go out, the filter's rows.

        `spend`: the caller has no more use for `state`, see `Estimator.advance`.
        """
        kept, rows = self.estimator.advance(state.filter, feed.events, True, spend)
        state = replace(state, filter=kept)
        state, chosen, fresh, jumped = self._choose(state, feed, rows)
        if not len(chosen):
            return state, self._nothing, rows
        times, estimate = rows.time_s[chosen], rows.motion[chosen]
        voltage, wind = feed.voltage[chosen], feed.wind[chosen]
        state, commands = self._commands(state, times, feed.pulses[chosen])
        referred = self.reference.advance(
            state.reference, times, estimate, fresh, commands, voltage, wind, jumped
        )
        from_model = referred.from_model
        followed = self.follower.advance(
            state.follower, times, referred.references, jumped & ~from_model, voltage, wind
        )
        watch_state, watched = self.watch.advance(
            state.watch, times, estimate, rows.covariance[chosen], commands, voltage, wind
        )
        watched = replace(watched, missing=np.where(fresh[:, None], watched.missing, np.nan))
        state = replace(state, reference=referred.state, follower=followed.state, watch=watch_state)
        return (
            state,
            Shadowing(
                chosen,
                times,
                feed.vehicle_time_ns[chosen],
                feed.receive_time_ns[chosen],
                estimate,
                rows.std[chosen],
                fresh,
                jumped,
                referred.references,
                from_model,
                followed.shadows,
                followed.forces,
                followed.limited,
                watched,
                commands,
            ),
            rows,
        )

    def _choose(
        self, state: PathState, feed: FilterInputs, rows: FilterRows
    ) -> tuple[PathState, NDArray[np.int64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Which rows go out: valid, at the end of a message, not faster than the rate asked for.

        -> state, rows (K,), and for each whether telemetry is fresh and whether it jumped.
        """
        published, news, jumped = state.published, state.news, state.jumped
        kinds, complete = feed.events.kind.tolist(), feed.complete.tolist()
        flags, broken = rows.flags.tolist(), _broken(feed, rows)
        out: list[tuple[int, bool, bool]] = []
        for k, time in enumerate(rows.time_s.tolist()):
            news = news.heard(time, kinds[k]) if flags[k] & USED else news
            if broken and broken[k]:
                jumped = True
                published = min(published, time - self.shortest_s)
            if flags[k] & VALID and complete[k] and time - published >= self.shortest_s:
                out.append((k, news.fresh(time), jumped))
                published, jumped = time, False
        table = np.array(out, dtype=np.int64).reshape(-1, 3)
        state = replace(state, published=published, news=news, jumped=jumped)
        return state, table[:, 0], table[:, 1].astype(bool), table[:, 2].astype(bool)

    def _commanded_by(self, pulses: bytes) -> Floats:
        """Pulses of one row -> commands (1, na)."""
        commands = self.model.vessel.commands(CHANNELS, np.frombuffer(pulses)[np.newaxis])
        commands.flags.writeable = False
        return commands

    def _commands(
        self, state: PathState, times: Floats, pulses: Floats
    ) -> tuple[PathState, Floats]:
        """Commands (K, na) that act at each row: the latest ones, or as late as the vessel says."""
        if len(pulses) == 1:  # live: the same pulses stand for some rows
            commands = self._commanded(pulses.tobytes())
        else:
            commands = self.model.vessel.commands(CHANNELS, pulses)
        delay = self.model.delay
        if delay <= 0.0:
            return state, commands
        tape_times = np.concatenate([state.tape_times, times])
        tape = np.concatenate([state.tape_commands, commands])
        at = np.searchsorted(tape_times, times - delay, side="right") - 1
        acting = tape[np.maximum(at, 0)]
        recent = tape_times > (times[-1] if len(times) else -np.inf) - MEMORY_S
        return replace(state, tape_times=tape_times[recent], tape_commands=tape[recent]), acting


def follower_of(plant: Model, options: FollowerOptions) -> Follower:
    """Follow with that plant; one line where its thrusters cannot, and limits are asked for."""
    try:
        return follower_for(plant, options)
    except ValueError as error:
        raise BadInput(f"{plant.vessel.name}: {error}") from None
