"""What servo outputs drive: propellers, rudder blades, motors that turn."""

from dataclasses import dataclass


class Output:
    """A channel with pulses [µs]: lowest, neutral, highest."""

    pulses: tuple[int, int, int]
    reversed: bool

    def pulse(self, command: float) -> int:
        """A command in [−1, 1] -> the pulse that is sent [µs]."""
        low, neutral, high = self.pulses
        c = max(-1.0, min(1.0, -command if self.reversed else command))
        return round(neutral + c * (high - neutral if c > 0.0 else neutral - low))

    def command(self, pulse: int) -> float:
        """The pulse that was sent [µs] -> the command in [−1, 1] that is taken."""
        low, neutral, high = self.pulses
        c = (pulse - neutral) / (high - neutral if pulse > neutral else neutral - low)
        return -c if self.reversed else c


@dataclass(frozen=True)
class Motor(Output):
    """A propeller at x ahead, y to starboard [m], on a servo output; thrust [N]."""

    name: str
    channel: int
    x: float
    y: float
    astern: float
    ahead: float
    pulses: tuple[int, int, int] = (1100, 1500, 1900)
    reversed: bool = False


@dataclass(frozen=True)
class Rudder(Output):
    """Steers by up to `most` [rad] either way; to starboard is positive.

    A blade of `area` [m²] and `aspect` at x [m] on the centre line, behind the motor named
    `behind`; without an area that motor itself turns.
    """

    name: str
    channel: int
    x: float
    most: float
    behind: str
    area: float = 0.0
    aspect: float = 1.5
    pulses: tuple[int, int, int] = (1100, 1500, 1900)
    reversed: bool = False
