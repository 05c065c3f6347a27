"""The follower of any plant, step by step in Python: the same law and rows as the compiled loop.

For plants that cannot be compiled (a physics engine, an FMU); see `sim.following.loops`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.following.bounds import MAX_SPEED_MPS, MAX_TURN_RADPS, is_possible, runs_on, within
from sim.following.follower import (
    Follower,
    FollowerOptions,
    FollowerResult,
    FollowerState,
    ThrustLimits,
    VesselFollower,
)
from sim.following.law import commanded_acceleration, corrected_reference
from sim.following.loops import CONTROL_STEP, allocate_thrust
from sim.kernel.arrays import air, flags, floats, frozen
from sim.model import Model
from sim.plants.plant import Plant, PlantInputs, PlantMotion
from sim.plants.table import VESSEL, PlantKind
from sim.state import Eta, Floats, Pose, Velocity, Wrench, wrap
from sim.vessel import Vessel

INTEGRAL, FORCE, TIME, LAST = slice(0, 3), slice(3, 6), 6, slice(7, 16)  # parts of the carried row


def follower_for(
    model: Model, options: FollowerOptions | None = None, kind: PlantKind = VESSEL
) -> Follower:
    """A follower that drives a plant of that kind, made from the model of a vessel.

    A vessel whose laws numba compiles takes the compiled loop. Thrust limits are the vessel's.
    """
    if kind is VESSEL and model.kernel.compiled:
        return VesselFollower.of(model, options)
    return PlantFollower.of(kind.build(model), options, model.vessel)


class _Control(NamedTuple):
    """A force, the integral of e with it, and whether thrust limits bind."""

    tau: Wrench
    integral: Velocity
    limited: bool


@dataclass(frozen=True)
class PlantFollower:
    """Follows with any plant."""

    plant: Plant
    options: FollowerOptions
    limits: ThrustLimits

    @classmethod
    def of(
        cls, plant: Plant, options: FollowerOptions | None = None, vessel: Vessel | None = None
    ) -> "PlantFollower":
        """Follow with that plant; thrust limits are those of `vessel`."""
        chosen = options or FollowerOptions()
        if chosen.limits and vessel is None:
            raise ValueError(f"following with limits: whose thrusters drive {plant.name}?")
        limits = ThrustLimits.of(vessel) if chosen.limits and vessel else ThrustLimits.none()
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
    ) -> FollowerResult:
        """References (K, 9) at times (K,) [s] -> the shadow there, see `Follower`."""
        count, carry, plant = len(times), state.carry.copy(), state.plant
        shadows, forces = np.empty((count, 9)), np.empty((count, 3))
        limited, diverged = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        leaps = flags(jumps, count)
        volts, winds = air(voltage, wind, count)
        for k, (time, row) in enumerate(zip(times.tolist(), floats(references), strict=True)):
            inputs = PlantInputs(time, volts[k], winds[k, 0], winds[k, 1])
            if leaps[k] or not runs_on(time, carry[TIME]):
                plant, limited[k] = self._initialise(row, inputs, carry)
            plant, clipped = self._advance_row(plant, row, inputs, carry)
            limited[k] |= clipped
            if not is_possible(*self.plant.motion(plant).velocity):
                diverged[k] = True
                plant, _ = self._initialise(row, inputs._replace(time=carry[TIME]), carry)
            tau, now = Wrench(*carry[FORCE]), inputs._replace(time=carry[TIME])
            motion = self.plant.motion(plant)
            shadows[k] = *motion.pose, *motion.velocity, *self.plant.acceleration(plant, tau, now)
            forces[k] = tau
        state = FollowerState(frozen(carry), plant)
        return FollowerResult(state, shadows, forces, limited, diverged)

    def _initialise(self, row: Floats, inputs: PlantInputs, carry: Floats) -> tuple[Any, bool]:
        """The plant set to a reference row (9,) -> its state, and whether limits bind."""
        u, v, r = row[3:6]
        velocity = Velocity(
            within(u, MAX_SPEED_MPS), within(v, MAX_SPEED_MPS), within(r, MAX_TURN_RADPS)
        )
        motion = PlantMotion(Pose(*row[:3]), velocity)
        plant = self.plant.initial_state(motion, inputs)
        carry[INTEGRAL], carry[TIME], carry[LAST] = 0.0, inputs.time, row
        control = self._control(plant, row, carry, inputs, 0.0)
        carry[FORCE] = control.tau
        return plant, control.limited

    def _advance_row(
        self, plant: Any, row: Floats, inputs: PlantInputs, carry: Floats
    ) -> tuple[Any, bool]:
        """Steps up to a reference row (9,) -> the plant's state, and whether limits bound."""
        start, span, limited = float(carry[TIME]), inputs.time - float(carry[TIME]), False
        change, n = row - carry[LAST], int(np.ceil(span / CONTROL_STEP - 1e-9))
        change[Eta.YAW] = wrap(float(change[Eta.YAW]))
        for j in range(n):
            h = span / n
            part = np.repeat([j / n, (j + 0.5) / n], [6, 3])
            now = inputs._replace(time=start + j * h)
            control = self._control(plant, carry[LAST] + part * change, carry, now, h)
            carry[INTEGRAL], carry[FORCE] = control.integral, control.tau
            limited = limited or control.limited
            plant = self.plant.step(plant, control.tau, now, h)
        if span > 0.0:
            carry[TIME], carry[LAST] = inputs.time, row
        return plant, limited

    def _control(
        self, plant: Any, ref: Floats, carry: Floats, inputs: PlantInputs, h: float
    ) -> _Control:
        """τ_c for a reference row (9,); the integral grows by one step h unless limits bind."""
        gains = self.options.gains
        at, integral = self.plant.motion(plant), Velocity(*carry[INTEGRAL])
        nu_ref = corrected_reference(Pose(*ref[:3]), Velocity(*ref[3:6]), at.pose, gains)
        error = (a - b for a, b in zip(nu_ref, at.velocity, strict=True))
        grown = Velocity(*(i + h * e for i, e in zip(integral, error, strict=True)))
        gamma = commanded_acceleration(nu_ref, Velocity(*ref[6:]), at.velocity, grown, gains)
        desired = self.plant.required_force(plant, gamma, inputs)
        tau = Wrench(desired.X, gains.sway * desired.Y, desired.N)
        if not len(self.limits.low):
            return _Control(tau, grown, False)
        tau, limited = allocate_thrust(tau, *self.limits)
        return _Control(tau, integral if limited else grown, limited)
