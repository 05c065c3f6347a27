"""A battery: voltage falls with the charge that is gone and with the current that flows."""

from collections.abc import Sequence

FULL, EMPTY = 16.6, 13.6  # V without load
RESISTANCE = 0.02  # Ω
IDLE, MOTORS = 0.6, 30.0  # A: electronics; all motors at full power
CAPACITY = 36000.0  # A s: twenty minutes at full power


class Battery:
    """Charge drawn so far."""

    def __init__(self) -> None:
        self._drawn = 0.0
        self.volts = FULL

    def drawn(self, commands: Sequence[float], seconds: float) -> tuple[float, float]:
        """Draw what the commands need for so long -> volts, amperes while they do."""
        power = sum(abs(c) ** 1.5 for c in commands) / len(commands)
        amperes = IDLE + MOTORS * power
        self._drawn += amperes * seconds
        self.volts = FULL - (FULL - EMPTY) * self._drawn / CAPACITY - RESISTANCE * amperes
        return self.volts, amperes
