"""The clock of one boat: stamps every message with vehicle time and counts what was odd.

The rules are those of `clock_step`, for a live link and for the columns of a log.
"""

from dataclasses import dataclass

import numpy as np

from gateway.ingest.clock_step import RECENT, RING, S, StampStatus, stamp, stamp_all
from gateway.ingest.mapping import Counter
from sim.state import Ints


@dataclass(frozen=True)
class ClockReport:
    """Counts of what was odd about the clocks of one boat: shown by `shadow info`."""

    sessions: int
    reboots: int
    wraps: int
    late: int
    duplicates: int
    unplaced: int
    receive_steps: int
    spread_s: float  # largest delay of a message above the envelope
    offset_s: float  # receipt − vehicle time at the end: the lower envelope


class BoatClock:
    """The clock of one boat: state that every message of the boat moves."""

    def __init__(self, streams: int) -> None:
        self.state = np.zeros(len(S), np.int64)
        self._recent = np.full((streams, RING + RECENT), -1, np.int64)
        self._recent[:, 1] = 0

    def stamp(
        self, stream: int, counter: Counter, counter_us: int, receive_time_ns: int
    ) -> tuple[int, StampStatus]:
        """One message of a stream -> vehicle time [ns], whether it can be used."""
        vehicle, status = stamp(
            self.state, self._recent[stream], int(counter), counter_us, receive_time_ns
        )
        return int(vehicle), StampStatus(status)

    def stamp_all(
        self, stream: Ints, counter: Ints, counter_us: Ints, receive_time_ns: Ints
    ) -> tuple[Ints, Ints, Ints]:
        """(K,) messages in order of receipt -> vehicle time [ns], status, session, (K,) each."""
        arrays: tuple[Ints, Ints, Ints] = stamp_all(
            self.state, self._recent, stream, counter, counter_us, receive_time_ns
        )
        return arrays

    @property
    def reboots(self) -> int:
        """How often the autopilot booted again."""
        return int(self.state[S.REBOOTS])

    @property
    def offset_ns(self) -> int:
        """Lower envelope of receipt − vehicle time."""
        return int(min(self.state[S.MIN_NOW], self.state[S.MIN_BEFORE]))

    def report(self) -> ClockReport:
        """The counts so far."""
        s = self.state
        return ClockReport(
            sessions=int(s[S.SESSION]) + int(s[S.STARTED]),
            reboots=self.reboots,
            wraps=int(s[S.WRAPS]),
            late=int(s[S.LATE]),
            duplicates=int(s[S.DUPLICATES]),
            unplaced=int(s[S.UNPLACED]),
            receive_steps=int(s[S.STEPS]),
            spread_s=float(s[S.SPREAD]) * 1e-9,
            offset_s=self.offset_ns * 1e-9,
        )
