"""The line of long work: what is being done, and after a while how long it has taken.

How long a whole search takes nobody knows beforehand. What is told is what can be counted: of a
round of like steps what is left, from what those before took, and the time so far.
"""

from time import perf_counter

from rich.text import Text

from sim.state import CountedStep

QUIET_S = 10.0  # before this nobody asks how long it takes


class WorkLine:
    """Drawn again and again while work goes on; `step` says what is done next."""

    def __init__(self, what: str) -> None:
        self._what, self._text, self._left = what, "", ""
        self._begun = self._round_begun = perf_counter()
        self._done = 0

    @property
    def seconds(self) -> float:
        """Since the work began."""
        return perf_counter() - self._begun

    def step(self, text: str) -> None:
        """The next thing, or how far a round of like things is."""
        done = text.done if isinstance(text, CountedStep) else 0
        if not done:
            self._round_begun = perf_counter()
        elif done < self._done:  # threads may report out of order
            return
        self._text, self._done, self._left = text, done, ""
        if isinstance(text, CountedStep) and 0 < done < text.total:
            left = (perf_counter() - self._round_begun) / done * (text.total - done)
            self._left = f", about {duration(left)} for the other {text.total - done}"

    def __rich__(self) -> Text:
        """The line as it is now."""
        seconds, step = self.seconds, f": {self._text}" if self._text else ""
        if seconds < QUIET_S:
            return Text(f"{self._what}{step}")
        return Text(f"{self._what}{step}{self._left} ({duration(seconds)} so far)")


def duration(seconds: float) -> str:
    """A time as people say it: 40 s, 12 min, 1.5 h."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
