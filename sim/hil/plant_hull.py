"""Any plant as the hull of a boat that an autopilot drives.

    commands → the vessel's actuators → force → plant.step → motion

Actuators, sensors and effects on either are the vessel's; hull and water are the plant's. A plant
of three degrees of freedom is pushed by the waves and heaves, rolls and pitches as
`sim.hil.loops.step_afloat` has it, one of six does that by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.hil.day import Day, Schedule, vessel_of_day
from sim.kernel.compiled import compiled
from sim.model import Model
from sim.plants.hydrostatics import HullShape, oscillator_step
from sim.plants.plant import FloatingPlant, Plant, PlantInputs, PlantMotion
from sim.plants.waves import wave_load
from sim.state import Floats, Pose, Velocity, Wrench
from sim.vessel import Vessel

LONGEST_STEP_S = 0.02  # for which the force of the actuators is held


@dataclass(frozen=True)
class PlantHull:
    """A plant under the actuators of `model`; `schedule`: the numbers of the plant's own vessel."""

    plant: Plant
    model: Model
    schedule: Schedule
    waves: Floats
    shape: Floats

    @classmethod
    def of(
        cls, build: Callable[[Model], Plant], own: Vessel | None, boat: Model, day: Day,
        waves: Floats, shape: Floats,
    ) -> "PlantHull":  # fmt: skip
        """A plant made from the boat's model, or from that of a vessel of its own, on that day."""
        model = boat if own is None else Model.of(vessel_of_day(own, day))
        return cls(build(model), boat, Schedule(model, day), waves, shape)

    def start(self, pose: tuple[float, float, float]) -> Any:
        """The plant at rest there."""
        still = PlantMotion(Pose(*pose), Velocity(0.0, 0.0, 0.0))
        return self.plant.initial_state(still, self._inputs(0.0, np.full(3, np.nan)))

    def step(
        self, state: Any, row: Floats, theta: Floats, commands: Floats, air: Floats, time: float,
        dt: float, out: Floats,
    ) -> Any:  # fmt: skip
        """The plant dt [s] later; row (NX + 6,) and out (32,) as `step_afloat` leaves them."""
        count = max(int(np.ceil(dt / LONGEST_STEP_S - 1e-9)), 1)
        h, floats = dt / count, isinstance(self.plant, FloatingPlant)
        for i in range(count if dt > 0.0 else 0):
            t = time + i * h
            tau = self._drive(theta, row, commands, air, t, h, np.zeros(9))[:3]
            if not floats:
                tau = tau + self._oscillate(row, t, h)[:3]
            state = self.plant.step(state, Wrench(*tau.tolist()), self._inputs(t, air), h)
            pose, velocity = self.plant.motion(state)
            row[:6] = *pose, *velocity
        self._report(state, row, theta, commands, air, time + dt, floats, out)
        return state

    def _report(
        self, state: Any, row: Floats, theta: Floats, commands: Floats, air: Floats, time: float,
        floats: bool, out: Floats,
    ) -> None:  # fmt: skip
        inputs, nx = self._inputs(time, air), self.model.state_size
        driven = self._drive(theta, row, commands, air, time, 0.0, np.zeros(9))
        load = np.zeros(7) if floats else self._oscillate(row, time, 0.0)
        tau = Wrench(*(driven[:3] + load[:3]).tolist())
        motion = np.array((*row[:6], *self.plant.acceleration(state, tau, inputs)))
        out[:9] = motion
        out[9:18] = self._drive(theta, row, commands, air, time, 0.0, motion)[3:12]
        out[18:21], out[21] = load[3:6], load[6]
        if isinstance(self.plant, FloatingPlant):
            at = self.plant.afloat(state, tau, inputs)
            row[nx:] = at.down, at.w, at.roll, at.roll_rate, at.pitch, at.pitch_rate
            out[18:22] = at.down_acc, at.roll_acc, at.pitch_acc, at.elevation
        out[22:24], out[24:27], out[27:30] = driven[12:14], driven[:3], load[:3]

    def _inputs(self, time: float, air: Floats) -> PlantInputs:
        theta, _, _ = self.schedule.at(time)
        voltage, north, east = air.tolist()
        return PlantInputs(time, voltage, north, east, self.waves, theta)

    def _drive(
        self, theta: Floats, row: Floats, commands: Floats, air: Floats, time: float, h: float,
        motion: Floats,
    ) -> Floats:  # fmt: skip
        out = np.empty(14)
        self.model.kernel.module.drive(theta, row, commands, air, motion, time, h, out)
        return out

    def _oscillate(self, row: Floats, time: float, h: float) -> Floats:
        out = np.empty(7)
        oscillate(row[:3], row[self.model.state_size :], self.shape, self.waves, time, h, out)
        return out


@compiled
def oscillate(
    place: Floats, q: Floats, shape_row: Floats, waves: Floats, time: float, h: float, out: Floats
) -> None:
    """Heave, roll and pitch h [s] later, the load of the waves held at that of the middle.

    place (3,): north, east, yaw; q (6,): z, ż, φ, φ̇, θ, θ̇, changed in place; shape_row (12,) of
    `HullShape` -> out (7,): X, Y, N of the waves, z̈, φ̈, θ̈ after the step, elevation [m].
    """
    s = HullShape(
        shape_row[0], shape_row[1], shape_row[2], shape_row[3], shape_row[4], shape_row[5],
        shape_row[6], shape_row[7], shape_row[8], shape_row[9], shape_row[10], shape_row[11],
    )  # fmt: skip
    load = wave_load(waves, s, place[0], place[1], place[2], time + 0.5 * h)
    if h > 0.0:
        q[0], q[1] = oscillator_step(q[0], q[1], load.heave, s.heave_rate, s.heave_damping, h)
        q[2], q[3] = oscillator_step(q[2], q[3], load.roll, s.roll_rate, s.roll_damping, h)
        q[4], q[5] = oscillator_step(q[4], q[5], load.pitch, s.pitch_rate, s.pitch_damping, h)
    out[0], out[1], out[2] = load.X, load.Y, load.N
    out[3] = s.heave_rate**2 * (load.heave - q[0]) - 2.0 * s.heave_damping * s.heave_rate * q[1]
    out[4] = s.roll_rate**2 * (load.roll - q[2]) - 2.0 * s.roll_damping * s.roll_rate * q[3]
    out[5] = s.pitch_rate**2 * (load.pitch - q[4]) - 2.0 * s.pitch_damping * s.pitch_rate * q[5]
    out[6] = load.elevation
