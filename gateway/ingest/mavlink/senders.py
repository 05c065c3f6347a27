"""Several senders under one id: the sequence numbers of that source run in several series at once.

A sender counts its frames, 0 … 255. Of two that share an id, or of one that is heard over two of
its links, the numbers leap to and fro between two series: read as one, hundreds are "lost" between
any two frames. Each frame belongs to the series that it continues with the fewest frames missing.

Two links of one boat tell of one motion and one clock, two boats do not: see `two_boats`.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.log import Boat, BoatSamples, Log, log_start_ns
from gateway.ingest.mapping import Origin, to_local
from gateway.ingest.mavlink.frames import Headers
from gateway.ingest.mavlink.mapping import SENT_BY_BOATS
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

# All chosen: two boats in one log lost 17 frames for each that came; a poor radio loses a third.
MIN_FRAMES = 100  # of a source: fewer tell no series
MIN_LOST = 0.25  # of the frames: what loses less has one sender
FEWER = 0.1  # of what is lost in one series may be lost in several …
MAX_LOST = 0.5  # … and of the frames: what leaves more is no series, but frames out of order
MIN_CHANGES = 0.02  # of the frames come from another sender than the one before
MOST_SENDERS = 4
NEAR = 32  # numbers: a frame that is further ahead of all series begins another one
MIN_SHARE = 0.1  # of messages without a possible time, or of steps that no boat makes
FASTEST_MPS, JUMP_M = 50.0, 5.0


SeveralSenders = Mapping[tuple[int, int], tuple[int, int]]


def series_of(headers: Headers) -> SeveralSenders:
    """Sources (system, component) of several senders -> how many they are, frames lost of all."""
    source = headers.system.astype(np.int64) * 256 + headers.component
    out = {}
    for number in np.flatnonzero(np.bincount(source, minlength=1) >= MIN_FRAMES):
        found = _senders(headers.sequence[source == number])
        if found is not None:
            out[int(number) // 256, int(number) % 256] = found
    return out


def _senders(sequence: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Numbers (K,) in order of receipt -> senders and frames lost; None where there is one."""
    numbers = sequence.astype(np.int64)
    as_one = int(((numbers[1:] - numbers[:-1] - 1) & 0xFF).sum())
    if as_one < MIN_LOST * len(sequence):
        return None
    for count in range(2, MOST_SENDERS + 1):
        lost, changes = _in_series(sequence.tolist(), count)
        whole = lost <= MAX_LOST * len(sequence)
        if whole and lost <= FEWER * as_one and changes >= MIN_CHANGES * len(sequence):
            return count, lost
    return None


def _in_series(numbers: list[int], count: int) -> tuple[int, int]:
    """Numbers that run in so many series -> frames lost, changes from one series to another.

    A boat that has booted again changes once.
    """
    expected, lost, changes, last = list[int](), 0, 0, 0
    for number in numbers:
        gaps = [(number - one) & 0xFF for one in expected]
        nearest = min(range(len(gaps)), key=gaps.__getitem__, default=-1)
        if len(expected) < count and (nearest < 0 or gaps[nearest] >= NEAR):
            nearest = len(expected)
            expected.append(number)
        else:
            lost += gaps[nearest]
        changes, last = changes + (nearest != last), nearest
        expected[nearest] = (number + 1) & 0xFF
    return lost, changes


def senders_notice(boat: Boat, decoded: BoatSamples, senders: int) -> tuple[str, ...]:
    """That several boats share an id, where their clocks or places show that they are several."""
    if senders < 2 or not two_boats(decoded):
        return ()
    return (
        f"{senders} senders share system id {boat.system}: what they say is mixed, and nothing "
        "here is the motion of one boat; give each boat an id of its own (SYSID_THISMAV, "
        "MAV_SYS_ID) and record again, or take logs that the boats wrote on board",
    )


def two_boats(decoded: BoatSamples) -> bool:
    """Whether the clock runs to and fro, or the place leaps as no boat does."""
    placed = sum(map(len, decoded.samples))
    if decoded.clock.unplaced > MIN_SHARE * (placed + decoded.clock.unplaced):
        return True
    places = (*decoded.of(Quantity.GLOBAL_POSITION), *decoded.of(Quantity.POSITION))
    return any(_leaps(one) > MIN_SHARE for one in places if len(one) >= MIN_FRAMES)


def _leaps(samples: Samples) -> float:
    """Share of the steps from place to place that are too far for their time."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    place: Floats = samples.values[order, :2]
    if samples.quantity is Quantity.GLOBAL_POSITION:
        place = to_local(place, Origin(*map(float, np.nanmedian(place, axis=0))))
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    return float(np.mean(steps > JUMP_M + FASTEST_MPS * np.diff(samples.seconds()[order])))


def motion_of(log: Log, boat: Boat) -> Ints:
    """Receipt [ns] of all that one component tells of its motion, in ascending order."""
    tables = [log.table(name) for name in SENT_BY_BOATS]
    return np.sort(np.concatenate([t.receive_time_ns[t.sent_by(boat)] for t in tables]))


def components_notice(log: Log, boat: Boat) -> tuple[str, ...]:
    """That other components of the boat's system tell of motion too, which is not read.

    A component id that is set otherwise makes two halves of one voyage.
    """
    out = list[str]()
    for other in log.boats():
        if other.system != boat.system or other.component == boat.component:
            continue
        told = motion_of(log, other)
        if len(told) >= MIN_FRAMES:
            since, until = (told[[0, -1]] - log_start_ns(log)) * 1e-9  # decodes the whole log
            out.append(
                f"component {other.component} of system {other.system} tells of motion too, from "
                f"{since:.0f} to {until:.0f} s: it is taken for another vehicle, and what is read "
                f"here is component {boat.component} alone"
            )
    return tuple(out)
