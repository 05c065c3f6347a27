"""The health topic, once a second: how well link, clocks and filter of one boat are.

A log is counted in bulk (`LogHealth`), a live link as it passes (`LiveHealth`). Rates, loss and
clock offset are those of the last `WINDOW_S`.
"""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from gateway.estimation import Flag
from gateway.estimation.filter import FilterRows
from gateway.ingest.log import BoatSamples, Log
from gateway.ingest.mavlink.log import LATE, MavlinkLog
from gateway.json_rows import TopicRows, encode
from gateway.shadow import FilterInputs
from gateway.shadow.path import ShadowRows
from gateway.shadow.sensor_checks import SensorFault, reasons_in, unfit_text
from gateway.topics import RATED
from sim.kernel.compiled import compiled
from sim.state import Ints

SECOND = 1_000_000_000  # ns
WINDOW_S = 5
WINDOW_NS = WINDOW_S * SECOND

# Sequence numbers count modulo 256: a step back by less than `late` is a late or repeated frame,
# any other one a loss. In a log no times are looked at: 32, as for `shadow info`, leaves room for
# bursts of 223 lost frames. On a live link two ways for one boat may reorder a quarter of a second,
# 128 frames of a fast link; there a frame after a silence of `LATE_WITHIN_NS` is always a new one.
LATE_IN_LOG, LATE_ON_LINK = LATE, 128
LATE_WITHIN_NS = SECOND

STEADY_S = 60.0  # without another divergence, the shadow is well again

TOO_LATE, GATED = int(Flag.REFUSED), int(Flag.GATED)
LABEL = {name: label for label, names in RATED.items() for name in names}


@dataclass
class FilterCounts:
    """Counts of filter and shadow since start; `nis` and `used` start anew with each row."""

    nis: float = 0.0
    used: int = 0
    late: int = 0
    gated: int = 0
    divergences: int = 0
    diverged_ns: int | None = None  # receipt that the last one came of
    faults: int = 0  # bits of `SensorFault` now …
    fault_ns: dict[SensorFault, int] = field(default_factory=dict)  # … and since when
    unfit_ns: int | None = None  # receipt since which the boat's data cannot judge a model

    def diverge(self, receive_ns: int) -> None:
        """The shadow left what a boat can do and began anew."""
        self.divergences += 1
        self.diverged_ns = receive_ns

    def sense(self, faults: int, receive_ns: int) -> None:
        """Set the faults that make the boat's data unfit from now on: bits of `SensorFault`."""
        now = reasons_in(faults)
        self.fault_ns = {fault: self.fault_ns.get(fault, receive_ns) for fault in now}
        self.unfit_ns = (self.unfit_ns or receive_ns) if faults else None
        self.faults = faults

    def add(
        self, rows: FilterRows, receive_time_ns: Ints, start: int = 0, end: int | None = None
    ) -> None:
        """Count rows start … end of the filter, received then (K,)."""
        end = len(rows) if end is None else end
        columns = rows.nis, rows.used, rows.flags, rows.faults
        before = self.nis, self.used, self.late, self.gated
        self.nis, self.used, self.late, self.gated, changes = count_rows(
            columns, start, end, before, self.faults
        )
        if not changes:
            return
        faults, receipts = rows.faults[start:end].tolist(), receive_time_ns[start:end].tolist()
        for bits, moment in zip(faults, receipts, strict=True):
            if bits != self.faults:
                self.sense(bits, moment)

    def row(
        self,
        now_ns: int,
        *,
        offset_ns: int,
        age_ns: int,
        received: int,
        lost: int,
        rates: Mapping[str, float],
        lateness_ns: int = 0,
        backlog: int = 0,
        drops: int = 0,
    ) -> bytes:
        """The message of a moment; `received` and `lost` frames are those of the window."""
        since = None if self.diverged_ns is None else now_ns - self.diverged_ns
        row: dict[str, float | int | str] = {
            "vehicle_time_ns": now_ns - offset_ns,
            "receive_time_ns": now_ns,
            "link_age_s": max(age_ns, 0) / SECOND,
            "rate_hz": received / WINDOW_S,
            **{f"rate_{label}_hz": rates.get(label, 0.0) for label in RATED},
            "loss": lost / max(lost + received, 1),
            "clock_offset_s": offset_ns / SECOND,
            "nis": self.nis / max(self.used, 1),
            "loop_lateness_s": lateness_ns / SECOND,
            "unfit_s": 0.0 if self.unfit_ns is None else max(now_ns - self.unfit_ns, 0) / SECOND,
            "late": self.late,
            "gated": self.gated,
            "divergences": self.divergences,
            "diverging": int(since is not None and since < STEADY_S * SECOND),
            "recorder_backlog": backlog,
            "recorder_drops": drops,
            "unfit": unfit_text(self.faults, self.fault_ns),
        }
        self.nis, self.used = 0.0, 0
        payload = encode("health", row)
        assert payload is not None
        return payload


@compiled
def count_rows(
    columns: tuple[Any, ...], start: int, end: int, before: tuple[float, int, int, int], faults: int
) -> tuple[float, int, int, int, bool]:
    """NIS, used, flags and faults (K,) of rows start … end -> the sums `nis`, `used`, `late` and
    `gated` of `FilterCounts` after them, row by row: chunks make no difference; whether the faults
    are others anywhere.
    """
    nis, used, flags, now = columns
    squares, count, late, gated = before
    changes = False
    for k in range(start, end):
        if used[k]:
            squares += nis[k]
        count += used[k]
        late += (flags[k] & TOO_LATE) != 0
        gated += (flags[k] & GATED) != 0
        changes = changes or now[k] != faults
    return squares, count, late, gated, changes


@dataclass
class LogHealth:
    """Counts a log second by second; `advance` gives the seconds that are over.

    arrivals  message name -> (K,) receive times of the boat's messages, sorted
    lost      (L,) receive times of gaps in the sequence numbers, one entry per lost frame
    stamps    (M, 2) receive and vehicle time of measurements, sorted by receipt
    """

    arrivals: dict[str, Ints]
    lost: Ints
    stamps: Ints
    second: int = -1
    counts: FilterCounts = field(default_factory=FilterCounts)
    _all: Ints = field(init=False)

    def __post_init__(self) -> None:
        times = list(self.arrivals.values())
        self._all = np.sort(np.concatenate(times)) if times else np.zeros(0, np.int64)

    @classmethod
    def of(cls, log: Log, decoded: BoatSamples) -> "LogHealth":
        """Of one boat of a log; a message of another name counts as the one that it equals."""
        arrivals: dict[str, Ints] = {}
        counts = log.counts()
        for name in counts:
            table, known = log.table(name), decoded.equivalent(name)
            label = name if known in arrivals or known in counts else known
            arrivals[label] = np.sort(table.receive_time_ns[table.sent_by(decoded.boat)])
        stamps = [np.stack([s.receive_time_ns, s.vehicle_time_ns], axis=1) for s in decoded.samples]
        both = np.concatenate(stamps) if stamps else np.zeros((0, 2), np.int64)
        return cls(arrivals, _losses(log, decoded), both[np.argsort(both[:, 0], kind="stable")])

    def advance(self, receive_time_ns: Ints, rows: FilterRows, out: ShadowRows) -> TopicRows:
        """The rows of measurements received then -> one row for each second now over."""
        diverged = out.row[out.diverged]
        seconds = receive_time_ns // SECOND
        edges = np.flatnonzero(np.diff(seconds, prepend=-1, append=-1)).tolist()
        found: list[tuple[int, int, bytes]] = []
        for start, end in pairwise(edges):  # in the order of receipt: chunks make no difference
            second = int(seconds[start])
            if self._is_over(second):
                now = second * SECOND
                offset = self._offset_ns(now)
                found.append((now - offset, now, self._row(now, offset)))
            self.counts.add(rows, receive_time_ns, start, end)
            for k in diverged[(diverged >= start) & (diverged < end)]:
                self.counts.diverge(int(receive_time_ns[k]))
        vehicle, receive = np.array([times[:2] for times in found], np.int64).reshape(-1, 2).T
        return TopicRows("health", vehicle, receive, [payload for _, _, payload in found])

    def _is_over(self, second: int) -> bool:
        """Is the second before this one over? A clock set back by long starts anew."""
        first, later = self.second < 0, second > self.second
        if first or later or second < self.second - WINDOW_S:
            self.second = second
        return later and not first

    def _row(self, now: int, offset: int) -> bytes:
        start = now - WINDOW_NS
        last = np.searchsorted(self._all, now) - 1
        rates = {
            label: sum(_between(self.arrivals[n], start, now) for n in names if n in self.arrivals)
            / WINDOW_S
            for label, names in RATED.items()
        }
        return self.counts.row(
            now,
            offset_ns=offset,
            age_ns=now - int(self._all[last]) if last >= 0 else 0,
            received=_between(self._all, start, now),
            lost=_between(self.lost, start, now),
            rates=rates,
        )

    def _offset_ns(self, now: int) -> int:
        """Receipt − boat time, the lower envelope over the window before that moment [ns]."""
        receive, vehicle = self.stamps[:, 0], self.stamps[:, 1]
        first, last = np.searchsorted(receive, [now - WINDOW_NS, now])
        return int((receive[first:last] - vehicle[first:last]).min()) if last > first else 0


def _between(times: Ints, start: int, end: int) -> int:
    return int(times.searchsorted(end) - times.searchsorted(start))


def _losses(log: Log, decoded: BoatSamples) -> Ints:
    """Receive time of every frame that the sequence numbers say is missing."""
    if not isinstance(log, MavlinkLog):
        return np.zeros(0, np.int64)
    numbers, times = log.frames.numbers, log.frames.numbers_time_ns
    mine = (numbers.system == decoded.boat.system) & (numbers.component == decoded.boat.component)
    number = numbers.sequence[mine].astype(np.int64)
    if not len(number):
        return np.zeros(0, np.int64)
    steps = (np.diff(number) + LATE_IN_LOG) % 256 - LATE_IN_LOG
    number = np.cumsum(np.append(number[0], steps))  # without wraps; late frames step back
    came = np.zeros(number.max() - number[0] + 1, np.bool_)
    came[number[number >= number[0]] - number[0]] = True
    absent = np.flatnonzero(~came) + number[0]
    noticed = np.searchsorted(np.maximum.accumulate(number), absent)
    return np.sort(times[mine][noticed])


@dataclass
class SequenceNumbers:
    """Sequence numbers of one component, as links lose, repeat and reorder them."""

    newest: int  # without wraps
    received_ns: int = 0
    missing: set[int] = field(default_factory=set)

    def note(self, sequence: int, receive_ns: int) -> int:
        """A frame's number -> how many more are lost since; −1 where a lost one came after all."""
        late = LATE_ON_LINK if receive_ns - self.received_ns < LATE_WITHIN_NS else 0
        self.received_ns = receive_ns
        step = (sequence - self.newest + late) % 256 - late
        if step <= 0:
            was_missing = self.newest + step in self.missing
            self.missing.discard(self.newest + step)
            return -1 if was_missing else 0
        self.missing |= set(range(self.newest + 1, self.newest + step))
        self.newest += step
        if len(self.missing) > LATE_ON_LINK:  # what is older never counts as late
            self.missing = {
                number for number in self.missing if number > self.newest - LATE_ON_LINK
            }
        return step - 1


@dataclass
class LiveHealth:
    """Counts what passes on a live link."""

    received_ns: int = 0  # receipt of the last frame
    frames: deque[tuple[int, str]] = field(default_factory=deque)  # receipt, name
    lost: deque[tuple[int, int]] = field(default_factory=deque)  # receipt, frames lost
    offsets: deque[tuple[int, int]] = field(default_factory=deque)  # receipt, receipt − boat time
    numbers: dict[int, SequenceNumbers] = field(default_factory=dict)  # by component
    counts: FilterCounts = field(default_factory=FilterCounts)
    offset_ns: int = 0
    lateness_ns: int = 0

    def frame(self, receive_ns: int, name: str, component: int, sequence: int) -> None:
        """A frame of the boat came in."""
        self.received_ns = receive_ns
        self.frames.append((receive_ns, name))
        self.unread(receive_ns, component, sequence)

    def unread(self, receive_ns: int, component: int, sequence: int) -> None:
        """A frame of a message without a definition: it was not lost."""
        numbers = self.numbers.setdefault(component, SequenceNumbers(sequence - 1, receive_ns))
        if lost := numbers.note(sequence, receive_ns):
            self.lost.append((receive_ns, lost))

    def filtered(self, inputs: FilterInputs, rows: FilterRows, out: ShadowRows) -> None:
        """The rows of the measurements of one message, or of several."""
        self.counts.add(rows, inputs.receive_time_ns)
        if True in out.diverged.tolist():
            for receive_ns in out.receive_time_ns[out.diverged].tolist():
                self.counts.diverge(receive_ns)
        receipts, stamps = inputs.receive_time_ns.tolist(), inputs.vehicle_time_ns.tolist()
        for k, last in enumerate(inputs.complete.tolist()):
            if last:
                self.offsets.append((receipts[k], receipts[k] - stamps[k]))

    def late_by(self, delay_ns: int) -> None:
        """So long after receipt an estimate had gone out."""
        self.lateness_ns = max(self.lateness_ns, delay_ns)

    def rebooted(self) -> None:
        """The boat numbers its frames anew: that is no loss."""
        self.numbers.clear()
        self.lost.clear()

    def rates_hz(self) -> dict[str, float]:
        """Rates at which messages came over the last seconds until the last one."""
        since = self.received_ns - WINDOW_NS  # frames are forgotten once a second: more may be kept
        counts = Counter(name for at, name in self.frames if at > since)
        return {name: count / WINDOW_S for name, count in counts.items()}

    def row(self, now_ns: int, backlog: int, drops: int) -> TopicRows:
        """The health topic at a moment; NIS and lateness start anew."""
        for window in (self.frames, self.lost, self.offsets):
            _forget(window, now_ns)
        rates = dict.fromkeys(RATED, 0.0)
        for name, rate in self.rates_hz().items():
            if name in LABEL:
                rates[LABEL[name]] += rate
        self.offset_ns = min((offset for _, offset in self.offsets), default=self.offset_ns)
        payload = self.counts.row(
            now_ns,
            offset_ns=self.offset_ns,
            age_ns=now_ns - self.received_ns,
            received=len(self.frames),
            lost=max(sum(count for _, count in self.lost), 0),
            rates=rates,
            lateness_ns=self.lateness_ns,
            backlog=backlog,
            drops=drops,
        )
        self.lateness_ns = 0
        vehicle, receive = np.array([now_ns - self.offset_ns]), np.array([now_ns])
        return TopicRows("health", vehicle, receive, [payload])


def _forget(window: deque[tuple[int, int]] | deque[tuple[int, str]], now_ns: int) -> None:
    """Drop what is older than the window, or of the time before the clock was set back."""
    while window and not now_ns - WINDOW_NS <= window[0][0] <= now_ns + SECOND:
        window.popleft()
