"""A battery: voltage falls with the charge that is gone and with the current that flows."""

from collections.abc import Sequence

FULL, EMPTY = 16.6, 13.6  # V without load
RESISTANCE = 0.02  # Ω
IDLE, MOTORS = 0.6, 30.0  # A: electronics; all motors at full power
CAPACITY = 36000.0  # A s: twenty minutes at full power


class Battery:
    """Charge drawn so far. A `tired` one holds less and sags more, by that factor."""

    def __init__(self, tired: float = 1.0) -> None:
        self._drawn, self._tired = 0.0, tired
        self.volts = FULL

    def drawn(self, commands: Sequence[float], seconds: float) -> tuple[float, float]:
        """Draw what the commands need for so long -> volts, amperes while they do."""
        power = sum(abs(c) ** 1.5 for c in commands) / len(commands)
        amperes = IDLE + MOTORS * power
        self._drawn += amperes * seconds
        gone, sags = self._tired * self._drawn / CAPACITY, self._tired * RESISTANCE
        self.volts = FULL - (FULL - EMPTY) * gone - sags * amperes
        return self.volts, amperes
