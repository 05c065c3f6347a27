"""Values that a table repeats until the next one comes, put back to the moments they belong to.

A receiver of 5 Hz on a grid of 10 Hz shows each fix twice; taken at its word the boat stands still
every other row. Sometimes a row slips: a fix then shows once or three times although the receiver
never lost its beat (distance from fix to fix tells). So the beat is followed, row by row:

    T_k = n_k p + median (t − n p) over the fixes around    n_k beats of period p since the first

A row that slips does not move the fix: most of those around it tell where the beat is. Where a
value repeats because the boat stands still, the beats between count as fixes of the same place;
where it jumps afterwards, the source was silent.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from gateway.samples import Samples
from sim.state import Floats, Ints

FEWEST = 20  # new values: fewer do not show a beat
ONE_ROW = 0.3  # of the new values come after a single row: then nothing is held
SLIP = 0.25  # of a period, by which a fix may be early against its beat
AROUND = 51  # fixes that one phase is taken from
CATCH_UP = 0.02  # of a fix's lateness is the clocks' drift
STILL = 4.0  # typical changes: a larger jump after a hold was a silence
LONGEST = 10  # rows in a period


def retimed(samples: Samples) -> Samples | None:
    """One source on a grid of rows -> its values at their own times; None: nothing is held."""
    time = (samples.vehicle_time_ns - samples.vehicle_time_ns[0]) * 1e-9
    if len(time) < FEWEST or np.any(np.diff(time) <= 0.0):
        return None
    rows = new_rows(samples.values)
    period = beat(time, rows)
    if period is None:
        return None
    at, of = fixes(time, samples.values, rows, period)
    shown = np.clip(np.searchsorted(time, at, side="left"), 0, len(time) - 1)
    start = samples.vehicle_time_ns[0]
    moments = start + np.round(at * 1e9).astype(np.int64)
    late = samples.receive_time_ns[shown] - samples.vehicle_time_ns[shown]
    return replace(
        samples,
        order=samples.order[shown],
        vehicle_time_ns=moments,
        receive_time_ns=moments + late,
        values=samples.values[of],
    )


def new_rows(values: Floats) -> Ints:
    """Values (K, n) -> rows whose value differs from that of the row before, the first included."""
    differs = np.any(values[1:] != values[:-1], axis=1)
    return np.flatnonzero(np.concatenate([[True], differs]))


def beat(time: Floats, rows: Ints) -> float | None:
    """Period [s] with which new values come, where that is slower than the rows."""
    steps = np.diff(rows)
    steps = steps[steps <= LONGEST]
    if len(steps) < FEWEST or np.mean(steps == 1) > ONE_ROW:
        return None
    usual = int(np.argmax(np.bincount(steps)))
    if usual < 2:
        return None
    rough = usual * float(np.median(np.diff(time)))
    number = _beats(time[rows], rough)
    fine = float(np.polyfit(number, time[rows], 1)[0])
    return fine if abs(fine / rough - 1.0) < 0.02 else rough


def fixes(time: Floats, values: Floats, rows: Ints, period: float) -> tuple[Floats, Ints]:
    """Times (n,) [s] of all beats that tell something, and the row (n,) of the value of each."""
    number = _beats(time[rows], period)
    phase = median_filter(time[rows] - period * number, AROUND, mode="nearest")
    change = np.linalg.norm(np.diff(values[rows], axis=0), axis=1)
    still = change <= STILL * np.median(change)
    last = int((time[-1] - period * number[-1] - phase[-1]) / period + SLIP)
    ends = np.append(np.where(still, number[1:], number[:-1] + 1), number[-1] + min(last, LONGEST))
    at, of = [], []
    for first, end, offset, row in zip(number, ends, phase, rows, strict=True):
        beats = np.arange(first, max(end, first + 1))
        at.append(offset + period * beats)
        of.append(np.full(len(beats), row))
    return np.concatenate(at), np.concatenate(of).astype(np.int64)


def _beats(shown: Floats, period: float) -> Ints:
    """Number of the beat of each new value (n,), counted from the first."""
    clock, number, out = float(shown[0]), 0, [0]
    for moment in shown[1:].tolist():
        beats = max(int(np.floor((moment - clock) / period + SLIP)), 1)
        due = clock + beats * period
        clock = min(moment, due + CATCH_UP * (moment - due))
        number += beats
        out.append(number)
    return np.array(out, np.int64)
