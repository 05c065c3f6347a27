"""What a plant is: a simulated boat whose state changes by `step` alone.

A plant holds settings; its state is a value of whatever kind suits it (a tuple, a snapshot of a
physics engine) that goes in and comes out, so that a run can be repeated, cut and resumed.
"""

from typing import Any, NamedTuple, Protocol

from sim.state import Pose, Velocity, Wrench


class PlantInputs(NamedTuple):
    """Time, and what acts on the plant from outside during a step."""

    time: float  # s
    voltage: float  # V, NaN where not measured
    wind_north: float  # m/s, velocity of the air, NaN where not measured
    wind_east: float  # m/s


class PlantMotion(NamedTuple):
    """Pose and velocity over ground of the plant's body origin."""

    pose: Pose
    velocity: Velocity


class Plant(Protocol):
    """A simulated boat. Body frame FRD, world NED, SI units."""

    @property
    def name(self) -> str:
        """Name of this plant in messages."""
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

    def required_force(self, state: Any, nu_dot: Velocity, inputs: PlantInputs) -> Wrench:
        """The force that this ν̇ takes: M ν̇ + C ν + D ν as well as it is known [N, N, N m]."""
        ...

    def step(self, state: Any, tau: Wrench, inputs: PlantInputs, dt: float) -> Any:
        """The state dt [s] later under a constant force [N, N, N m]."""
        ...
