"""Once a second: how well link, clocks and filter are. Rows of the health topic."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gateway.estimation.estimator import Rows
from gateway.estimation.names import Flag
from gateway.ingest.continuity import LATE
from gateway.ingest.decoding import Decoded
from gateway.ingest.log import Log
from gateway.messages import Rows as Messages
from gateway.messages import encode
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
    def of_log(cls, log: Log, decoded: Decoded) -> "HealthMeter":
        """What a log tells of one boat."""
        arrivals = {}
        for name in log.counts():
            table, boat = log.table(name), decoded.boat
            mine = (table.system == boat.system) & (table.component == boat.component)
            arrivals[name] = np.sort(table.receive_time_ns[mine])
        stamps = [np.stack([s.receive_time_ns, s.vehicle_time_ns], axis=1) for s in decoded.samples]
        both = np.concatenate(stamps) if stamps else np.zeros((0, 2), np.int64)
        return cls(arrivals, _losses(log, decoded), both[np.argsort(both[:, 0], kind="stable")])

    def advance(self, receive_time_ns: Ints, rows: Rows) -> Messages:
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
        return Messages("health", times - self._offset_ns(times), times, [row for _, row in out])

    def _over(self, second: int) -> bool:
        """Is the second before this one over? A clock set back by long starts anew."""
        first, later = self.second < 0, second > self.second
        if first or later or second < self.second - WINDOW_S:
            self.second = second
        return later and not first

    def _count(self, rows: Rows, mine: slice) -> None:
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


def _losses(log: Log, decoded: Decoded) -> Ints:
    """Receive time of every frame that the sequence numbers say is missing."""
    frames = getattr(log, "frames", None)
    if frames is None:
        return np.zeros(0, np.int64)
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
