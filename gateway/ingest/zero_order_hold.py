"""Samples that a table repeats until the next one (zero-order hold), put back to their own times.

A receiver of 5 Hz on a grid of 10 Hz shows each fix twice; taken as it stands the boat rests every
other row. Sometimes a row slips: a fix then shows once or three times although the receiver kept
its period (the distance from fix to fix shows it). So the period is followed, row by row:

    T_k = n_k p + median (t − n p) over the fixes around    n_k periods p since the first fix

A row that slips does not move the fix: most of those around it hold the phase. Where a value
repeats because the boat stands still, the periods between count as fixes of the same place; where
it jumps afterwards, the source was silent.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from gateway.samples import Samples
from sim.state import Floats, Ints

# Chosen for receivers of 1 to 10 Hz on tables of 10 to 50 Hz; tests with held, slipping and
# resting fixes hold them (tests/gateway/ingest/test_traps.py).
FEWEST = 20  # changes of the value: fewer do not show a period
ONE_ROW = 0.3  # share of changes that come after a single row: above it nothing is held
SLIP = 0.25  # of a period, by which a fix may be early
AROUND = 51  # fixes that one phase is taken from
CATCH_UP = 0.02  # share of a fix's lateness that is the drift of the clocks
STILL = 4.0  # typical changes: a larger jump after a hold was a silence
LONGEST = 10  # rows in a period
SAME_PERIOD = 0.02  # of the rough period, by which the fitted one may differ


def undo_hold(samples: Samples) -> Samples | None:
    """One source on a grid of rows -> its values at their own times; None: nothing is held."""
    if len(samples) < FEWEST:
        return None
    time = samples.seconds(int(samples.vehicle_time_ns[0]))
    if np.any(np.diff(time) <= 0.0):
        return None
    rows = changed_rows(samples.values)
    period = hold_period(time, rows)
    if period is None:
        return None
    at, of = sample_times(time, samples.values, rows, period)
    shown = np.clip(np.searchsorted(time, at, side="left"), 0, len(time) - 1)
    moments = samples.vehicle_time_ns[0] + np.round(at * 1e9).astype(np.int64)
    late = samples.receive_time_ns[shown] - samples.vehicle_time_ns[shown]
    return replace(
        samples,
        order=samples.order[shown],
        vehicle_time_ns=moments,
        receive_time_ns=moments + late,
        values=samples.values[of],
    )


def changed_rows(values: Floats) -> Ints:
    """Values (K, n) -> rows whose value differs from that of the row before, the first included."""
    differs = np.any(values[1:] != values[:-1], axis=1)
    return np.flatnonzero(np.concatenate([[True], differs]))


def hold_period(time: Floats, rows: Ints) -> float | None:
    """Period [s] with which new values come, where that is slower than the rows."""
    steps = np.diff(rows)
    steps = steps[steps <= LONGEST]
    if len(steps) < FEWEST or np.mean(steps == 1) > ONE_ROW:
        return None
    usual = int(np.argmax(np.bincount(steps)))
    if usual < 2:
        return None
    rough = usual * float(np.median(np.diff(time)))
    number = _period_numbers(time[rows], rough)
    fine = float(np.polyfit(number, time[rows], 1)[0])
    return fine if abs(fine / rough - 1.0) < SAME_PERIOD else rough


def sample_times(time: Floats, values: Floats, rows: Ints, period: float) -> tuple[Floats, Ints]:
    """Times (n,) [s] of all periods with a fix, and the row (n,) that holds the value of each."""
    number = _period_numbers(time[rows], period)
    phase = median_filter(time[rows] - period * number, AROUND, mode="nearest")
    change = np.linalg.norm(np.diff(values[rows], axis=0), axis=1)
    still = change <= STILL * np.median(change)
    last = int((time[-1] - period * number[-1] - phase[-1]) / period + SLIP)
    ends = np.append(np.where(still, number[1:], number[:-1] + 1), number[-1] + min(last, LONGEST))
    at, of = [], []
    for first, end, offset, row in zip(number, ends, phase, rows, strict=True):
        numbers = np.arange(first, max(end, first + 1))
        at.append(offset + period * numbers)
        of.append(np.full(len(numbers), row))
    return np.concatenate(at), np.concatenate(of).astype(np.int64)


def _period_numbers(shown: Floats, period: float) -> Ints:
    """Number of the period in which each new value (n,) came, counted from the first."""
    clock, number, out = float(shown[0]), 0, [0]
    for moment in shown[1:].tolist():
        passed = max(int(np.floor((moment - clock) / period + SLIP)), 1)
        due = clock + passed * period
        clock = min(moment, due + CATCH_UP * (moment - due))
        number += passed
        out.append(number)
    return np.array(out, np.int64)
