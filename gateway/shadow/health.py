"""Once a second: how well link, clocks and filter are. Rows of the health topic.

Health of a live link: what passed in the last seconds, counted as it passes.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gateway.estimation.filter import FilterRows
from gateway.estimation.names import Flag
from gateway.ingest.log import BoatSamples, Log
from gateway.ingest.mavlink.frames import LATE
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.json_rows import TopicRows, encode
from gateway.topics import RATED
from sim.state import Ints

SECOND = 1_000_000_000
WINDOW_S = 5  # rates, loss and clock offset are those of the last seconds


@dataclass
class HealthMeter:
    """Counts what passed second by second; `advance` hands out the seconds that are over.

    arrivals  message name -> (K,) receive times of the boat's messages, sorted
    lost      (L,) receive times of gaps in the sequence numbers, one entry per lost frame
    stamps    (M, 2) receive and vehicle time of facts, sorted by receipt
    """

    arrivals: dict[str, Ints]
    lost: Ints
    stamps: Ints
    second: int = -1
    nis: float = 0.0
    used: int = 0
    late: int = 0
    gated: int = 0
    _all: Ints = field(init=False)

    def __post_init__(self) -> None:
        times = list(self.arrivals.values())
        self._all = np.sort(np.concatenate(times)) if times else np.zeros(0, np.int64)

    @classmethod
    def of_log(cls, log: Log, decoded: BoatSamples) -> "HealthMeter":
        """What a log tells of one boat; a message of another name counts as the one it equals."""
        arrivals: dict[str, Ints] = {}
        counts = log.counts()
        for name in counts:
            table, known = log.table(name), decoded.equivalent(name)
            label = name if known in arrivals or known in counts else known
            arrivals[label] = np.sort(table.receive_time_ns[table.sent_by(decoded.boat)])
        stamps = [np.stack([s.receive_time_ns, s.vehicle_time_ns], axis=1) for s in decoded.samples]
        both = np.concatenate(stamps) if stamps else np.zeros((0, 2), np.int64)
        return cls(arrivals, _losses(log, decoded), both[np.argsort(both[:, 0], kind="stable")])

    def advance(self, receive_time_ns: Ints, rows: FilterRows) -> TopicRows:
        """What the filter said of facts received then -> one row for each second now over."""
        seconds = receive_time_ns // SECOND
        edges = np.flatnonzero(np.diff(seconds, prepend=-1, append=-1)).tolist()
        out: list[tuple[int, bytes]] = []
        for start, end in pairwise(edges):  # in the order of receipt: chunks make no difference
            second = int(seconds[start])
            if self._over(second):
                out.append((second * SECOND, self._row(second * SECOND)))
                self.nis, self.used = 0.0, 0
            self._count(rows, slice(start, end))
        times = np.array([time for time, _ in out], np.int64)
        return TopicRows("health", times - self._offset_ns(times), times, [row for _, row in out])

    def _over(self, second: int) -> bool:
        """Is the second before this one over? A clock set back by long starts anew."""
        first, later = self.second < 0, second > self.second
        if first or later or second < self.second - WINDOW_S:
            self.second = second
        return later and not first

    def _count(self, rows: FilterRows, mine: slice) -> None:
        for nis in rows.nis[mine][rows.used[mine] > 0].tolist():
            self.nis += nis
        self.used += int(rows.used[mine].sum())
        self.late += int(np.count_nonzero(rows.has(Flag.REFUSED)[mine]))
        self.gated += int(np.count_nonzero(rows.has(Flag.GATED)[mine]))

    def _row(self, now: int) -> bytes:
        start = now - WINDOW_S * SECOND
        heard = _between(self._all, start, now)
        lost = _between(self.lost, start, now)
        last = np.searchsorted(self._all, now) - 1
        numbers = {
            "link_age_s": (now - int(self._all[last])) / SECOND if last >= 0 else 0.0,
            "rate_hz": heard / WINDOW_S,
            **{
                f"rate_{label}_hz": sum(
                    _between(self.arrivals[n], start, now) for n in names if n in self.arrivals
                )
                / WINDOW_S
                for label, names in RATED.items()
            },
            "loss": lost / max(lost + heard, 1),
            "clock_offset_s": float(self._offset_ns(np.array([now]))[0]) / SECOND,
            "nis": self.nis / max(self.used, 1),
            "loop_lateness_s": 0.0,
        }
        counts = {"late": self.late, "gated": self.gated}
        idle = {"recorder_backlog": 0, "recorder_drops": 0}
        times = {"vehicle_time_ns": now - int(self._offset_ns(np.array([now]))[0])}
        row = encode("health", {**times, "receive_time_ns": now, **numbers, **counts, **idle})
        assert row is not None
        return row

    def _offset_ns(self, now: Ints) -> Ints:
        """Receipt − boat time, the lower envelope over the window before each moment [ns]."""
        receive, vehicle = self.stamps[:, 0], self.stamps[:, 1]
        out = np.zeros(len(now), np.int64)
        for k, moment in enumerate(now.tolist()):
            first, last = np.searchsorted(receive, [moment - WINDOW_S * SECOND, moment])
            if last > first:
                out[k] = (receive[first:last] - vehicle[first:last]).min()
        return out


def _between(times: Ints, start: int, end: int) -> int:
    first, last = np.searchsorted(times, [start, end])
    return int(last - first)


def _losses(log: Log, decoded: BoatSamples) -> Ints:
    """Receive time of every frame that the sequence numbers say is missing."""
    if not isinstance(log, MavlinkLog):
        return np.zeros(0, np.int64)
    frames = log.frames
    mine = (frames.headers.system == decoded.boat.system) & (
        frames.headers.component == decoded.boat.component
    )
    number = frames.headers.sequence[mine].astype(np.int64)
    if not len(number):
        return np.zeros(0, np.int64)
    steps = (np.diff(number) + LATE) % 256 - LATE
    number = np.cumsum(np.append(number[0], steps))  # without wraps; late frames step back
    absent = np.setdiff1d(np.arange(number[0], number.max()), number)
    noticed = np.searchsorted(np.maximum.accumulate(number), absent)
    return np.sort(frames.receive_time_ns[mine][noticed])


WINDOW_NS = WINDOW_S * SECOND
LIVE_LATE = (
    128  # numbers that step back by less are late frames: a quarter of a second of a fast link …
)
SOON_NS = SECOND  # … but after a silence the next frame is a new one
REFUSED, GATED = int(Flag.REFUSED), int(Flag.GATED)
LABEL = {name: label for label, names in RATED.items() for name in names}


@dataclass
class Numbers:
    """Sequence numbers of one component, as links lose, double and reorder them."""

    newest: int  # without wraps
    heard_ns: int = 0
    missing: set[int] = field(default_factory=set)

    def heard(self, sequence: int, receive_ns: int) -> int:
        """A frame's number -> how many more are lost since; −1 where a lost one came after all."""
        late = LIVE_LATE if receive_ns - self.heard_ns < SOON_NS else 0
        self.heard_ns = receive_ns
        step = (sequence - self.newest + late) % 256 - late
        if step <= 0:
            found = self.newest + step in self.missing
            self.missing.discard(self.newest + step)
            return -1 if found else 0
        self.missing |= set(range(self.newest + 1, self.newest + step))
        self.newest += step
        if len(self.missing) > LIVE_LATE:  # what is older never counts as late
            self.missing = {number for number in self.missing if number > self.newest - LIVE_LATE}
        return step - 1


@dataclass
class LiveHealth:
    """Counts what passes; `row` says how things stood over the last seconds."""

    heard_ns: int = 0  # receipt of the last frame
    seen: deque[tuple[int, str]] = field(default_factory=deque)  # receipt, name
    lost: deque[tuple[int, int]] = field(default_factory=deque)  # receipt, frames lost
    offsets: deque[tuple[int, int]] = field(default_factory=deque)  # receipt, receipt − boat time
    numbers: dict[int, Numbers] = field(default_factory=dict)  # by component
    offset_ns: int = 0
    nis: float = 0.0
    used: int = 0
    late: int = 0
    gated: int = 0
    lateness_ns: int = 0

    def frame(self, receive_ns: int, name: str, component: int, sequence: int) -> None:
        """A frame of the boat came in."""
        known = self.numbers.setdefault(component, Numbers(sequence - 1, receive_ns))
        self.heard_ns = receive_ns
        self.seen.append((receive_ns, name))
        if lost := known.heard(sequence, receive_ns):
            self.lost.append((receive_ns, lost))

    def filtered(self, rows: FilterRows, receive_ns: int, vehicle_ns: int) -> None:
        """What the filter said of a datagram's facts."""
        for nis, used, flags in zip(
            rows.nis.tolist(), rows.used.tolist(), rows.flags.tolist(), strict=True
        ):
            self.nis += nis if used else 0.0
            self.used += used
            self.late += flags & REFUSED != 0
            self.gated += flags & GATED != 0
        self.offsets.append((receive_ns, receive_ns - vehicle_ns))

    def late_by(self, delay_ns: int) -> None:
        """So long after receipt an estimate had gone out."""
        self.lateness_ns = max(self.lateness_ns, delay_ns)

    def rebooted(self) -> None:
        """The boat counts its frames anew: that is no loss."""
        self.numbers.clear()
        self.lost.clear()

    def rates_hz(self) -> dict[str, float]:
        """Rates at which messages came over the last seconds."""
        counts = Counter(name for _, name in self.seen)
        return {name: count / WINDOW_S for name, count in counts.items()}

    def row(self, now_ns: int, backlog: int, drops: int) -> dict[str, float | int]:
        """The health topic at a moment; NIS and lateness start anew."""
        for window in (self.seen, self.lost, self.offsets):
            _forget(window, now_ns)
        rates = dict.fromkeys(RATED, 0.0)
        for name, rate in self.rates_hz().items():
            if name in LABEL:
                rates[LABEL[name]] += rate
        lost = max(sum(count for _, count in self.lost), 0)
        self.offset_ns = min((offset for _, offset in self.offsets), default=self.offset_ns)
        row: dict[str, float | int] = {
            "vehicle_time_ns": now_ns - self.offset_ns,
            "receive_time_ns": now_ns,
            "link_age_s": max(now_ns - self.heard_ns, 0) / SECOND,
            "rate_hz": len(self.seen) / WINDOW_S,
            **{f"rate_{label}_hz": rate for label, rate in rates.items()},
            "loss": lost / max(lost + len(self.seen), 1),
            "clock_offset_s": self.offset_ns / SECOND,
            "nis": self.nis / max(self.used, 1),
            "loop_lateness_s": self.lateness_ns / SECOND,
            "late": self.late,
            "gated": self.gated,
            "recorder_backlog": backlog,
            "recorder_drops": drops,
        }
        self.nis, self.used, self.lateness_ns = 0.0, 0, 0
        return row


def _forget(window: deque[tuple[int, int]] | deque[tuple[int, str]], now_ns: int) -> None:
    """What is older than the window; or of the time before the clock was set back."""
    while window and not now_ns - WINDOW_NS <= window[0][0] <= now_ns + SECOND:
        window.popleft()
