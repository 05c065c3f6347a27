"""Health of a live link: what passed in the last seconds, counted as it passes."""

from collections import Counter, deque
from dataclasses import dataclass, field

from gateway.estimation.estimator import Rows
from gateway.estimation.names import Flag
from gateway.pipelines.health import SECOND, WINDOW_S
from gateway.topics import RATED

WINDOW_NS = WINDOW_S * SECOND
LABEL = {name: label for label, names in RATED.items() for name in names}


@dataclass
class LiveHealth:
    """Counts what passes; `row` says how things stood over the last seconds."""

    seen: deque[tuple[int, str, int]] = field(default_factory=deque)  # receipt, name, lost
    offsets: deque[tuple[int, int]] = field(default_factory=deque)  # receipt, receipt − boat time
    sequence: dict[int, int] = field(default_factory=dict)  # component -> its last number
    nis: float = 0.0
    used: int = 0
    late: int = 0
    gated: int = 0
    lateness_ns: int = 0

    def frame(self, receive_ns: int, name: str, component: int, sequence: int) -> None:
        """A frame of the boat came in."""
        gap = (sequence - self.sequence.get(component, sequence - 1) - 1) % 256
        self.sequence[component] = sequence
        self.seen.append((receive_ns, name, gap if gap < 128 else 0))

    def filtered(self, rows: Rows, receive_ns: int, vehicle_ns: int) -> None:
        """What the filter said of a datagram's facts."""
        mine = rows.used > 0
        self.nis += float(rows.nis[mine].sum())
        self.used += int(rows.used.sum())
        self.late += int(rows.has(Flag.REFUSED).sum())
        self.gated += int(rows.has(Flag.GATED).sum())
        self.offsets.append((receive_ns, receive_ns - vehicle_ns))

    def late_by(self, delay_ns: int) -> None:
        """So long after receipt an estimate had gone out."""
        self.lateness_ns = max(self.lateness_ns, delay_ns)

    def rates_hz(self) -> dict[str, float]:
        """Rates at which messages came over the last seconds."""
        counts = Counter(name for _, name, _ in self.seen)
        return {name: count / WINDOW_S for name, count in counts.items()}

    def row(self, now_ns: int, backlog: int, drops: int) -> dict[str, float | int]:
        """The health topic at a moment; NIS and lateness start anew."""
        age = (now_ns - self.seen[-1][0]) / SECOND if self.seen else 0.0
        for window in (self.seen, self.offsets):
            while window and window[0][0] < now_ns - WINDOW_NS:
                window.popleft()  # type: ignore[attr-defined]
        rates = dict.fromkeys(RATED, 0.0)
        for _, name, _ in self.seen:
            if name in LABEL:
                rates[LABEL[name]] += 1.0 / WINDOW_S
        lost = sum(gap for _, _, gap in self.seen)
        offset = min((o for _, o in self.offsets), default=0)
        row: dict[str, float | int] = {
            "vehicle_time_ns": now_ns - offset,
            "receive_time_ns": now_ns,
            "link_age_s": age,
            "rate_hz": len(self.seen) / WINDOW_S,
            **{f"rate_{label}_hz": rate for label, rate in rates.items()},
            "loss": lost / max(lost + len(self.seen), 1),
            "clock_offset_s": offset / SECOND,
            "nis": self.nis / max(self.used, 1),
            "loop_lateness_s": self.lateness_ns / SECOND,
            "late": self.late,
            "gated": self.gated,
            "recorder_backlog": backlog,
            "recorder_drops": drops,
        }
        self.nis, self.used, self.lateness_ns = 0.0, 0, 0
        return row
