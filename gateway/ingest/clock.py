"""The clock of one boat: stamps every message with vehicle time and counts what was odd.

The rules are in `clock_step`; a live link and the columns of a log go through the same ones.
"""

from dataclasses import dataclass

import numpy as np

from gateway.ingest.clock_step import RECENT, RING, S, Verdict, stamp, stamp_all
from gateway.ingest.mapping import Counter
from sim.state import Ints


@dataclass(frozen=True)
class ClockReport:
    """What the clocks of one boat did: shown by `shadow info`, never hidden."""

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
    ) -> tuple[int, Verdict]:
        """One message of a stream -> vehicle time [ns] and what it is worth."""
        vehicle, verdict = stamp(
            self.state, self._recent[stream], int(counter), counter_us, receive_time_ns
        )
        return int(vehicle), Verdict(verdict)

    def stamp_all(
        self, stream: Ints, counter: Ints, counter_us: Ints, receive_time_ns: Ints
    ) -> tuple[Ints, Ints, Ints]:
        """(K,) messages in order of receipt -> vehicle time [ns], verdict, session, (K,) each."""
        arrays: tuple[Ints, Ints, Ints] = stamp_all(
            self.state, self._recent, stream, counter, counter_us, receive_time_ns
        )
        return arrays

    @property
    def session(self) -> int:
        """Number of the boot session, from 0."""
        return int(self.state[S.SESSION])

    @property
    def offset_ns(self) -> int:
        """Lower envelope of receipt − vehicle time."""
        return int(min(self.state[S.MIN_NOW], self.state[S.MIN_BEFORE]))

    def report(self) -> ClockReport:
        """The counts so far."""
        s = self.state
        return ClockReport(
            sessions=int(s[S.SESSION]) + int(s[S.STARTED]),
            reboots=int(s[S.REBOOTS]),
            wraps=int(s[S.WRAPS]),
            late=int(s[S.LATE]),
            duplicates=int(s[S.DUPLICATES]),
            unplaced=int(s[S.UNPLACED]),
            receive_steps=int(s[S.STEPS]),
            spread_s=float(s[S.SPREAD]) * 1e-9,
            offset_s=self.offset_ns * 1e-9,
        )
