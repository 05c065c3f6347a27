"""What a boat said -> what the estimator is fed, and the series that hold between messages."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gateway.estimation.events import Events, from_samples
from gateway.estimation.settings import FilterSettings
from gateway.ingest.decoding import Decoded
from gateway.ingest.earth import Origin, to_degrees, to_local
from gateway.ingest.mapping.actuators import CHANNELS, SPAN
from gateway.ingest.sources import Choice
from gateway.pipelines.series import Series, seconds, series
from gateway.samples import Quantity, Samples

MOTION = ("yaw", "yaw rate", "velocity", "position")
ON_CHANGE = ("ARM", "EV")  # written when the state changes: before the first, it was the other


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


def origin_of(decoded: Decoded, choices: Mapping[str, Choice]) -> Origin | None:
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


def held(decoded: Decoded, choices: Mapping[str, Choice], epoch_ns: int) -> Held:
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
    if not len(said) or choices["armed"].source not in ON_CHANGE:
        return said
    before = 1.0 - said.values[:1]
    return Series(np.concatenate([[-np.inf], said.time]), np.concatenate([before, said.values]))


def pulses(decoded: Decoded, choices: Mapping[str, Choice], epoch_ns: int) -> Series:
    """Pulses of all channels [µs]; ports and messages of one family speak for their channels."""
    if "commands" not in choices:
        return Series(np.zeros(0), np.zeros((0, CHANNELS)))
    family = command_family(decoded, choices["commands"].samples)
    times = np.unique(np.concatenate([part.vehicle_time_ns for part in family]))
    at = seconds(times, epoch_ns)
    together = np.full((len(times), CHANNELS), np.nan)
    for part in family:
        first, last = SPAN.get(part.source, (1, CHANNELS))
        together[:, first - 1 : last] = series(part, epoch_ns).at(at)[:, first - 1 : last]
    return Series(at, together)


def command_family(decoded: Decoded, first: Samples) -> list[Samples]:
    """The chosen source and those that speak for other channels in the same way."""
    stem = "RCO" if first.source.startswith("RCO") else first.source
    return [part for part in decoded.of(Quantity.ACTUATORS) if part.source.startswith(stem)]
