"""The boat that an autopilot drives: pulses [µs], a state and dt [s] -> the next state, readings.

    pulses → commands → balance (3 degrees) + hydrostatics and waves (3 more) → sensors

Pure: the same pulses, steps and seed give the same readings. Nothing here knows a protocol.

**Any plant as its hull**:

    commands → the vessel's actuators → force → plant.step → motion

Actuators, sensors and effects on either are the vessel's; hull and water are the plant's. A plant
of three degrees of freedom is pushed by the waves and heaves, rolls and pitches as
`sim.hil.loops.step_afloat` has it, one of six does that by itself.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2, cos, hypot, isfinite
from typing import Any, NamedTuple

import numpy as np

from sim.hil import (
    Attitude,
    Battery,
    Readings,
    body_rates,
    effort,
    noisy,
    specific_force,
    with_errors,
    world_acceleration,
)
from sim.hil.day import Day, Schedule, vessel_of_day
from sim.kernel.compiled import compiled
from sim.model import MIN_STABLE_STEP_S, Model
from sim.plants import OWN_VESSEL, PlantChoice
from sim.plants.plant import FloatingPlant, Plant, PlantInputs, PlantMotion
from sim.plants.waves import HullShape, hull_shape, no_waves, oscillator_step, wave_load
from sim.state import Floats, Pose, Velocity, Wrench, to_body, to_world
from sim.vessel import Servo, Vessel

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


NOMINAL_V = 14.8
OUT = 32  # numbers that one compiled step reports


class BoatState(NamedTuple):
    """Everything that a boat remembers.

    row      (nx + 6,) state of the vessel, then heave, roll, pitch with their rates
    plant    state of the plant that moves the hull; None: the vessel itself
    past     moments and commands that may still act (none but the last unless commands are late)
    """

    time: float  # s since the start
    number: int  # steps since the start
    row: Floats
    past: tuple[tuple[float, tuple[float, ...]], ...]
    used_as: float  # charge drawn from the battery [A s]
    voltage: float  # V
    plant: Any = None


class Truth(NamedTuple):
    """The boat as it is: what no sensor tells without error, and no inference may read."""

    time: float  # s since the start
    u: float  # m/s over ground, in the plane of the water
    v: float
    r: float  # rad/s, of the yaw angle
    u_dot: float  # m/s²
    v_dot: float
    r_dot: float  # rad/s²
    north: float  # m
    east: float
    yaw: float  # rad
    down: float  # m
    roll: float  # rad
    pitch: float
    w: float  # m/s, down
    roll_rate: float  # rad/s, of the angle
    pitch_rate: float
    water_north: float  # m/s, velocity of the water
    water_east: float
    wind_north: float  # m/s, velocity of the air; 0 where there is none
    wind_east: float
    elevation: float  # m, up, of the water at the boat
    X: float  # N, of the actuators as commanded
    Y: float
    N: float  # N m
    wave_X: float  # N, of the waves
    wave_Y: float
    wave_N: float  # N m
    voltage: float  # V


@dataclass(frozen=True)
class Boat:
    """A vessel on one day. `step` is all that moves it."""

    model: Model
    day: Day
    schedule: Schedule
    battery: Battery
    waves: Floats
    shape: Floats
    seed: int
    longest_step: float
    hull: PlantHull | None = None

    @classmethod
    def of(
        cls, vessel: Vessel, day: Day | None = None, seed: int = 0,
        plant: PlantChoice = OWN_VESSEL,
    ) -> "Boat":  # fmt: skip
        """Compile, and take one step so that nothing is left to compile later.

        `plant` moves under the vessel's actuators; ValueError where it cannot.
        """
        day = day or Day()
        model = Model.of(vessel_of_day(vessel, day))
        h = vessel.hull
        shape = np.array(
            hull_shape(h.length, h.beam, h.mass, h.waterplane_area, h.metacentric_heights)
        )
        waves = day.sea.trains(seed) if day.sea is not None else no_waves()
        boat = cls(
            model,
            day,
            Schedule(model, day),
            Battery.of(vessel, NOMINAL_V),
            waves,
            shape,
            seed,
            min(model.max_step(None, np.zeros((1, 3))), MIN_STABLE_STEP_S),
            None
            if plant == OWN_VESSEL
            else PlantHull.of(plant.kind.build, plant.vessel, model, day, waves, shape),
        )
        boat.step(boat.start(), {}, 0.01)
        return boat

    @property
    def vessel(self) -> Vessel:
        """The vessel with the effects of its day."""
        return self.model.vessel

    def start(self) -> BoatState:
        """At rest where the day begins, all commands neutral."""
        row = np.full(self.model.state_size + 6, np.nan)
        row[:6] = (*self.day.start, 0.0, 0.0, 0.0)
        row[self.model.state_size :] = 0.0
        neutral = (0.0,) * self.model.actuator_count
        full = self.battery.voltage(0.0, 0.0)
        plant = None if self.hull is None else self.hull.start(self.day.start)
        return BoatState(0.0, 0, row, ((0.0, neutral),), 0.0, full, plant)

    def commands(self, pulses: Mapping[int, float]) -> tuple[float, ...]:
        """Pulse widths [µs] by channel -> commands −1 … 1; a channel that is not there gives 0."""
        return tuple(
            command_of(actuator.servo, pulses.get(actuator.servo.channel, 0.0))
            for actuator in self.vessel.actuators
        ) or (0.0,)

    def step(
        self, state: BoatState, pulses: Mapping[int, float], dt: float
    ) -> tuple[BoatState, Readings, Truth]:
        """Pulse widths [µs] by channel, held over dt [s] -> state, readings and truth after it."""
        given = self.commands(pulses)
        past = self._remembered(state, given)
        acting = past[0][1] if self.model.delay > 0.0 else given
        share = effort(given[: len(self.vessel.thrusters)])
        used_as = state.used_as + self.battery.full_current * share * dt
        voltage = self.battery.voltage(share, used_as)
        theta, wind, _ = self.schedule.at(state.time)
        row, out, plant = state.row.copy(), np.empty(OUT), state.plant
        air = np.array([voltage, wind[0], wind[1]])
        if self.hull is not None:
            plant = self.hull.step(
                plant, row, theta, np.array(acting), air, state.time, dt, out
            )  # fmt: skip
        else:
            self.model.kernel.module.step_afloat(
                theta, row, np.array(acting), air, self.shape, self.waves, state.time, dt,
                max(int(np.ceil(dt / self.longest_step - 1e-9)), 1), out,
            )  # fmt: skip
        after = BoatState(state.time + dt, state.number + 1, row, past, used_as, voltage, plant)
        truth = self._truth(after, out.tolist(), wind)
        if not isfinite(sum(truth)):
            raise ArithmeticError(
                f"{self.vessel.name}: its motion left all bounds {after.time:.0f} s after the "
                "start: check the signs of its damping and its effects"
            )
        return after, self._readings(after, truth, out.tolist(), dt, share), truth

    def _remembered(
        self, state: BoatState, given: tuple[float, ...]
    ) -> tuple[tuple[float, tuple[float, ...]], ...]:
        """Commands with their moments, the first of them the one that acts now."""
        past = (*state.past, (state.time, given))
        at = bisect_right(past, state.time - self.model.delay, key=lambda entry: entry[0])
        return past[max(at - 1, 0) :]

    def _truth(self, state: BoatState, out: list[float], wind: Floats) -> Truth:
        heave, w, roll, roll_rate, pitch, pitch_rate = state.row[-6:].tolist()
        known = isfinite(wind[0])
        return Truth._make((
            state.time, *out[3:9], *out[:3], heave, roll, pitch, w, roll_rate, pitch_rate,
            out[22], out[23], float(wind[0]) if known else 0.0,
            float(wind[1]) if known else 0.0, out[21], *out[24:30], state.voltage,
        ))  # fmt: skip

    def _readings(
        self, state: BoatState, t: Truth, out: list[float], dt: float, share: float
    ) -> Readings:
        """What the sensors read: heading, position, velocity and yaw rate as the vessel reports."""
        north, east, yaw, u, v, r = out[9:15]
        heave_acc, roll_acc, pitch_acc = out[18:21]
        true = Attitude(t.roll, t.pitch, t.yaw, t.roll_rate, t.pitch_rate, t.r, roll_acc,
                        pitch_acc, t.r_dot)  # fmt: skip
        acceleration = world_acceleration(t.u, t.v, t.r, t.u_dot, t.v_dot, t.yaw)
        over_ground = to_world(u, v, yaw)
        sensors = self.vessel.sensors
        readings = Readings(
            state.time,
            body_rates(true._replace(yaw_rate=r)),
            specific_force(true, (*acceleration, heave_acc), sensors.imu),
            (north, east, t.down),
            (float(over_ground[0]), float(over_ground[1]), t.w),
            (t.roll, t.pitch, yaw),
            *self._air(state.time, t),
            state.voltage,
            self.battery.full_current * share,
            self._depth(t),
        )
        if noisy(sensors):
            return with_errors(readings, sensors, self.seed, state.number, dt)
        return readings

    def _air(
        self, time: float, t: Truth
    ) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """True wind, and what the vane sees of it on the moving hull; None without wind."""
        if not isfinite(self.schedule.at(time)[1][0]):
            return None, None
        u_w, v_w = to_body(t.wind_north, t.wind_east, t.yaw)
        ahead, side = t.u - u_w, t.v - v_w  # it comes from where the hull moves to through it
        return (t.wind_north, t.wind_east), (atan2(side, ahead), hypot(ahead, side))

    def _depth(self, t: Truth) -> float | None:
        if self.day.depth is None:
            return None
        return max(self.day.depth - t.down, 0.0) / max(cos(t.roll) * cos(t.pitch), 0.1)


def command_of(servo: Servo, pulse: float) -> float:
    """`Servo.command` of one number, without arrays: it is called for every reply."""
    low, neutral, high = servo.pwm
    if not (isfinite(pulse) and 0.0 < pulse < 65535.0):
        return 0.0
    span = high - neutral if pulse >= neutral else neutral - low
    if span > 0.0:
        command = max(-1.0, min(1.0, (pulse - neutral) / span))
    else:
        command = -1.0 if pulse < neutral else 0.0  # as `np.interp` has it
    return -command if servo.reversed else command
