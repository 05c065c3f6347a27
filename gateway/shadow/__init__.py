"""The path from facts to the topics of a shadow, shared by live and replay: here, its inputs.

Inputs of the shadow path from a log: measurements in order of receipt, with what held then.

Commands, voltage, wind, armed and fix hold until the next message. Nothing here looks ahead: a row
knows only what had been received by then, as it would live.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation import FilterSettings
from gateway.estimation.events import KIND_OF, Events, from_samples, join, ticks
from gateway.ingest.log import BoatSamples
from gateway.ingest.mapping import Origin, credible, in_local_frame, to_degrees, to_local
from gateway.ingest.sources import Choice
from gateway.samples import CHANNELS, Quantity, Samples
from sim.state import Floats, Ints


@dataclass(frozen=True)
class HeldSeries:
    """Values that hold from their time on.

    time    (K,)    s (or position in the log), ascending
    values  (K, n)  NaN = not known from here on
    """

    time: NDArray[np.float64] | Ints
    values: Floats

    def __len__(self) -> int:
        return len(self.time)

    def at(self, moments: NDArray[np.float64] | Ints) -> Floats:
        """(T,) moments -> (T, n): the values held there; NaN before the first."""
        if not len(self):
            return np.full((len(moments), self.values.shape[1]), np.nan)
        last = np.searchsorted(self.time, moments, side="right") - 1
        values = self.values[np.maximum(last, 0)]
        values[last < 0] = np.nan
        return values

    def silence(self, moments: Floats) -> Floats:
        """(T,) s -> (T,): length of the silence around each moment [s], infinite at the ends."""
        edges = np.concatenate([[-np.inf], self.time, [np.inf]])
        after = np.searchsorted(self.time, moments, side="right")
        return np.asarray(edges[after + 1] - edges[after])

    def mean(self, edges: Floats) -> Floats:
        """(T + 1,) s -> (T, n): mean over each interval; NaN where it is unknown for half of it."""
        known = np.isfinite(self.values)
        total = self._integral(np.where(known, self.values, 0.0), edges)
        share = self._integral(known.astype(np.float64), edges)
        enough = share > 0.5 * np.diff(edges)[:, None]
        return np.where(enough, total / np.where(enough, share, 1.0), np.nan)

    def _integral(self, values: Floats, edges: Floats) -> Floats:
        """Integral of held values (K, n) over each interval between edges: (T, n)."""
        if not len(self):
            return np.zeros((len(edges) - 1, values.shape[1]))
        knots = np.append(self.time, max(self.time[-1], edges[-1]) + 1.0)
        steps = np.diff(knots)[:, None] * values
        upto = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
        columns = [np.interp(edges, knots, upto[:, i], left=0.0) for i in range(values.shape[1])]
        return np.diff(np.stack(columns, axis=1), axis=0)


def held_series(samples: Samples, epoch_ns: int) -> HeldSeries:
    """Samples of one source, ordered by the boat's clock."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return HeldSeries(seconds(samples.vehicle_time_ns[order], epoch_ns), samples.values[order])


def seconds(time_ns: Ints, epoch_ns: int) -> Floats:
    """Unix ns -> s after the epoch."""
    return np.asarray((time_ns - epoch_ns) * 1e-9, np.float64)


@dataclass(frozen=True)
class HeldInputs:
    """The inputs of a log that hold until the next message, on one time axis.

    pulses (K, 32) µs, voltage (K, 1) V, wind (K, 2) m/s, armed (K, 1) 0 or 1, fix (K, 1),
    estimator (K, 1) bits of `EstimatorFault`
    """

    pulses: HeldSeries
    voltage: HeldSeries
    wind: HeldSeries
    armed: HeldSeries
    fix: HeldSeries
    estimator: HeldSeries


def held_inputs(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> HeldInputs:
    """Of each quantity the chosen source; empty where the log has none."""

    def of(name: str, width: int) -> HeldSeries:
        if name not in choices:
            return HeldSeries(np.zeros(0), np.zeros((0, width)))
        return held_series(credible(choices[name].samples), epoch_ns)

    return HeldInputs(
        _held_pulses(decoded, choices, epoch_ns),
        of("voltage", 1),
        of("wind", 2),
        _armed(of("armed", 1), choices),
        of("fix", 1),
        of("estimator", 1),
    )


def _armed(series: HeldSeries, choices: Mapping[str, Choice]) -> HeldSeries:
    """Armed or not; before the first of the changes that some logs write, it was the other."""
    if not len(series) or not choices["armed"].samples.on_change:
        return series
    values = np.concatenate([1.0 - series.values[:1], series.values])
    return HeldSeries(np.concatenate([[-np.inf], series.time]), values)


def _held_pulses(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> HeldSeries:
    """Pulses of all channels [µs], on the times of all messages that report some."""
    family = command_family(decoded, choices)
    if not family:
        return HeldSeries(np.zeros(0), np.zeros((0, CHANNELS)))
    times = seconds(np.unique(np.concatenate([s.vehicle_time_ns for s in family])), epoch_ns)
    parts = [held_series(samples, epoch_ns) for samples in family]
    return HeldSeries(times, merged_channels(family, [part.at(times) for part in parts]))


def command_family(decoded: BoatSamples, choices: Mapping[str, Choice]) -> list[Samples]:
    """The chosen source of commands and those that report other channels in the same way."""
    if "commands" not in choices:
        return []
    chosen = choices["commands"].samples.equivalent
    return [p for p in decoded.of(Quantity.ACTUATORS) if p.equivalent == chosen]


def merged_channels(family: list[Samples], pulses: list[Floats]) -> Floats:
    """Pulses (K, 32) of each source -> those of the channels that it reports: (K, 32)."""
    merged = np.full(pulses[0].shape, np.nan)
    for samples, part in zip(family, pulses, strict=True):
        first, last = samples.channels
        merged[:, first - 1 : last] = part[:, first - 1 : last]
    return merged


MOTION = ("yaw", "yaw rate", "velocity", "position")  # what the filter takes, by `PRIORITY`
SILENCE_S = 0.25  # without motion for this long, ticks take over …
TICK_S = 0.1
BLIND_S = 30.0  # … for at most this long


TABLE = "pulse_table"  # of `FilterInputs`: no column


NEVER = -np.inf  # no message told of it


class PulseTable(NamedTuple):
    """pulses (S, 32) of each servo channel [µs], NaN = none; active (S,): 1 where any has one;
    heard (S,): receipt of the message that told of them [s], −inf where none ever did, NaN where
    none has to: the boat is disarmed, or a table holds values until they change.
    """

    pulses: Floats
    active: Floats
    heard: Floats

    @classmethod
    def of(cls, pulses: Floats, heard: Floats) -> "PulseTable":
        """Pulses (S, 32) [µs], and when they were told of (S,)."""
        return cls(pulses, np.asarray(np.isfinite(pulses).any(axis=1), np.float64), heard)

    @classmethod
    def joined(cls, tables: Sequence["PulseTable"]) -> "PulseTable":
        """The rows of several, one table after another."""
        if len(tables) == 1:
            return tables[0]
        return cls(*(np.concatenate(column) for column in zip(*tables, strict=True)))


@dataclass(frozen=True)
class FilterInputs:
    """K measurements of one boat in order of receipt.

    events           measurements of motion, and ticks
    order            (K,)      position in the log of the message that caused it
    complete         (K,)      bool: the last measurement of its message
    vehicle_time_ns  (K,)
    receive_time_ns  (K,)
    pulse_row        (K,)      row of `pulse_table` that holds
    pulse_table      `PulseTable` of all of them: of an hour, pulses row by row take 200 MB
    voltage          (K,)      latest battery voltage [V]
    wind             (K, 2)    latest velocity of the air [m/s]
    gps_fix          (K,)      latest GNSS fix type, NaN = none was reported
    estimator        (K,)      latest bits of `EstimatorFault`, NaN = none were reported
    """

    events: Events
    order: Ints
    complete: NDArray[np.bool_]
    vehicle_time_ns: Ints
    receive_time_ns: Ints
    pulse_row: Ints
    voltage: Floats
    wind: Floats
    gps_fix: Floats
    estimator: Floats
    pulse_table: PulseTable

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, part: slice) -> "FilterInputs":
        columns = {name: values[part] for name, values in vars(self).items() if name != TABLE}
        return FilterInputs(**columns, pulse_table=self.pulse_table)

    @classmethod
    def joined(cls, parts: Sequence["FilterInputs"]) -> "FilterInputs":
        """The measurements of several messages, one after another."""
        if len(parts) == 1:
            return parts[0]
        tables, rows = list[PulseTable](), list[Ints]()
        count = 0  # of rows in the tables before the latest one
        for part in parts:  # many share a table, those that follow one another
            if not tables or tables[-1] is not part.pulse_table:
                count += len(tables[-1].active) if tables else 0
                tables.append(part.pulse_table)
            rows.append(part.pulse_row + count)
        columns = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in vars(parts[0])
            if name not in ("events", "pulse_row", TABLE)
        }
        return cls(
            events=join([part.events for part in parts]), pulse_row=np.concatenate(rows),
            pulse_table=PulseTable.joined(tables), **columns,
        )  # fmt: skip

    @property
    def pulses(self) -> Floats:
        """Latest pulse of each servo channel (K, 32) [µs], NaN = none or disarmed."""
        return self.pulse_table.pulses[self.pulse_row]

    @property
    def active(self) -> Floats:
        """Whether any channel has a pulse (K,): 1 or 0."""
        return self.pulse_table.active[self.pulse_row]

    @property
    def heard(self) -> Floats:
        """When outputs were last told of (K,) [s], as in `PulseTable`."""
        return self.pulse_table.heard[self.pulse_row]


def filter_inputs_of(
    decoded: BoatSamples,
    choices: Mapping[str, Choice],
    origin: Origin | None,
    settings: FilterSettings,
) -> FilterInputs:
    """All inputs that the path would have had live, from a decoded log."""
    columns = [s for s in _motion_columns(choices, origin) if s.quantity in KIND_OF and len(s)]
    epoch_ns = min((int(samples.vehicle_time_ns.min()) for samples in columns), default=0)
    order, vehicle, receive, kinds = _clocks(columns)
    sequence = np.lexsort((kinds, order))
    events = from_samples(columns, settings, epoch_ns)
    events, order, vehicle, receive = _with_ticks(
        events, order[sequence], vehicle[sequence], receive[sequence], _arrivals(decoded.samples)
    )
    table, pulse_row = _latest_pulses(decoded, choices, order)
    return FilterInputs(
        events,
        order,
        np.append(np.diff(order) > 0, True) | (np.diff(vehicle, append=np.iinfo(np.int64).max) > 0),
        vehicle,
        receive,
        pulse_row,
        _latest(choices, "voltage", order, 1)[:, 0],
        _latest(choices, "wind", order, 2),
        _latest(choices, "fix", order, 1)[:, 0],
        _latest(choices, "estimator", order, 1)[:, 0],
        table,
    )


def motion_events(
    choices: Mapping[str, Choice], origin: Origin | None, settings: FilterSettings, epoch_ns: int
) -> Events:
    """The chosen sources as events in the order of the log; positions in m from the origin."""
    return from_samples(_motion_columns(choices, origin), settings, epoch_ns)


def _motion_columns(choices: Mapping[str, Choice], origin: Origin | None) -> list[Samples]:
    return [_in_metres(choices[name].samples, origin) for name in MOTION if name in choices]


def _in_metres(samples: Samples, origin: Origin | None) -> Samples:
    """Latitude and longitude as north, east about the origin; anything else unchanged."""
    if samples.quantity is not Quantity.GLOBAL_POSITION or origin is None:
        return samples
    places = credible(samples)
    return replace(places, quantity=Quantity.POSITION, values=to_local(places.values, origin))


def origin_of(decoded: BoatSamples, choices: Mapping[str, Choice]) -> Origin | None:
    """The place that the metres of the chosen position source count from."""
    position = choices.get("position")
    if position is None:
        return None
    if "origin" in choices and len(told := credible(choices["origin"].samples)):
        return Origin(*map(float, told.values[-1]))
    if position.samples.quantity is Quantity.GLOBAL_POSITION:
        own = credible(position.samples)
        return Origin(*map(float, own.values[0])) if len(own) else None
    others = decoded.of(Quantity.GLOBAL_POSITION)
    places = credible(others[0]) if others else ()
    return _origin_between(position.samples, places) if places else None


def _origin_between(position: Samples, place: Samples) -> Origin:
    """The origin that explains local and global positions of the same moments."""
    guess = Origin(*map(float, place.values[0]))
    metres = to_local(place.values, guess)
    at = seconds(place.vehicle_time_ns, int(place.vehicle_time_ns[0]))
    reached = position.where(in_local_frame(*position.values.T))
    known = held_series(reached, int(place.vehicle_time_ns[0])).at(at)
    if not np.isfinite(known).any():
        return guess
    return Origin(*map(float, to_degrees(np.nanmedian(metres - known, axis=0), guess)))


def _clocks(columns: list[Samples]) -> tuple[Ints, Ints, Ints, Ints]:
    """Order, vehicle time, receive time and kind of all measurements, one column after another."""
    if not columns:
        return (np.zeros(0, np.int64),) * 4
    return (
        np.concatenate([s.order for s in columns]),
        np.concatenate([s.vehicle_time_ns for s in columns]),
        np.concatenate([s.receive_time_ns for s in columns]),
        np.concatenate([np.full(len(s), int(KIND_OF[s.quantity])) for s in columns]),
    )


def _arrivals(samples: Sequence[Samples]) -> tuple[Ints, Ints]:
    """Positions in the log of all samples, in order, and the newest receipt up to each [ns]."""
    order = np.concatenate([np.zeros(0, np.int64), *(s.order for s in samples)])
    receive = np.concatenate([np.zeros(0, np.int64), *(s.receive_time_ns for s in samples)])
    sequence = np.argsort(order, kind="stable")
    return order[sequence], np.maximum.accumulate(receive[sequence])


def _with_ticks(
    events: Events, order: Ints, vehicle: Ints, receive: Ints, arrivals: tuple[Ints, Ints]
) -> tuple[Events, Ints, Ints, Ints]:
    """Add moments without any measurement, so that the shadow runs on while telemetry is silent.

    A tick knows what came by then: commands may go on while nothing measures the motion.
    """
    latest = np.maximum.accumulate(events.time_s) if len(events) else events.time_s
    gaps = np.flatnonzero(np.diff(latest) > SILENCE_S)
    after, ahead = [np.zeros(0, np.int64)], [np.zeros(0)]
    for gap in gaps:
        end = min(latest[gap + 1] - latest[gap] - 0.5 * TICK_S, BLIND_S)
        moments = np.arange(SILENCE_S, end, TICK_S)
        after.append(np.full(len(moments), gap))
        ahead.append(moments)
    at, step = np.concatenate(after), np.concatenate(ahead)
    place = np.argsort(
        np.concatenate([np.arange(len(events)), at + step / (2.0 * BLIND_S) + 0.1]), kind="stable"
    )
    shift = np.round(step * 1e9).astype(np.int64)
    newest = np.maximum.accumulate(vehicle) if len(vehicle) else vehicle
    positions, receipts = arrivals
    known = positions[np.searchsorted(receipts, receive[at] + shift, side="right") - 1]
    known = np.clip(known, order[at], np.maximum(order[at], order[at + 1] - 1))
    return (
        join([events, ticks(latest[at] + step)])[place],
        np.concatenate([order, known])[place],
        np.concatenate([vehicle, newest[at] + shift])[place],
        np.concatenate([receive, receive[at] + shift])[place],
    )


def _latest(choices: Mapping[str, Choice], name: str, order: Ints, width: int) -> Floats:
    """Values (K, width) as last received before each measurement; NaN before the first."""
    if name not in choices:
        return np.full((len(order), width), np.nan)
    return _by_order(credible(choices[name].samples)).at(order)


def _by_order(samples: Samples) -> HeldSeries:
    """Values that hold from their position in the log on."""
    return HeldSeries(samples.order, samples.values)


def _latest_pulses(
    decoded: BoatSamples, choices: Mapping[str, Choice], order: Ints
) -> tuple[PulseTable, Ints]:
    """Pulses, and the row (K,) of those that hold at each position in the log.

    The first row has none, before the first message, nor has the last, while the boat is disarmed.
    """
    none, family = np.full((1, CHANNELS), np.nan), command_family(decoded, choices)
    changes, pulses, heard = np.zeros(0, np.int64), none[:0], np.zeros(0)
    if family:
        changes, times = (
            np.concatenate([getattr(samples, column) for samples in family])
            for column in ("order", "receive_time_ns")
        )
        sequence = np.argsort(changes, kind="stable")
        changes, heard = changes[sequence], times[sequence] * 1e-9
        pulses = merged_channels(family, [_by_order(samples).at(changes) for samples in family])
    row = np.searchsorted(changes, order, side="right")
    row[_latest(choices, "armed", order, 1)[:, 0] == 0.0] = len(changes) + 1
    told = np.concatenate([[NEVER], heard, [np.nan]])
    if decoded.tabular:
        told[:] = np.nan
    return PulseTable.of(np.concatenate([none, pulses, none]), told), row
