"""Settings of an identification."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sim.prediction.segments import BLOCK_S

BASE = ("m11", "m22", "m33", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr")
METHODS = ("shooting", "simulation", "instrumental", "regression")


@dataclass(frozen=True)
class IdentifySettings:
    """Which parameters are estimated, and how.

    free       parameters of the model by name; `effect.*` frees all of an effect
    fix        taken out of those again
    priors     name -> relative standard deviation of its value in the vessel file
    horizons   lengths of the free runs [s], from the first, careful fit to the last
    average    rows are compared in means over so long [s]: what is faster, a smoother has rounded
    growth     a run is halved where an error of its start grows by more than this
    robust     residuals beyond so many standard deviations count less
    block      length of the blocks [s] that intervals are made from
    tied       short runs tied by a filter, not free ones (`sim.identification.innovations`): for
               hulls that are unstable on course
    offsets    offsets in time of commands and velocities, and rounding, are estimated along
    """

    free: tuple[str, ...] = BASE
    fix: tuple[str, ...] = ()
    priors: Mapping[str, float] = field(default_factory=dict)
    method: str = "shooting"
    horizons: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)
    average: float = 0.4
    growth: float = 6.0
    robust: float = 3.0
    block: float = BLOCK_S
    offsets: bool = True
    tied: bool = False

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method {self.method!r}: expected one of {', '.join(METHODS)}")
        if not self.horizons or min(self.horizons) <= 0.0:
            raise ValueError(f"horizons {self.horizons}: expected lengths in seconds")
        for name, share in self.priors.items():
            if not share > 0.0:
                raise ValueError(f"prior of {name}: {share} is no relative standard deviation")
