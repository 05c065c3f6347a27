"""Follow with any plant, step by step in Python: the same law and the same rows as the compiled
loop in `sim.following.loops`, for plants that cannot be compiled (a physics engine, an FMU).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.following.follower import Followed, FollowerState, Following, Limits
from sim.following.law import Gains, reference_rate, wanted_acceleration
from sim.following.loops import CONTROL_STEP, limited
from sim.kernel.arrays import air, flags, floats, frozen
from sim.plants.plant import Around, Motion, Plant
from sim.state import Eta, Floats, Pose, Velocity, Wrench, wrap
from sim.vessel import Vessel

INNER, FORCE, TIME, LAST = slice(0, 3), slice(3, 6), 6, slice(7, 16)  # parts of the carried row


class _Pull(NamedTuple):
    """A force, the integral of e with it, and whether limits bind."""

    tau: Wrench
    inner: Velocity
    bound: bool


@dataclass(frozen=True)
class PlantFollower:
    """Follows with any plant."""

    plant: Plant
    options: Following
    limits: Limits

    @classmethod
    def of(
        cls, plant: Plant, options: Following | None = None, vessel: Vessel | None = None
    ) -> "PlantFollower":
        """Follow with that plant; thrust limits are those of `vessel`."""
        chosen = options or Following()
        if chosen.limits and vessel is None:
            raise ValueError(f"following with limits: whose thrusters drive {plant.name}?")
        limits = Limits.of(vessel) if chosen.limits and vessel else Limits.none()
        return cls(plant, chosen, limits)

    def start(self) -> FollowerState:
        """The state before the first reference."""
        carry = np.zeros(16)
        carry[TIME] = np.nan
        return FollowerState(frozen(carry))

    def prepare(self) -> None:
        """Nothing to compile."""

    def advance(
        self,
        state: FollowerState,
        times: Floats,
        references: Floats,
        jumps: NDArray[np.bool_] | None = None,
        voltage: Floats | None = None,
        wind: Floats | None = None,
    ) -> Followed:
        """References (K, 9) at times (K,) [s] -> the shadow there, see `Follower`."""
        count, carry, plant = len(times), state.carry.copy(), state.plant
        shadows, forces = np.empty((count, 9)), np.empty((count, 3))
        bound, leaps = np.zeros(count, np.bool_), flags(jumps, count)
        volts, winds = air(voltage, wind, count)
        for k, (time, row) in enumerate(zip(times.tolist(), floats(references), strict=True)):
            around = Around(time, volts[k], winds[k, 0], winds[k, 1])
            if leaps[k] or not np.isfinite(carry[TIME]):
                plant, bound[k] = self._placed(row, around, carry)
            plant, hit = self._row(plant, row, around, carry)
            bound[k] |= hit
            tau, now = Wrench(*carry[FORCE]), around._replace(time=carry[TIME])
            motion = self.plant.motion(plant)
            shadows[k] = *motion.pose, *motion.velocity, *self.plant.acceleration(plant, tau, now)
            forces[k] = tau
        return Followed(FollowerState(frozen(carry), plant), shadows, forces, bound)

    def _placed(self, row: Floats, around: Around, carry: Floats) -> tuple[Any, bool]:
        """The plant set to a reference row (9,) -> its state, and whether limits bind."""
        plant = self.plant.place(Motion(Pose(*row[:3]), Velocity(*row[3:6])), around)
        carry[INNER], carry[TIME], carry[LAST] = 0.0, around.time, row
        pull = self._pull(plant, row, carry, around, 0.0)
        carry[FORCE] = pull.tau
        return plant, pull.bound

    def _row(self, plant: Any, row: Floats, around: Around, carry: Floats) -> tuple[Any, bool]:
        """Steps up to a reference row (9,) -> the plant's state, and whether limits bound."""
        start, span, bound = float(carry[TIME]), around.time - float(carry[TIME]), False
        change, n = row - carry[LAST], int(np.ceil(span / CONTROL_STEP - 1e-9))
        change[Eta.YAW] = wrap(float(change[Eta.YAW]))
        for j in range(n):
            h = span / n
            part = np.repeat([j / n, (j + 0.5) / n], [6, 3])
            now = around._replace(time=start + j * h)
            pull = self._pull(plant, carry[LAST] + part * change, carry, now, h)
            carry[INNER], carry[FORCE], bound = pull.inner, pull.tau, bound or pull.bound
            plant = self.plant.step(plant, pull.tau, now, h)
        if span > 0.0:
            carry[TIME], carry[LAST] = around.time, row
        return plant, bound

    def _pull(self, plant: Any, ref: Floats, carry: Floats, around: Around, h: float) -> _Pull:
        """τ_c for a reference row (9,); the integral grows by one step h unless limits bind."""
        gains: Gains = self.options.gains
        at, inner = self.plant.motion(plant), Velocity(*carry[INNER])
        nu_ref = reference_rate(Pose(*ref[:3]), Velocity(*ref[3:6]), at.pose, gains)
        error = (a - b for a, b in zip(nu_ref, at.velocity, strict=True))
        grown = Velocity(*(i + h * e for i, e in zip(inner, error, strict=True)))
        gamma = wanted_acceleration(nu_ref, Velocity(*ref[6:]), at.velocity, grown, gains)
        wanted = self.plant.required(plant, gamma, around)
        tau = Wrench(wanted.X, gains.sway * wanted.Y, wanted.N)
        if not len(self.limits.low):
            return _Pull(tau, grown, False)
        tau, bound = limited(tau, *self.limits)
        return _Pull(tau, inner if bound else grown, bound)
