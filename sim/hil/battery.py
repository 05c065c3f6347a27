"""A battery under load: its voltage sags with the current and falls with the charge drawn.

    I = I_full e,   I_full = 4 W/N · ΣF_max / V_n,   e = mean |c|^1.5 over the thrusters
    V = V_n (1.1 − 0.06 e − 0.15 min(Q / (I_full · 1 h), 1))

c [-] commands, F_max [N] thrust full ahead, V_n [V] nominal voltage, Q [A s] charge drawn. Chosen
like the pack of a small electric boat (an hour at full power), not fitted to one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sim.vessel import Vessel

FULL_POWER_W_PER_N = 4.0  # electrical, of small propellers
SAG, DRAINED = 0.06, 0.15  # share of the voltage lost at full current; when empty
ENDURANCE_S = 3600.0  # at full current


@dataclass(frozen=True)
class Battery:
    """Nominal voltage [V] and current of all thrusters full ahead [A]."""

    nominal_v: float
    full_current: float

    @classmethod
    def of(cls, vessel: Vessel, nominal_v: float) -> "Battery":
        """The battery of a vessel: its size follows from the thrust."""
        thrust = sum(thruster.thrust[1] for thruster in vessel.thrusters)
        return cls(nominal_v, FULL_POWER_W_PER_N * thrust / nominal_v)

    def voltage(self, effort: float, used_as: float) -> float:
        """Share of the full current (0 … 1) and charge drawn [A s] -> V."""
        return self.nominal_v * (1.1 - SAG * effort - DRAINED * self.drained(used_as))

    def drained(self, used_as: float) -> float:
        """Charge drawn [A s] -> its share of the whole: 0 full, 1 empty."""
        return min(used_as / (self.full_current * ENDURANCE_S), 1.0)


def effort(thruster_commands: Sequence[float]) -> float:
    """Commands of the thrusters (−1 … 1) -> share of the full current (0 … 1)."""
    return sum(abs(c) ** 1.5 for c in thruster_commands) / max(len(thruster_commands), 1)
