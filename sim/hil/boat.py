"""The boat that an autopilot drives: pulses [µs], a state and dt [s] -> the next state, readings.

    pulses → commands → balance (3 degrees) + hydrostatics and waves (3 more) → sensors

Pure: the same pulses, steps and seed give the same readings. Nothing here knows a protocol.
"""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from math import atan2, cos, hypot, isfinite
from typing import Any, NamedTuple

import numpy as np

from sim.hil.battery import Battery, effort
from sim.hil.day import Day, Schedule, vessel_of_day
from sim.hil.inertial import Attitude, body_rates, specific_force, world_acceleration
from sim.hil.plant_hull import PlantHull
from sim.hil.sensors import Readings, noisy, with_errors
from sim.model import MIN_STABLE_STEP_S, Model
from sim.plants.hydrostatics import hull_shape
from sim.plants.table import OWN_VESSEL, PlantChoice
from sim.plants.waves import no_waves
from sim.state import Floats, to_body, to_world
from sim.vessel import Servo, Vessel

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
