"""The reference velocity ν_ref, and the follower that makes a plant move as it does.

**The reference** is the estimate, the vessel's own prediction, or one after the other.

    measured   the estimate, as it is
    model      the vessel predicts from the boat's commands, from the first estimate on
    auto       the estimate while telemetry is fresh, the prediction while the link is down

At a hand-over the reference goes on where it was, pose, velocity and acceleration, and the offset
decays within seconds (`sim.following`). Pure: a state goes in, a new state comes out, and how
rows are cut into chunks does not change a bit.

**The follower** goes by the law in `sim.following`.

`VesselFollower` drives a vessel in one compiled loop, `sim.following.stepwise` any plant. Both are
pure: a state goes in, a new state comes out, and how rows are cut into chunks does not change a
bit. The force may be limited to what the thrusters can give, by pseudo-inverse and clipping:

    τ = B F,   B columns (cos α, sin α, x sin α − y cos α),   F = clip(B⁺ τ, astern, ahead)

What no thruster can give (sway of a boat with two thrusters astern) is then left out. Source:
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, §11.2.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.following import Gains
from sim.kernel import air, flags, floats, frozen
from sim.model import Model
from sim.state import Floats, Tau
from sim.vessel import Thruster, Vessel

HIGHEST_GAIN = 1000.0  # [1/s, 1/s²]: a shadow that follows within a millisecond


class Axes(StrEnum):
    """Which axes are controlled."""

    THREE = "three"
    SURGE_YAW = "surge_yaw"  # as in the paper: sway follows by coupling alone


class ControlLaw(StrEnum):
    """Which law gives the commanded acceleration γ."""

    ERROR = "error"  # ν̇_ref + K e + K_i ∫e
    PRINTED = "printed"  # ν̇_ref + k_d ė, as the paper prints it: an error at the start stays


@dataclass(frozen=True)
class FollowerOptions:
    """Gains and options of the follower (`[following]` of gateway.toml).

    rate K [1/s], integral K_i [1/s²], position and heading K_p of the slow outer loop [1/s];
    limits: the force is limited to what the plant's thrusters can give.
    """

    rate: float = 10.0
    integral: float = 0.5
    position: float = 0.1
    heading: float = 0.2
    axes: Axes = Axes.THREE
    law: ControlLaw = ControlLaw.ERROR
    limits: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", Axes(self.axes))
        object.__setattr__(self, "law", ControlLaw(self.law))
        if not 0.0 < self.rate <= HIGHEST_GAIN:
            raise ValueError(
                f"following: rate must be above 0, at most {HIGHEST_GAIN:g} 1/s, not {self.rate}"
            )
        for name in ("integral", "position", "heading"):
            if not 0.0 <= getattr(self, name) <= HIGHEST_GAIN:
                raise ValueError(
                    f"following: {name} must be 0 to {HIGHEST_GAIN:g}, is {getattr(self, name)}"
                )

    @property
    def gains(self) -> Gains:
        """The gains of the law."""
        sway = 1.0 if self.axes is Axes.THREE else 0.0
        if self.law is ControlLaw.PRINTED:
            return Gains.printed()._replace(sway=sway)
        return Gains(self.rate, self.integral, self.position, self.heading, sway)


class ThrustLimits(NamedTuple):
    """Allocation B⁺ (n, 3), effectiveness B (3, n) [-, -, m], low, high (n,) [N] of n thrusters."""

    allocation: Floats
    effectiveness: Floats
    low: Floats
    high: Floats

    @classmethod
    def none(cls) -> "ThrustLimits":
        """No limits: a virtual force."""
        return cls(np.zeros((0, 3)), np.zeros((3, 0)), np.zeros(0), np.zeros(0))

    @classmethod
    def of(cls, vessel: Vessel) -> "ThrustLimits":
        """The limits of a vessel's thrusters; ValueError where they alone cannot turn it."""
        B = np.array([_column(thruster) for thruster in vessel.thrusters]).T.reshape(3, -1)
        if np.linalg.matrix_rank(B[[Tau.X, Tau.N]]) < 2:
            raise ValueError(
                f"following with limits needs thrusters that can push and turn the plant; "
                f"those of {vessel.name} cannot: set limits = false"
            )
        low, high = np.array([thruster.thrust for thruster in vessel.thrusters], dtype=float).T
        return cls(np.linalg.pinv(B), np.ascontiguousarray(B), low.copy(), high.copy())


def _column(t: Thruster) -> tuple[float, float, float]:
    """Wrench of one newton of a thruster -> X, Y, N [-, -, m]."""
    forward, starboard = float(np.cos(t.azimuth)), float(np.sin(t.azimuth))
    return forward, starboard, t.position[0] * starboard - t.position[1] * forward


@dataclass(frozen=True)
class FollowerState:
    """The carried row (read-only); of a plant that is not compiled its state, and what the
    controller remembers."""

    carry: Floats
    plant: Any = None
    controller: Any = None


class FollowerResult(NamedTuple):
    """The state after some rows, and the shadow at each.

    shadows  (K, 9)  pose, velocity, acceleration
    forces   (K, 3)  τ_c [N, N, N m]
    limited  (K,)    thrust limits bind
    diverged (K,)    the plant had left what a boat can do and was set to the reference
    """

    state: FollowerState
    shadows: Floats
    forces: Floats
    limited: NDArray[np.bool_]
    diverged: NDArray[np.bool_]


class Follower(Protocol):
    """Makes a plant follow references."""

    def start(self) -> FollowerState:
        """The state before the first reference."""
        ...

    def prepare(self) -> None:
        """Compile or load what the first row would otherwise wait for."""
        ...

    def advance(
        self,
        state: FollowerState,
        times: Floats,
        references: Floats,
        jumps: NDArray[np.bool_] | None = None,
        voltage: Floats | None = None,
        wind: Floats | None = None,
    ) -> FollowerResult:
        """References (K, 9) at times (K,) [s] -> the shadow there.

        The plant starts at the first reference. `jumps` (K,) marks references that did not come
        about by motion (an origin shift): there the plant is set anew, as it is after a silence of
        more than `LONGEST_SPAN_S` and where it has diverged.
        """
        ...


@dataclass(frozen=True)
class VesselFollower:
    """Follows with a vessel as the plant, compiled."""

    model: Model
    options: FollowerOptions
    limits: ThrustLimits

    @classmethod
    def of(cls, model: Model, options: FollowerOptions | None = None) -> "VesselFollower":
        """Follow with that vessel; ValueError where limits are asked for that it cannot keep."""
        chosen = options or FollowerOptions()
        limits = ThrustLimits.of(model.vessel) if chosen.limits else ThrustLimits.none()
        return cls(model, chosen, limits)

    def start(self) -> FollowerState:
        """The state before the first reference."""
        carry = np.zeros(self.model.state_size + 16)
        carry[self.model.state_size + 6] = np.nan
        return FollowerState(frozen(carry))

    def prepare(self) -> None:
        """Compile the loop."""
        self.advance(self.start(), np.empty(0), np.empty((0, 9)))

    def advance(
        self,
        state: FollowerState,
        times: Floats,
        references: Floats,
        jumps: NDArray[np.bool_] | None = None,
        voltage: Floats | None = None,
        wind: Floats | None = None,
    ) -> FollowerResult:
        """References (K, 9) at times (K,) [s] -> the shadow there, see `Follower`."""
        count, carry = len(times), state.carry.copy()
        shadows, forces = np.empty((count, 9)), np.empty((count, 3))
        limited, diverged = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self.model.kernel.module.follow(
            self.model.theta, carry, np.array(self.options.gains), floats(times),
            floats(references), flags(jumps, count), *air(voltage, wind, count),
            *self.limits, shadows, forces, limited, diverged,
        )  # fmt: skip
        return FollowerResult(FollowerState(frozen(carry)), shadows, forces, limited, diverged)


FADE_S = 1.0  # time constant of a hand-over; chosen, not measured


class ReferenceMode(StrEnum):
    """Where the reference comes from."""

    MEASURED = "measured"
    MODEL = "model"
    AUTO = "auto"


@dataclass(frozen=True)
class ReferenceState:
    """The carried row (read-only)."""

    carry: Floats


class ReferenceResult(NamedTuple):
    """The state after some rows, and the reference at each.

    references  (K, 9)
    from_model  (K,)  the model gives it
    diverged    (K,)  … and had left what a boat can do: it began anew at the estimate
    reset       (K,)  it was too far from the estimate to come back as a boat moves: set to it
    """

    state: ReferenceState
    references: Floats
    from_model: NDArray[np.bool_]
    diverged: NDArray[np.bool_]
    reset: NDArray[np.bool_]


@dataclass(frozen=True)
class Reference:
    """Estimates and commands in, the reference out."""

    model: Model
    mode: ReferenceMode = ReferenceMode.AUTO
    fade: float = FADE_S

    def start(self) -> ReferenceState:
        """The state before the first row."""
        return ReferenceState(frozen(np.full(self.model.state_size + 21, np.nan)))

    def prepare(self) -> None:
        """Compile the loop."""
        rows, commands = np.empty((0, 9)), np.empty((0, self.model.actuator_count))
        self.advance(self.start(), np.empty(0), rows, np.zeros(0, np.bool_), commands)

    def advance(
        self,
        state: ReferenceState,
        times: Floats,
        estimates: Floats,
        fresh: NDArray[np.bool_],
        commands: Floats,
        voltage: Floats | None = None,
        wind: Floats | None = None,
        jumps: NDArray[np.bool_] | None = None,
    ) -> ReferenceResult:
        """Estimates (K, 9) at times (K,) [s] -> references (K, 9).

        fresh (K,): telemetry is up to date at that row. Commands (K, na) hold over the interval
        that ends at their row, taken as they act: a command delay is the caller's. jumps (K,):
        estimates that did not come about by motion; the model is set to them.
        """
        count, carry = len(times), state.carry.copy()
        from_model = self._from_model(flags(fresh, count))
        out = np.empty((count, 9))
        diverged, reset = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self.model.kernel.module.compute_reference(
            self.model.theta, carry, self.fade, floats(times), floats(estimates), from_model,
            ~from_model, flags(jumps, count), floats(commands), *air(voltage, wind, count), out,
            diverged, reset,
        )  # fmt: skip
        return ReferenceResult(ReferenceState(frozen(carry)), out, from_model, diverged, reset)

    def _from_model(self, fresh: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which rows the model gives (K,); at the others it is set to the estimate."""
        if self.mode is ReferenceMode.AUTO:
            return ~fresh
        return np.full_like(fresh, self.mode is ReferenceMode.MODEL)
