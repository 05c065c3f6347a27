"""What a plant is: a simulated boat whose state changes by `step` alone.

A plant holds settings; its state is a value of whatever kind suits it (a tuple, a snapshot of a
physics engine) that goes in and comes out, so that a run can be repeated, cut and resumed. One that
also tells which force an acceleration takes is followed by inversion, any other by prediction. One
that moves in six degrees of freedom tells heave, roll and pitch too.

A vessel as a plant, step by step in plain Python: the same laws as the compiled loop.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from sim.kernel import State
from sim.kernel.cache import plain_kernel_for
from sim.model import Model
from sim.plants.waves import no_waves
from sim.state import Floats, Pose, Velocity, Wrench

CALM = no_waves()


class PlantInputs(NamedTuple):
    """Time, and what acts on the plant from outside during a step.

    waves  (K, 5) trains of `sim.plants.waves`, for plants of six degrees of freedom
    theta  (P,) numbers of its vessel at that time, where a day changes them
    """

    time: float  # s
    voltage: float  # V, NaN where not measured
    wind_north: float  # m/s, velocity of the air, NaN where not measured
    wind_east: float  # m/s
    waves: Floats = CALM
    theta: Floats | None = None


class PlantMotion(NamedTuple):
    """Pose and velocity over ground of the plant's body origin."""

    pose: Pose
    velocity: Velocity


class Afloat(NamedTuple):
    """Motion out of the plane: place, angles, their rates and accelerations; water at the boat."""

    down: float  # m
    roll: float  # rad
    pitch: float  # rad
    w: float  # m/s, down
    roll_rate: float  # rad/s, of the angle
    pitch_rate: float
    down_acc: float  # m/s²
    roll_acc: float  # rad/s²
    pitch_acc: float
    elevation: float  # m, up, of the water


class Plant(Protocol):
    """A simulated boat. Body frame FRD, world NED, SI units."""

    @property
    def name(self) -> str:
        """Name of this plant in messages."""
        ...

    @property
    def rewinds(self) -> bool:
        """Whether it can be stepped from any state again, not from the last alone."""
        ...

    def initial_state(self, motion: PlantMotion, inputs: PlantInputs) -> Any:
        """A state with that pose and velocity, everything else at rest."""
        ...

    def motion(self, state: Any) -> PlantMotion:
        """Pose [m, m, rad] and velocity [m/s, m/s, rad/s] of a state."""
        ...

    def acceleration(self, state: Any, tau: Wrench, inputs: PlantInputs) -> Velocity:
        """ν̇ of a state under a force [N, N, N m] -> [m/s², m/s², rad/s²]."""
        ...

    def step(self, state: Any, tau: Wrench, inputs: PlantInputs, dt: float) -> Any:
        """The state dt [s] later under a constant force [N, N, N m]."""
        ...


@runtime_checkable
class InvertiblePlant(Plant, Protocol):
    """A plant whose laws are known well enough to be inverted."""

    def required_force(self, state: Any, nu_dot: Velocity, inputs: PlantInputs) -> Wrench:
        """The force that this ν̇ takes: M ν̇ + C ν + D ν as well as it is known [N, N, N m]."""
        ...


@runtime_checkable
class FloatingPlant(Plant, Protocol):
    """A plant of six degrees of freedom."""

    def afloat(self, state: Any, tau: Wrench, inputs: PlantInputs) -> Afloat:
        """Heave, roll and pitch of a state under a force."""
        ...


@dataclass(frozen=True)
class VesselPlant:
    """The balance of a vessel under a force; its own thrusters give none."""

    model: Model

    @property
    def name(self) -> str:
        """The vessel's name."""
        return self.model.vessel.name

    @property
    def rewinds(self) -> bool:
        """Always: its state is a tuple."""
        return True

    @property
    def _kernel(self) -> Any:
        return plain_kernel_for(self.model.kernel.structure).module

    def _numbers(self, inputs: PlantInputs) -> Any:
        return self._kernel.unpack(self.model.theta if inputs.theta is None else inputs.theta)

    def _held(self, inputs: PlantInputs) -> Any:
        no_commands = np.zeros(self.model.actuator_count)
        return self._kernel.held_inputs(no_commands, *inputs[1:4], self._numbers(inputs))

    def initial_state(self, motion: PlantMotion, inputs: PlantInputs) -> State:
        """A state with that pose and velocity, memory settled without commands."""
        x = (*motion.pose, *motion.velocity, *(0.0,) * (self.model.state_size - 6))
        return self._kernel.settle_memory(x, inputs.time, self._held(inputs), self._numbers(inputs))

    def motion(self, state: State) -> PlantMotion:
        """Pose [m, m, rad] and velocity [m/s, m/s, rad/s] of a state."""
        return PlantMotion(Pose(*state[:3]), Velocity(*state[3:6]))

    def acceleration(self, state: State, tau: Wrench, inputs: PlantInputs) -> Velocity:
        """ν̇ under a force [N, N, N m] -> [m/s², m/s², rad/s²]."""
        rates = self._kernel.state_rates_under_force(
            state, inputs.time, self._held(inputs), tau, self._numbers(inputs)
        )
        return Velocity(*rates[3:6])

    def required_force(self, state: State, nu_dot: Velocity, inputs: PlantInputs) -> Wrench:
        """The force that this ν̇ takes, from the balance [N, N, N m]."""
        held = self._held(inputs)
        return self._kernel.required_wrench(
            state, *nu_dot, inputs.time, held, self._numbers(inputs)
        )

    def step(self, state: State, tau: Wrench, inputs: PlantInputs, dt: float) -> State:
        """One Runge–Kutta step under a constant force -> the state dt [s] later."""
        held = self._held(inputs)
        return self._kernel.rk4_step_under_force(
            state, inputs.time, held, tau, dt, self._numbers(inputs)
        )
