"""Stretches of a recording that it held before: appended a second time, they would count twice.

Every interval would be too narrow by the square root of two, every validation too good. A boat may
sail the same track twice, but no sensor reads the same noise twice: a stretch is repeated where
heading and motion both run through the same values, to the last bit and in the same order, as in an
earlier session. A sensor that stands still tells nothing of that.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from gateway.ingest.sources import Choice
from gateway.samples import Samples
from sim.prediction.segments import usable_stretches
from sim.state import Floats

# All chosen.
RUN, MIN_CHANGES = 20, 5  # rows of a pattern, and how often the value changes in one that tells
MIN_ROWS, MIN_S = 25, 5.0  # of a stretch
MERGE_NS = 5_000_000_000  # between two of them nothing moved

HASH = np.uint64(6_364_136_223_846_793_005)  # odd and large: sums wrap and spread

Spans = list[tuple[int, int]]  # vehicle time [ns]


def repeated_spans(choices: Mapping[str, Choice], sessions: Sequence[tuple[int, int]]) -> Spans:
    """Spans [ns of the vehicle's clock] in which a recording holds what an earlier session held."""
    motion = next((choices[name] for name in ("velocity", "position") if name in choices), None)
    if len(sessions) < 2 or motion is None or "yaw" not in choices:
        return []
    starts = np.array([start for start, _ in sessions], np.int64)
    headings, motions = (_spans(one.samples, starts) for one in (choices["yaw"], motion))
    both = [(max(a, c), min(b, d)) for a, b in headings for c, d in motions]
    return sorted((a, b) for a, b in both if a < b)


def repeated_notice(spans: Spans, sessions: Sequence[tuple[int, int]]) -> tuple[str, ...]:
    """That something is there twice; empty where nothing is."""
    if not spans:
        return ()
    seconds = sum(end - start for start, end in spans) * 1e-9
    since = (spans[0][0] - sessions[0][0]) * 1e-9
    return (
        f"{seconds:.0f} s of it are there twice, from {since:.0f} s on: they are the same "
        "measurements as before, and are counted once",
    )


def _spans(samples: Samples, starts: np.ndarray) -> Spans:
    """Where the values of one source run as in an earlier session."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    time, values = samples.vehicle_time_ns[order], samples.values[order]
    if len(values) < MIN_ROWS + RUN:
        return []
    pattern, telling = _patterns(values)
    first, which = np.unique(pattern, return_index=True, return_inverse=True)[1:]
    before = first[which.reshape(-1)]  # where each pattern was first
    session = np.searchsorted(starts, time[: len(before)], side="right")
    again = telling & (session[before] < session)
    goes_on = again[:-1] & again[1:] & (np.diff(before) == 1)
    out: Spans = []
    for start, stop in usable_stretches(goes_on):
        if stop - start < MIN_ROWS or (time[stop] - time[start]) * 1e-9 < MIN_S:
            continue
        span = int(time[start]), int(time[min(stop + RUN - 1, len(time) - 1)])
        if out and span[0] - out[-1][1] < MERGE_NS:
            span = out.pop()[0], span[1]
        out.append(span)
    return out


def _patterns(values: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Values (K, n) -> a number for the `RUN` rows from each row on, and whether they tell."""
    row = np.unique(values, axis=0, return_inverse=True)[1].reshape(-1).astype(np.uint64)
    count, number = len(row) - RUN + 1, np.zeros(len(row) - RUN + 1, np.uint64)
    for k in range(RUN):
        number = number * HASH + row[k : k + count]
    changed = np.concatenate([[0], np.cumsum(np.diff(row) != 0)])
    return number, changed[RUN - 1 :] - changed[:count] >= MIN_CHANGES
