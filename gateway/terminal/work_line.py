"""The line of long work: what is being done, and after a while how long it has taken.

How long a whole search takes nobody knows beforehand. What is told is what can be counted: of a
round of like steps what is left, from what those before took, and the time so far.
"""

from time import perf_counter

from rich.text import Text

from gateway.compiling import compiling_s
from sim.state import CountedStep

QUIET_S = 10.0  # before this nobody asks how long it takes
COMPILES_S = 1.0  # before this it is not said that something is compiled
MIN_SHARE_DONE = 0.1  # of a round, to tell from it how long the others take


class WorkLine:
    """Drawn again and again while work goes on; `step` says what is done next."""

    def __init__(self, what: str) -> None:
        self._what, self._now = what, CountedStep("")
        self._begun = self._round_begun = self._now_begun = perf_counter()

    @property
    def seconds(self) -> float:
        """Since the work began."""
        return perf_counter() - self._begun

    def step(self, text: str) -> None:
        """The next thing, or how far a round of like things is."""
        step = text if isinstance(text, CountedStep) else CountedStep(text)
        if 0 < step.done < self._now.done:  # threads may report out of order
            return
        self._now, self._now_begun = step, perf_counter()
        if not step.done:
            self._round_begun = self._now_begun

    def __rich__(self) -> Text:
        """The line as it is now."""
        seconds, step = self.seconds, f": {self._now}" if self._now else ""
        if compiling_s() > COMPILES_S:
            step += " (compiling, kept for the next time)"
        if seconds < QUIET_S:
            return Text(f"{self._what}{step}")
        return Text(f"{self._what}{step}{self._left()} ({duration(seconds)} so far)")

    def _left(self) -> str:
        """How long the others of a round take; nothing where too few are done to tell, or where
        they take longer than these.
        """
        now, others = self._now, self._now.total - self._now.done
        if others <= 0 or now.done < MIN_SHARE_DONE * now.total:
            return ""
        whole = (self._now_begun - self._round_begun) / now.done * others
        left = whole - (perf_counter() - self._now_begun)
        return f", about {duration(left)} for the other {others}" if left >= 1.0 else ""


def duration(seconds: float) -> str:
    """A time as people say it: 40 s, 12 min, 1.5 h."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
