"""The two boats: as the generator of voyages knows them, and as a vessel file describes them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.hidden.boats import IACQUABOT, NINE, WAM_V, Boat
from gateway.vessel_file import load_vessel
from sim.state import Floats
from sim.vessel import Vessel

VESSELS = Path(__file__).parents[2] / "configs" / "vessels"


@dataclass(frozen=True)
class Pair:
    """One boat of the paper: nature's description, and the vessel file with the same numbers."""

    boat: Boat
    vessel: Vessel

    @property
    def name(self) -> str:
        """As the paper calls it."""
        return self.boat.name

    def guessed(self, seed: int) -> Vessel:
        """What identification starts from: each of the nine numbers off by about 10 %."""
        wrong = self.boat.misjudged(seed).hull
        values = {name: float(getattr(wrong, name)) for name in NINE}
        return replace(self.vessel, dynamics=replace(self.vessel.dynamics, **values))


def truth(pair: Pair) -> Floats:
    """The nine parameters (9,), SNAME signs."""
    return np.array([getattr(pair.vessel.dynamics, name) for name in NINE])


def iacquabot() -> Pair:
    """Four thrusters in the corners."""
    return Pair(IACQUABOT, load_vessel(VESSELS / "iacquabot.toml"))


def wam_v() -> Pair:
    """Two thrusters astern."""
    return Pair(WAM_V, load_vessel(VESSELS / "wam-v.toml"))
