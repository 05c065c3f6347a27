"""A vessel as a plant, step by step in plain Python: the same laws as the compiled loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.kernel.cache import plain_kernel_for
from sim.kernel.signatures import State
from sim.model import Model
from sim.plants.plant import Around, Motion
from sim.state import Pose, Velocity, Wrench


@dataclass(frozen=True)
class VesselPlant:
    """The balance of a vessel under a force; its own thrusters rest."""

    model: Model

    @property
    def name(self) -> str:
        """The vessel's name."""
        return self.model.vessel.name

    @property
    def _kernel(self) -> Any:
        return plain_kernel_for(self.model.kernel.structure).module

    @property
    def _numbers(self) -> Any:
        return self._kernel.unpack(self.model.theta)

    def _inputs(self, around: Around) -> Any:
        still = np.zeros(self.model.actuator_count)
        air = around.wind_north, around.wind_east
        return self._kernel.held(still, around.voltage, *air, self._numbers)

    def place(self, motion: Motion, around: Around) -> State:
        """A state with that pose and velocity, memory at rest."""
        memory = (0.0,) * (self.model.state_size - 6)
        x = (*motion.pose, *motion.velocity, *memory)
        at_rest = self._kernel.at_rest
        return at_rest(x, around.time, self._inputs(around), self._numbers)  # type: ignore[no-any-return]

    def motion(self, state: State) -> Motion:
        """Pose [m, m, rad] and velocity [m/s, m/s, rad/s] of a state."""
        return Motion(Pose(*state[:3]), Velocity(*state[3:6]))

    def acceleration(self, state: State, tau: Wrench, around: Around) -> Velocity:
        """ν̇ under a force [N, N, N m] -> [m/s², m/s², rad/s²]."""
        rates = self._kernel.pushed(state, around.time, self._inputs(around), tau, self._numbers)
        return Velocity(*rates[3:6])

    def required(self, state: State, nu_dot: Velocity, around: Around) -> Wrench:
        """The force that this ν̇ takes, from the balance [N, N, N m]."""
        inputs = self._inputs(around)
        force = self._kernel.required(state, *nu_dot, around.time, inputs, self._numbers)
        return Wrench(*force)

    def step(self, state: State, tau: Wrench, around: Around, dt: float) -> State:
        """One Runge–Kutta step under a constant force -> the state dt [s] later."""
        inputs = self._inputs(around)
        return self._kernel.push(state, around.time, inputs, tau, dt, self._numbers)  # type: ignore[no-any-return]
