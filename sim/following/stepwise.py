"""The follower of any plant, step by step in Python: the same rows as the compiled loop.

For plants that cannot be compiled (a physics engine, an FMU); see `sim.following.loops`. One whose
laws can be inverted follows by the same law, any other by prediction (`sim.following.predictive`).
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.following import (
    MAX_SPEED_MPS,
    MAX_TURN_RADPS,
    commanded_acceleration,
    corrected_reference,
    is_possible,
    runs_on,
    within,
)
from sim.following.follower import (
    Follower,
    FollowerOptions,
    FollowerResult,
    FollowerState,
    ThrustLimits,
    VesselFollower,
)
from sim.following.loops import CONTROL_STEP, allocate_thrust
from sim.following.predictive import Control, Prediction
from sim.kernel import air, flags, floats, frozen
from sim.model import Model
from sim.plants import VESSEL, PlantKind
from sim.plants.plant import InvertiblePlant, Plant, PlantInputs, PlantMotion
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


class Controller(Protocol):
    """Chooses the force on a plant. Its memory is a value that goes in and comes out."""

    @property
    def longest_step(self) -> float:
        """How long a force may be held [s]."""
        ...

    def start(self) -> Any:
        """The memory before the first force."""
        ...

    def control(
        self, state: Any, ref: Floats, integral: Velocity, last: Wrench, inputs: PlantInputs,
        h: float, memory: Any,
    ) -> tuple[Control, Any]:  # fmt: skip
        """τ_c for a reference row (9,) that is to act for h [s] after the force `last`."""
        ...


@dataclass(frozen=True)
class Inversion:
    """The law of `sim.following` on a plant that tells which force an acceleration takes."""

    plant: InvertiblePlant
    options: FollowerOptions
    limits: ThrustLimits
    longest_step: float = CONTROL_STEP

    def start(self) -> None:
        """The state before the first row: an inversion remembers nothing."""

    def control(
        self, state: Any, ref: Floats, integral: Velocity, last: Wrench, inputs: PlantInputs,
        h: float, memory: None,
    ) -> tuple[Control, None]:  # fmt: skip
        """τ_c for a reference row (9,); the integral grows by one step h unless limits bind."""
        gains, at = self.options.gains, self.plant.motion(state)
        nu_ref = corrected_reference(Pose(*ref[:3]), Velocity(*ref[3:6]), at.pose, gains)
        error = (a - b for a, b in zip(nu_ref, at.velocity, strict=True))
        grown = Velocity(*(i + h * e for i, e in zip(integral, error, strict=True)))
        gamma = commanded_acceleration(nu_ref, Velocity(*ref[6:]), at.velocity, grown, gains)
        desired = self.plant.required_force(state, gamma, inputs)
        tau = Wrench(desired.X, gains.sway * desired.Y, desired.N)
        if not len(self.limits.low):
            return Control(tau, grown, False), None
        tau, limited = allocate_thrust(tau, *self.limits)
        return Control(tau, integral if limited else grown, limited), None


@dataclass(frozen=True)
class PlantFollower:
    """Follows with any plant."""

    plant: Plant
    controller: Controller

    @classmethod
    def of(
        cls, plant: Plant, options: FollowerOptions | None = None, vessel: Vessel | None = None
    ) -> "PlantFollower":
        """Follow with that plant; thrust limits, and how much is much, are those of `vessel`."""
        chosen = options or FollowerOptions()
        if vessel is None and (chosen.limits or not isinstance(plant, InvertiblePlant)):
            raise ValueError(f"following with limits: whose thrusters drive {plant.name}?")
        if not isinstance(plant, InvertiblePlant):
            assert vessel is not None
            return cls(plant, Prediction.of(plant, chosen, vessel))
        limits = ThrustLimits.of(vessel) if chosen.limits and vessel else ThrustLimits.none()
        return cls(plant, Inversion(plant, chosen, limits))

    def start(self) -> FollowerState:
        """The state before the first reference."""
        carry = np.zeros(16)
        carry[TIME] = np.nan
        return FollowerState(frozen(carry), None, self.controller.start())

    def prepare(self) -> None:
        """Move once, in case the plant compiles or loads something then."""
        self.advance(self.start(), np.array([0.0, 1e-3]), np.zeros((2, 9)))

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
        plant, memory = state.plant, state.controller
        shadows, forces = np.empty((count, 9)), np.empty((count, 3))
        limited, diverged = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        leaps = flags(jumps, count)
        volts, winds = air(voltage, wind, count)
        for k, (time, row) in enumerate(zip(times.tolist(), floats(references), strict=True)):
            inputs = PlantInputs(time, volts[k], winds[k, 0], winds[k, 1])
            if leaps[k] or not runs_on(time, carry[TIME]):
                plant, memory, limited[k] = self._initialise(row, inputs, carry)
            plant, memory, clipped = self._advance_row(plant, memory, row, inputs, carry)
            limited[k] |= clipped
            if not is_possible(*self.plant.motion(plant).velocity):
                diverged[k] = True
                before = inputs._replace(time=carry[TIME])
                plant, memory, _ = self._initialise(row, before, carry)
            tau, now = Wrench(*carry[FORCE]), inputs._replace(time=carry[TIME])
            motion = self.plant.motion(plant)
            shadows[k] = *motion.pose, *motion.velocity, *self.plant.acceleration(plant, tau, now)
            forces[k] = tau
        state = FollowerState(frozen(carry), plant, memory)
        return FollowerResult(state, shadows, forces, limited, diverged)

    def _initialise(self, row: Floats, inputs: PlantInputs, carry: Floats) -> tuple[Any, Any, bool]:
        """The plant set to a reference row (9,) -> state, controller's memory, do limits bind."""
        u, v, r = row[3:6]
        velocity = Velocity(
            within(u, MAX_SPEED_MPS), within(v, MAX_SPEED_MPS), within(r, MAX_TURN_RADPS)
        )
        motion = PlantMotion(Pose(*row[:3]), velocity)
        plant = self.plant.initial_state(motion, inputs)
        carry[INTEGRAL], carry[TIME], carry[LAST] = 0.0, inputs.time, row
        control, memory = self.controller.control(
            plant, row, Velocity(0.0, 0.0, 0.0), Wrench(0.0, 0.0, 0.0), inputs, 0.0,
            self.controller.start(),
        )  # fmt: skip
        carry[FORCE] = control.tau
        return plant, memory, control.limited

    def _advance_row(
        self, plant: Any, memory: Any, row: Floats, inputs: PlantInputs, carry: Floats
    ) -> tuple[Any, Any, bool]:
        """Steps up to a reference row (9,) -> state, controller's memory, did limits bind."""
        start, span, limited = float(carry[TIME]), inputs.time - float(carry[TIME]), False
        change = row - carry[LAST]
        n = int(np.ceil(span / self.controller.longest_step - 1e-9))
        change[Eta.YAW] = wrap(float(change[Eta.YAW]))
        for j in range(n):
            h = span / n
            part = np.repeat([j / n, (j + 0.5) / n], [6, 3])
            now = inputs._replace(time=start + j * h)
            control, memory = self.controller.control(
                plant, carry[LAST] + part * change, Velocity(*carry[INTEGRAL]),
                Wrench(*carry[FORCE]), now, h, memory,
            )  # fmt: skip
            carry[INTEGRAL], carry[FORCE] = control.integral, control.tau
            limited = limited or control.limited
            plant = self.plant.step(plant, control.tau, now, h)
        if span > 0.0:
            carry[TIME], carry[LAST] = inputs.time, row
        return plant, memory, limited
