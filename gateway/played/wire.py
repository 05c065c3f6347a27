"""Between boat and listener: frames get lost, doubled, late, held back. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from numpy.random import Generator

from gateway.played.faults import Faults

LATE_FROM, LATE_TO = 0.02, 0.25  # s, of a frame that others overtake
TWICE_WITHIN = 0.1  # s


class Frame(NamedTuple):
    """One MAVLink frame: when it arrives [s since play began], the boat's clock, its sender."""

    time_s: float
    boot_s: float
    system: int
    data: bytes


@dataclass(frozen=True)
class Wire:
    """A link with faults. Its state: the frames on their way, by time of arrival."""

    faults: Faults

    def carry(
        self,
        waiting: tuple[Frame, ...],
        sent: Iterable[Frame],
        until_s: float,
        luck: Generator,
    ) -> tuple[tuple[Frame, ...], list[Frame]]:
        """Frames on their way and new ones -> those still on their way, those that arrive."""
        moved = [copy for frame in sent for copy in self._fate(frame, luck)]
        frames = sorted([*waiting, *moved], key=lambda frame: frame.time_s)
        arrived = sum(frame.time_s <= until_s for frame in frames)
        return tuple(frames[arrived:]), frames[:arrived]

    def _fate(self, frame: Frame, luck: Generator) -> Iterator[Frame]:
        f, time = self.faults, frame.time_s
        lost, doubled, late = (
            (luck.random(3) < (f.loss, f.duplicates, f.reordered)).tolist()
            if f.loss or f.duplicates or f.reordered
            else (False, False, False)
        )
        if lost or any(gap.from_s <= time < gap.to_s for gap in f.silences):
            return
        for burst in f.bursts:
            time = burst.arrival(time)
        time += luck.uniform(LATE_FROM, LATE_TO) if late else 0.0
        yield frame._replace(time_s=time)
        if doubled:
            yield frame._replace(time_s=time + luck.uniform(0.0, TWICE_WITHIN))
