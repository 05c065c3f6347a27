"""A quantity that holds until the next one comes: commands, voltage, wind, armed.

What a boat said -> what the estimator is fed, and the series that hold between messages.

A log as the live path sees it: facts in order of receipt, with what held at that moment.

Nothing here looks ahead: a row knows only what had been received by then, as it would live.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.events import KIND_OF, Events, from_samples, join, ticks
from gateway.estimation.settings import FilterSettings
from gateway.ingest.earth import Origin, to_degrees, to_local
from gateway.ingest.log import BoatSamples
from gateway.ingest.sources import Choice
from gateway.samples import CHANNELS, Quantity, Samples
from sim.state import Floats, Ints


@dataclass(frozen=True)
class Series:
    """Values that hold from their time on.

    time    (K,)    s, ascending
    values  (K, n)  NaN = not known from here on
    """

    time: Floats
    values: Floats

    def __len__(self) -> int:
        return len(self.time)

    def at(self, moments: Floats) -> Floats:
        """(T,) s -> (T, n): the values held there; NaN before the first."""
        if not len(self):
            return np.full((len(moments), self.values.shape[1]), np.nan)
        last = np.searchsorted(self.time, moments, side="right") - 1
        return np.where((last >= 0)[:, None], self.values[np.maximum(last, 0)], np.nan)

    def silence(self, moments: Floats) -> Floats:
        """(T,) s -> (T,): length of the silence around each moment [s], infinite at the ends."""
        edges = np.concatenate([[-np.inf], self.time, [np.inf]])
        after = np.searchsorted(self.time, moments, side="right")
        return np.asarray(edges[after + 1] - edges[after])

    def mean(self, edges: Floats) -> Floats:
        """(T + 1,) s -> (T, n): mean over each interval; NaN where it is unknown for half of it."""
        known = np.isfinite(self.values)
        total = _integral(self, np.where(known, self.values, 0.0), edges)
        share = _integral(self, known.astype(np.float64), edges)
        enough = share > 0.5 * np.diff(edges)[:, None]
        return np.where(enough, total / np.where(enough, share, 1.0), np.nan)


def series(samples: Samples, epoch_ns: int) -> Series:
    """Samples of one source, ordered by the boat's clock."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return Series(seconds(samples.vehicle_time_ns[order], epoch_ns), samples.values[order])


def seconds(time_ns: Ints, epoch_ns: int) -> Floats:
    """Unix ns -> s after the epoch."""
    return np.asarray((time_ns - epoch_ns) * 1e-9, np.float64)


def _integral(held: Series, values: Floats, edges: Floats) -> Floats:
    """Integral of the held values over each interval between edges: (T, n)."""
    if not len(held):
        return np.zeros((len(edges) - 1, values.shape[1]))
    knots = np.append(held.time, max(held.time[-1], edges[-1]) + 1.0)
    steps = np.diff(knots)[:, None] * values
    upto = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    columns = [np.interp(edges, knots, upto[:, i], left=0.0) for i in range(values.shape[1])]
    return np.diff(np.stack(columns, axis=1), axis=0)


MOTION = ("yaw", "yaw rate", "velocity", "position")


@dataclass(frozen=True)
class Held:
    """What holds until the next message, on one time axis.

    pulses (K, 32) µs, voltage (K, 1) V, wind (K, 2) m/s, armed (K, 1) 0 or 1, fix (K, 1)
    """

    pulses: Series
    voltage: Series
    wind: Series
    armed: Series
    fix: Series


def motion_events(
    choices: Mapping[str, Choice], origin: Origin | None, settings: FilterSettings, epoch_ns: int
) -> Events:
    """The chosen sources as events in the order of the log; positions in m from the origin."""
    columns = [local(choices[name].samples, origin) for name in MOTION if name in choices]
    return from_samples(columns, settings, epoch_ns)


def local(samples: Samples, origin: Origin | None) -> Samples:
    """Latitude and longitude as north, east about the origin; anything else unchanged."""
    if samples.quantity is not Quantity.GLOBAL_POSITION or origin is None:
        return samples
    return replace(samples, quantity=Quantity.POSITION, values=to_local(samples.values, origin))


def origin_of(decoded: BoatSamples, choices: Mapping[str, Choice]) -> Origin | None:
    """Where the metres of the chosen position source count from."""
    position = choices.get("position")
    if position is None:
        return None
    if "origin" in choices:
        return Origin(*map(float, choices["origin"].samples.values[-1]))
    places = decoded.of(Quantity.GLOBAL_POSITION)
    if position.samples.quantity is Quantity.GLOBAL_POSITION:
        return Origin(*map(float, position.samples.values[0]))
    return _origin_behind(position.samples, places[0]) if places else None


def _origin_behind(position: Samples, place: Samples) -> Origin:
    """The origin that explains local and global positions of the same moments."""
    guess = Origin(*map(float, place.values[0]))
    metres = to_local(place.values, guess)
    at = seconds(place.vehicle_time_ns, int(place.vehicle_time_ns[0]))
    known = series(position, int(place.vehicle_time_ns[0])).at(at)
    if not np.isfinite(known).any():
        return guess
    return Origin(*map(float, to_degrees(np.nanmedian(metres - known, axis=0), guess)))


def held(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> Held:
    """Commands, voltage, wind, armed, fix as series; empty where nobody said."""

    def of(name: str, width: int) -> Series:
        if name not in choices:
            return Series(np.zeros(0), np.zeros((0, width)))
        return series(choices[name].samples, epoch_ns)

    return Held(
        pulses(decoded, choices, epoch_ns),
        of("voltage", 1),
        of("wind", 2),
        _armed(of("armed", 1), choices),
        of("fix", 1),
    )


def _armed(said: Series, choices: Mapping[str, Choice]) -> Series:
    """Armed or not; a log that tells changes only was in the other state before the first one."""
    if not len(said) or not choices["armed"].samples.on_change:
        return said
    before = 1.0 - said.values[:1]
    return Series(np.concatenate([[-np.inf], said.time]), np.concatenate([before, said.values]))


def pulses(decoded: BoatSamples, choices: Mapping[str, Choice], epoch_ns: int) -> Series:
    """Pulses of all channels [µs]; ports and messages of one family speak for their channels."""
    if "commands" not in choices:
        return Series(np.zeros(0), np.zeros((0, CHANNELS)))
    family = command_family(decoded, choices["commands"].samples)
    times = np.unique(np.concatenate([part.vehicle_time_ns for part in family]))
    at = seconds(times, epoch_ns)
    together = np.full((len(times), CHANNELS), np.nan)
    for part in family:
        first, last = part.channels
        together[:, first - 1 : last] = series(part, epoch_ns).at(at)[:, first - 1 : last]
    return Series(at, together)


def command_family(decoded: BoatSamples, first: Samples) -> list[Samples]:
    """The chosen source and those that speak for other channels in the same way."""
    return [p for p in decoded.of(Quantity.ACTUATORS) if p.equivalent == first.equivalent]


SILENCE_S = 0.25  # without motion for this long, ticks take over …
TICK_S = 0.1
BLIND_S = 30.0  # … for at most this long


@dataclass(frozen=True)
class FilterInputs:
    """K facts of one boat in order of receipt.

    events           what the filter is told
    order            (K,)      position in the log of the message that caused it
    complete         (K,)      bool: the last fact of its message
    vehicle_time_ns  (K,)
    receive_time_ns  (K,)
    pulses           (K, 32)   latest pulse of each servo channel [µs], NaN = none or disarmed
    voltage          (K,)      latest battery voltage [V]
    wind             (K, 2)    latest velocity of the air [m/s]
    """

    events: Events
    order: Ints
    complete: NDArray[np.bool_]
    vehicle_time_ns: Ints
    receive_time_ns: Ints
    pulses: Floats
    voltage: Floats
    wind: Floats

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, part: slice) -> "FilterInputs":
        return FilterInputs(
            self.events[part],
            self.order[part],
            self.complete[part],
            self.vehicle_time_ns[part],
            self.receive_time_ns[part],
            self.pulses[part],
            self.voltage[part],
            self.wind[part],
        )


def feed_of(
    decoded: BoatSamples,
    choices: Mapping[str, Choice],
    origin: Origin | None,
    settings: FilterSettings,
) -> FilterInputs:
    """Everything the live path would have been told, from a decoded log."""
    columns = [local(choices[name].samples, origin) for name in MOTION if name in choices]
    columns = [samples for samples in columns if samples.quantity in KIND_OF and len(samples)]
    epoch_ns = min((int(samples.vehicle_time_ns.min()) for samples in columns), default=0)
    order, vehicle, receive, kinds = _clocks(columns)
    sequence = np.lexsort((kinds, order))
    events = from_samples(columns, settings, epoch_ns)
    events, order, vehicle, receive = _with_ticks(
        events, order[sequence], vehicle[sequence], receive[sequence], _arrivals(decoded.samples)
    )
    return FilterInputs(
        events,
        order,
        np.append(np.diff(order) > 0, True) | (np.diff(vehicle, append=np.iinfo(np.int64).max) > 0),
        vehicle,
        receive,
        _pulses(decoded, choices, order),
        _latest(choices, "voltage", order, 1)[:, 0],
        _latest(choices, "wind", order, 2),
    )


def _clocks(columns: list[Samples]) -> tuple[Ints, Ints, Ints, Ints]:
    """Order, vehicle time, receive time and kind of all facts, one column after another."""
    if not columns:
        return (np.zeros(0, np.int64),) * 4
    return (
        np.concatenate([s.order for s in columns]),
        np.concatenate([s.vehicle_time_ns for s in columns]),
        np.concatenate([s.receive_time_ns for s in columns]),
        np.concatenate([np.full(len(s), int(KIND_OF[s.quantity])) for s in columns]),
    )


def _arrivals(samples: Sequence[Samples]) -> tuple[Ints, Ints]:
    """Places in the log of all that was said, in order, and the newest receipt up to each [ns]."""
    order = np.concatenate([np.zeros(0, np.int64), *(s.order for s in samples)])
    receive = np.concatenate([np.zeros(0, np.int64), *(s.receive_time_ns for s in samples)])
    sequence = np.argsort(order, kind="stable")
    return order[sequence], np.maximum.accumulate(receive[sequence])


def _with_ticks(
    events: Events, order: Ints, vehicle: Ints, receive: Ints, arrivals: tuple[Ints, Ints]
) -> tuple[Events, Ints, Ints, Ints]:
    """Moments without any fact, so that the shadow runs on while telemetry is silent.

    A tick knows what came by then: commands may go on while nothing tells the motion.
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
    said, heard = arrivals
    known = said[np.searchsorted(heard, receive[at] + shift, side="right") - 1]
    known = np.clip(known, order[at], np.maximum(order[at], order[at + 1] - 1))
    return (
        join([events, ticks(latest[at] + step)])[place],
        np.concatenate([order, known])[place],
        np.concatenate([vehicle, newest[at] + shift])[place],
        np.concatenate([receive, receive[at] + shift])[place],
    )


def _latest(choices: Mapping[str, Choice], name: str, order: Ints, width: int) -> Floats:
    """Values (K, width) of a quantity as last received before each fact; NaN before the first."""
    if name not in choices:
        return np.full((len(order), width), np.nan)
    return _held(choices[name].samples, order)


def _held(samples: Samples, order: Ints) -> Floats:
    last = np.searchsorted(samples.order, order, side="right") - 1
    return np.where((last >= 0)[:, None], samples.values[np.maximum(last, 0)], np.nan)


def _pulses(decoded: BoatSamples, choices: Mapping[str, Choice], order: Ints) -> Floats:
    """Latest pulses (K, 32); none while the boat says that it is disarmed."""
    together = np.full((len(order), CHANNELS), np.nan)
    if "commands" in choices:
        for part in command_family(decoded, choices["commands"].samples):
            first, last = part.channels
            together[:, first - 1 : last] = _held(part, order)[:, first - 1 : last]
    together[_latest(choices, "armed", order, 1)[:, 0] == 0.0] = np.nan
    return together
