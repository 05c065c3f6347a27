"""What can go wrong with a boat and its link, as values. Times are seconds since play began."""

from dataclasses import dataclass, fields

from gateway.errors import BadInput


@dataclass(frozen=True)
class Reboot:
    """The autopilot restarts: clock to zero, rates forgotten, a new local origin."""

    at_s: float
    down_s: float = 2.0  # no word for so long


@dataclass(frozen=True)
class Silence:
    """The link is down: what is sent is lost."""

    from_s: float
    to_s: float


@dataclass(frozen=True)
class Burst:
    """The link stalls, then delivers what has waited at `factor` times the usual rate.

    At `to_s` it is up to date again: everything of from_s … to_s arrives in the last
    1 / factor of that span.
    """

    from_s: float
    to_s: float
    factor: float = 10.0

    def __post_init__(self) -> None:
        if not self.factor >= 1.0:
            raise BadInput(f"factor of a burst = {self.factor}: expected 1 or more")

    def arrival(self, time_s: float) -> float:
        """When a frame sent at that moment comes out [s]."""
        if not self.from_s <= time_s < self.to_s:
            return time_s
        return self.to_s - (self.to_s - time_s) / self.factor


@dataclass(frozen=True)
class Faults:
    """All that goes wrong; nothing by default. Shares are of all frames, 0 … 1."""

    reboots: tuple[Reboot, ...] = ()
    silences: tuple[Silence, ...] = ()
    bursts: tuple[Burst, ...] = ()
    loss: float = 0.0
    duplicates: float = 0.0
    reordered: float = 0.0
    nonsense: float = 0.0  # NaN or absurd values in one field

    def __post_init__(self) -> None:
        for entry in fields(self):
            share = getattr(self, entry.name)
            if isinstance(share, float | int) and not 0.0 <= share <= 1.0:
                raise BadInput(f"share of {entry.name} = {share}: expected 0 … 1")
        moments = [reboot.at_s for reboot in self.reboots]
        if moments != sorted(moments):
            raise BadInput("reboots are listed in the order in which they happen")
