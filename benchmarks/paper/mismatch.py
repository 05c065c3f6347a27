"""A plant that is not what its follower believes: one vessel moves, another one is reckoned with.

    law:    τ_c = M̂ γ + Ĉ ν + D̂ ν        of the vessel that is believed in
    motion: M ν̇ = τ_c + τ_disturbance − C ν − D ν       of the vessel that moves

`VesselFollower` takes both from one vessel: there the model is perfect.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.following.follower import FollowerOptions
from sim.following.stepwise import PlantFollower
from sim.model import Model
from sim.plants.plant import Plant, PlantInputs, PlantMotion, VesselPlant
from sim.state import Floats, Velocity, Wrench
from sim.vessel import Vessel


@dataclass(frozen=True)
class Misjudged:
    """`true` moves; `believed` answers which force a wanted acceleration takes."""

    true: Plant
    believed: VesselPlant

    @classmethod
    def of(cls, true: Vessel, believed: Vessel) -> "Misjudged":
        """From two vessels."""
        return cls(VesselPlant(Model.of(true)), VesselPlant(Model.of(believed)))

    @property
    def name(self) -> str:
        """The name of what moves."""
        return self.true.name

    @property
    def rewinds(self) -> bool:
        """As what moves."""
        return self.true.rewinds

    def initial_state(self, motion: PlantMotion, inputs: PlantInputs) -> Any:
        """A state with that pose and velocity."""
        return self.true.initial_state(motion, inputs)

    def motion(self, state: Any) -> PlantMotion:
        """Pose and velocity of a state."""
        return self.true.motion(state)

    def acceleration(self, state: Any, tau: Wrench, inputs: PlantInputs) -> Velocity:
        """ν̇ of what moves."""
        return self.true.acceleration(state, tau, inputs)

    def required_force(self, state: Any, nu_dot: Velocity, inputs: PlantInputs) -> Wrench:
        """The force that this ν̇ would take if the belief were true."""
        same = self.believed.initial_state(self.true.motion(state), inputs)
        return self.believed.required_force(same, nu_dot, inputs)

    def step(self, state: Any, tau: Wrench, inputs: PlantInputs, dt: float) -> Any:
        """The state dt [s] later."""
        return self.true.step(state, tau, inputs, dt)


def followed(
    true: Vessel,
    believed: Vessel,
    reference: Floats,
    dt: float,
    options: FollowerOptions | None = None,
) -> Floats:
    """Reference (T, 9) every dt [s] -> shadow (T, 9) of a plant that is not what is believed."""
    follower = PlantFollower.of(Misjudged.of(true, believed), options)
    times: Floats = dt * np.arange(len(reference), dtype=np.float64)
    return follower.advance(follower.start(), times, reference).shadows
