"""What a user may choose about following (`[following]` of gateway.toml)."""

from dataclasses import dataclass
from enum import StrEnum

from sim.following.law import Gains


class Axes(StrEnum):
    """Which axes are driven."""

    THREE = "three"
    SURGE_YAW = "surge_yaw"  # as in the paper: sway follows by coupling alone


class Law(StrEnum):
    """Which law gives the wanted acceleration."""

    ERROR = "error"  # ν̇_ref + K e + K_i ∫e
    PRINTED = "printed"  # ν̇_ref + k_d ė, as the paper prints it: an error at the start stays


@dataclass(frozen=True)
class Following:
    """Gains and options of the follower.

    rate K [1/s], integral K_i [1/s²], position and heading K_p of the slow outer loop [1/s];
    limits: the plant's thrusters must be able to give the force.
    """

    rate: float = 10.0
    integral: float = 0.5
    position: float = 0.1
    heading: float = 0.2
    axes: Axes = Axes.THREE
    law: Law = Law.ERROR
    limits: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", Axes(self.axes))
        object.__setattr__(self, "law", Law(self.law))
        if not self.rate > 0.0:
            raise ValueError(f"following: rate must be above 0 1/s, not {self.rate}")
        for name in ("integral", "position", "heading"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"following: {name} must not be below 0, is {getattr(self, name)}")

    @property
    def gains(self) -> Gains:
        """The numbers that the law reads."""
        sway = 1.0 if self.axes is Axes.THREE else 0.0
        if self.law is Law.PRINTED:
            return Gains.printed()._replace(sway=sway)
        return Gains(self.rate, self.integral, self.position, self.heading, sway)
