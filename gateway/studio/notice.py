"""A notice: a line at the lower edge of a page. Good news fade; what went wrong stays."""

import time
from dataclasses import dataclass

GOOD_S = 15.0  # good news stay that long; what went wrong stays until it is no longer true


@dataclass(frozen=True)
class Notice:
    """A line for people: what went wrong, or well, and when it was said (monotonic clock [s])."""

    text: str
    good: bool
    since: float
    about: str = ""

    @property
    def holds(self) -> bool:
        """Whether the notice is still to be shown."""
        return not self.good or time.monotonic() - self.since < GOOD_S
