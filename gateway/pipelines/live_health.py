"""Health of a live link: what passed in the last seconds, counted as it passes."""

from collections import Counter, deque
from dataclasses import dataclass, field

from gateway.estimation.estimator import Rows
from gateway.estimation.names import Flag
from gateway.pipelines.health import SECOND, WINDOW_S
from gateway.topics import RATED

WINDOW_NS = WINDOW_S * SECOND
LATE = 128  # numbers that step back by less are late frames: a quarter of a second of a fast link …
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
        late = LATE if receive_ns - self.heard_ns < SOON_NS else 0
        self.heard_ns = receive_ns
        step = (sequence - self.newest + late) % 256 - late
        if step <= 0:
            found = self.newest + step in self.missing
            self.missing.discard(self.newest + step)
            return -1 if found else 0
        self.missing |= set(range(self.newest + 1, self.newest + step))
        self.newest += step
        if len(self.missing) > LATE:  # what is older never counts as late
            self.missing = {number for number in self.missing if number > self.newest - LATE}
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

    def filtered(self, rows: Rows, receive_ns: int, vehicle_ns: int) -> None:
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
