"""Inputs of the shadow path from a log: measurements in order of receipt, with what held then.

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
from gateway.shadow.held_series import (
    HeldSeries,
    command_family,
    held_series,
    merged_channels,
    seconds,
)
from sim.state import Floats, Ints

MOTION = ("yaw", "yaw rate", "velocity", "position")  # what the filter takes, by `PRIORITY`
SILENCE_S = 0.25  # without motion for this long, ticks take over …
TICK_S = 0.1
BLIND_S = 30.0  # … for at most this long


@dataclass(frozen=True)
class FilterInputs:
    """K measurements of one boat in order of receipt.

    events           measurements of motion, and ticks
    order            (K,)      position in the log of the message that caused it
    complete         (K,)      bool: the last measurement of its message
    vehicle_time_ns  (K,)
    receive_time_ns  (K,)
    pulses           (K, 32)   latest pulse of each servo channel [µs], NaN = none or disarmed
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
    pulses: Floats
    voltage: Floats
    wind: Floats
    gps_fix: Floats
    estimator: Floats

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, part: slice) -> "FilterInputs":
        return FilterInputs(*(values[part] for values in vars(self).values()))


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
    return FilterInputs(
        events,
        order,
        np.append(np.diff(order) > 0, True) | (np.diff(vehicle, append=np.iinfo(np.int64).max) > 0),
        vehicle,
        receive,
        _pulses(decoded, choices, order),
        _latest(choices, "voltage", order, 1)[:, 0],
        _latest(choices, "wind", order, 2),
        _latest(choices, "fix", order, 1)[:, 0],
        _latest(choices, "estimator", order, 1)[:, 0],
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
    return replace(samples, quantity=Quantity.POSITION, values=to_local(samples.values, origin))


def origin_of(decoded: BoatSamples, choices: Mapping[str, Choice]) -> Origin | None:
    """The place that the metres of the chosen position source count from."""
    position = choices.get("position")
    if position is None:
        return None
    if "origin" in choices:
        return Origin(*map(float, choices["origin"].samples.values[-1]))
    places = decoded.of(Quantity.GLOBAL_POSITION)
    if position.samples.quantity is Quantity.GLOBAL_POSITION:
        return Origin(*map(float, position.samples.values[0]))
    return _origin_between(position.samples, places[0]) if places else None


def _origin_between(position: Samples, place: Samples) -> Origin:
    """The origin that explains local and global positions of the same moments."""
    guess = Origin(*map(float, place.values[0]))
    metres = to_local(place.values, guess)
    at = seconds(place.vehicle_time_ns, int(place.vehicle_time_ns[0]))
    known = held_series(position, int(place.vehicle_time_ns[0])).at(at)
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
    return _by_order(choices[name].samples).at(order)


def _by_order(samples: Samples) -> HeldSeries:
    """Values that hold from their position in the log on."""
    return HeldSeries(samples.order, samples.values)


def _pulses(decoded: BoatSamples, choices: Mapping[str, Choice], order: Ints) -> Floats:
    """Latest pulses (K, 32); none while the boat is disarmed."""
    family = command_family(decoded, choices)
    if not family:
        return np.full((len(order), CHANNELS), np.nan)
    pulses = merged_channels(family, [_by_order(samples).at(order) for samples in family])
    pulses[_latest(choices, "armed", order, 1)[:, 0] == 0.0] = np.nan
    return pulses
