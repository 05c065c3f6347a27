"""Where a recording's own sensors contradict each other: what no model may be judged by.

    frozen    the same value to the last bit for `FROZEN_S`, and meanwhile another source moved:
              heading against the integral of the gyro, gyro against the heading, velocity against
              the position, position against the integral of the velocity
    compass   the rule of the live checks (`gateway.shadow.sensor_checks`), and `SETTLE_S` after it;
              one that never comes back is believed once it has settled

Live, a value that stands still is enough. Afterwards the whole stretch is known, and a value that
rightly stands still (a table without noise on a straight leg) contradicts nothing and is kept.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.events import Events
from gateway.estimation.names import MeasurementKind
from gateway.shadow.sensor_checks import (
    CONFIRMED_S,
    FROZEN_COUNT,
    FROZEN_S,
    JUMP_HELD_S,
    MAX_YAW_GAP_S,
    SETTLE_S,
    TURNED_RAD,
    SensorFault,
    SensorMemory,
)
from sim.prediction.segments import usable_stretches
from sim.state import Floats

Bools = NDArray[np.bool_]

# All chosen, not measured: what two sources may be apart, at once and with time.
APART_M, APART_MPS = 3.0, 0.1  # a receiver wanders, an integral of velocities drifts
APART_RADPS = 0.02  # a gyro whose bias nobody took away
MAX_RADPS, MAX_MPS = 1.0, 10.0  # no more of a step counts: a jump is no motion
MAX_STEP_S = 2.0  # between two values of a source; a longer silence ends a stretch


class Track(NamedTuple):
    """One source in order of the boat's clock: time (K,) [s], values (K, n), those sent (K, n)."""

    time: Floats
    values: Floats
    sent: Floats

    def at(self, time: Floats) -> Floats:
        """(T,) s -> (T, n), on a line between its values."""
        columns = [np.interp(time, self.time, column) for column in self.values.T]
        return np.stack(columns, axis=1)

    def integral(self) -> "Track":
        """The integral of the values over time; a silence adds nothing."""
        step = np.diff(self.time)[:, None]
        step = np.where(step <= MAX_STEP_S, step, 0.0)
        mean = 0.5 * (self.values[1:] + self.values[:-1])
        start = np.zeros((1, self.values.shape[1]))
        sums = np.concatenate([start, np.cumsum(step * mean, axis=0)])
        return Track(self.time, sums, self.sent)

    def still(self) -> list[slice]:
        """Stretches in which it stands still to the last bit, without a silence."""
        same = (np.diff(self.sent, axis=0) == 0.0).all(axis=1)
        same &= np.diff(self.time) <= MAX_STEP_S
        found = [slice(start, stop + 1) for start, stop in usable_stretches(same)]
        return [
            part
            for part in found
            if part.stop - part.start > FROZEN_COUNT
            and self.time[part.stop - 1] - self.time[part.start] >= FROZEN_S
        ]


class Tolerance(NamedTuple):
    """What two sources may be apart [rad or m], that with time [1/s], and the fastest motion."""

    least: float
    drift: float
    fastest: float


def frozen(events: Events, time: Floats) -> Bools:
    """Where a source stood still though another one moved: measurements, (T,) s -> (T,)."""
    heading, turn, velocity, position = _tracks(events)
    out = np.zeros(len(time), np.bool_)
    turned, moved = turn.integral(), velocity.integral()
    angle = Tolerance(TURNED_RAD, APART_RADPS, MAX_RADPS)
    place = Tolerance(APART_M, APART_MPS, MAX_MPS)
    for source, rate, other, tolerance in (
        (heading, False, turned, angle),
        (turn, True, heading, angle),
        (velocity, True, position, place),
        (position, False, moved, place),
    ):
        for part in source.still() if len(other.time) > 1 else ():
            if _contradicted(source, part, other, rate, tolerance):
                start, end = source.time[part.start], source.time[part.stop - 1]
                out |= (time >= start) & (time <= end + SETTLE_S)
    return out


def _contradicted(
    source: Track, part: slice, other: Track, rate: bool, tolerance: Tolerance
) -> bool:
    """Did the other source move otherwise than one that stands still says?"""
    time = source.time[part]
    gone = np.diff(other.at(time), axis=0)
    if rate:
        gone -= np.diff(time)[:, None] * 0.5 * (source.values[part][1:] + source.values[part][:-1])
        for pause in other.still():  # there it is the other one that may be frozen
            start, end = other.time[pause.start], other.time[min(pause.stop, len(other.time) - 1)]
            gone[(time[1:] > start) & (time[:-1] < end)] = 0.0
    most, steps = tolerance.fastest * np.diff(time), np.linalg.norm(gone, axis=1)
    gone *= np.divide(most, steps, out=np.ones_like(steps), where=steps > most)[:, None]
    apart = np.linalg.norm(np.cumsum(gone, axis=0), axis=1)
    return bool((apart > tolerance.least + tolerance.drift * (time[1:] - time[0])).any())


def _tracks(events: Events) -> tuple[Track, Track, Track, Track]:
    """Heading without jumps at ±π, turn rate, velocity over ground (N, E), position (N, E)."""
    heading = _track(events, MeasurementKind.YAW, 1)
    heading = heading._replace(values=np.unwrap(heading.values, axis=0))
    turn = _track(events, MeasurementKind.YAW_RATE, 1)
    velocity = _track(events, MeasurementKind.VELOCITY, 2)
    body = _track(events, MeasurementKind.BODY_VELOCITY, 2)
    if len(body.time) and len(heading.time):
        psi = heading.at(body.time)[:, 0]
        u, v = body.values.T
        north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
        velocity = body._replace(values=np.stack([north, east], axis=1))
    return heading, turn, velocity, _track(events, MeasurementKind.POSITION, 2)


def _track(events: Events, kind: MeasurementKind, width: int) -> Track:
    rows = np.flatnonzero((events.kind == int(kind)) & np.isfinite(events.z).all(axis=1))
    rows = rows[np.argsort(events.time_s[rows], kind="stable")]
    values = events.z[rows, :width]
    return Track(events.time_s[rows], values, values)


def compass_jumped(events: Events, time: Floats) -> Bools:
    """Where the heading had jumped though the gyro saw no such turn: (T,) s -> (T,).

    Until it is back. One that stays is believed after `JUMP_HELD_S`; nothing happens to it then:
    here, where that is known, it is believed as soon as the autopilot's filter has settled.
    """
    unknown = np.full(len(events), np.nan)
    _, bits = SensorMemory().after(events, (unknown, unknown, np.zeros(len(events))))
    out = np.zeros(len(time), np.bool_)
    for start, stop in usable_stretches((bits & int(SensorFault.COMPASS)) > 0):
        begin, end = events.time_s[start] - CONFIRMED_S, events.time_s[stop - 1]
        stays = end - begin >= JUMP_HELD_S - 2.0 * MAX_YAW_GAP_S
        end = (begin + CONFIRMED_S if stays else end) + SETTLE_S
        out |= (time >= begin) & (time <= end)
    return out
