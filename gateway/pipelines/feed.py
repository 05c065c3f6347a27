"""A log as the live path sees it: facts in order of receipt, with what held at that moment.

Nothing here looks ahead: a row knows only what had been received by then, as it would live.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.events import KIND_OF, Events, from_samples, join, ticks
from gateway.estimation.settings import FilterSettings
from gateway.ingest.decoding import Decoded
from gateway.ingest.earth import Origin
from gateway.ingest.mapping.actuators import CHANNELS, SPAN
from gateway.ingest.sources import Choice
from gateway.pipelines.events import MOTION, command_family, local
from gateway.samples import Samples
from sim.state import Floats, Ints

SILENCE_S = 0.25  # without motion for this long, ticks take over …
TICK_S = 0.1
BLIND_S = 30.0  # … for at most this long


@dataclass(frozen=True)
class Feed:
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

    def __getitem__(self, part: slice) -> "Feed":
        return Feed(
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
    decoded: Decoded, choices: Mapping[str, Choice], origin: Origin | None, settings: FilterSettings
) -> Feed:
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
    return Feed(
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


def _pulses(decoded: Decoded, choices: Mapping[str, Choice], order: Ints) -> Floats:
    """Latest pulses (K, 32); none while the boat says that it is disarmed."""
    together = np.full((len(order), CHANNELS), np.nan)
    if "commands" in choices:
        for part in command_family(decoded, choices["commands"].samples):
            first, last = SPAN.get(part.source, (1, CHANNELS))
            together[:, first - 1 : last] = _held(part, order)[:, first - 1 : last]
    together[_latest(choices, "armed", order, 1)[:, 0] == 0.0] = np.nan
    return together
