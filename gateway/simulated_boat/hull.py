"""The true boat: one step of the model under the pulses that its outputs give.

Its commands are a table that repeats, a pure function of time. Built-in programs are the manoeuvres
of `sim.excitation`; a table of a user's own (CSV) names each actuator.

Sensors and the autopilot's estimate are the true state with their errors. The estimate errs as a
GNSS-aided filter does: a slow first-order Gauss-Markov error with a little white noise on top. The
gyro goes through the autopilot's second-order low-pass (INS_GYRO_FILTER), which delays it. The
sizes are chosen like those of a small autopilot, not fitted to one. Where an effect makes position
and velocity late, they are those of that moment: the boat remembers them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.signal import butter

from gateway.errors import BadInput, ShadowError
from gateway.offline.simulate import read_commands
from sim.body import Report
from sim.excitation import Manoeuvre, manoeuvre_commands
from sim.excitation.catalogue import BY_NAME, Circles, Mixed, Spin
from sim.hil import Battery
from sim.model import InputTable, Model, Runs
from sim.near_names import did_you_mean
from sim.plants.waves import GRAVITY
from sim.state import Floats, to_body, to_world
from sim.vessel import Vessel

STEP_S = 0.04
PROGRAMS: Mapping[str, Manoeuvre] = {**BY_NAME, "turns": Mixed((Circles(), Spin()))}


@dataclass(frozen=True)
class Program:
    """Row k of `rows` (R, na) acts from `starts` (R,) [s] on; after `period` all repeats."""

    starts: Floats
    rows: Floats
    period: float

    def row_at(self, time_s: float) -> int:
        """Which row acts at that moment; before the start it is the first."""
        into = max(time_s, 0.0) % self.period
        return int(np.searchsorted(self.starts, into, side="right")) - 1


def program_of(vessel: Vessel, wanted: str | Path = "mixed", seed: int = 0) -> Program:
    """A built-in program by its name, else a CSV of commands."""
    if str(wanted) in PROGRAMS:
        return _program(manoeuvre_commands(PROGRAMS[str(wanted)], vessel, STEP_S, seed))
    path = Path(wanted)
    if not path.exists():
        meant = did_you_mean(str(wanted), PROGRAMS)
        raise BadInput(
            f"{wanted}: {meant}neither a table of commands nor one of {', '.join(PROGRAMS)}"
        )
    times, rows = read_commands(path, vessel)
    return Program(times[:-1], rows[:-1], float(times[-1]))


def _program(commands: Floats) -> Program:
    """Commands (T, na) on a grid -> the rows that differ from the one before."""
    new = np.append(True, np.any(np.diff(commands, axis=0) != 0.0, axis=1))
    starts = STEP_S * np.flatnonzero(new).astype(float)
    return Program(starts, commands[new], STEP_S * len(commands))


ONE = np.ones(1, np.int64)


class ActuatorOutputs(NamedTuple):
    """The outputs at one moment: pulse of each actuator [µs], command that acts."""

    pulses: tuple[int, ...]
    command: Floats
    effort: float  # 0 … 1, share of the full current


class TrueState(NamedTuple):
    """The motion as error-free sensors report it, and specific force [m/s²]."""

    report: Report
    forward: float  # in the plane of the water, at the IMU
    starboard: float
    volts: float
    amperes: float


class GroundMotion(NamedTuple):
    """Position [m] and velocity over ground [m/s] of one moment."""

    north: float
    east: float
    north_mps: float
    east_mps: float


@dataclass(frozen=True)
class SimulatedHull:
    """A vessel under a program: state (nx,) -> state, what is true of it."""

    model: Model
    program: Program
    dt: float
    nominal_v: float

    @cached_property
    def battery(self) -> Battery:
        """Its size follows from the thrust."""
        return Battery.of(self.model.vessel, self.nominal_v)

    @cached_property
    def remembered(self) -> int:
        """The number of outputs that `step` needs: the present one and those that act late."""
        delay = self.model.delay
        return int(np.ceil(delay / self.dt)) + 2 if delay > 0.0 else 1

    @cached_property
    def age_s(self) -> float:
        """Of reported position and velocity over ground."""
        return float(self.model.ages(self.model.theta[None])[0])

    @cached_property
    def _theta(self) -> Floats:
        """Parameters of what is reported in time."""
        return self.model.in_time(self.model.theta[None])

    def late(
        self, track: tuple[GroundMotion, ...], report: Report
    ) -> tuple[tuple[GroundMotion, ...], Report]:
        """What is remembered of the way, the latest last, and a report of now with position and
        velocity as old as they are reported; before that the boat was where it began.
        """
        if self.age_s == 0.0:
            return track, report
        north, east = to_world(report.u, report.v, report.yaw)
        steps = self.age_s / self.dt
        whole = int(steps)
        track = (*track, GroundMotion(report.north, report.east, north, east))[-whole - 2 :]
        after, before = track[max(-1 - whole, -len(track))], track[max(-2 - whole, -len(track))]
        share = steps - whole
        then = GroundMotion(
            *(b * share + a * (1.0 - share) for a, b in zip(after, before, strict=True))
        )
        u, v = to_body(then.north_mps, then.east_mps, report.yaw)
        return track, report._replace(north=then.north, east=then.east, u=u, v=v)

    @cached_property
    def _table(self) -> list[ActuatorOutputs]:
        """Every row of the program, as whole microseconds; disarmed last."""
        neutral = np.zeros((1, self.program.rows.shape[1]))
        return [self._outputs(row) for row in np.vstack([self.program.rows, neutral])]

    def _outputs(self, row: Floats) -> ActuatorOutputs:
        servos = [actuator.servo for actuator in self.model.vessel.actuators]
        pulses = [round(float(s.pulse(c))) for s, c in zip(servos, row, strict=True)]
        acting = [float(s.command(np.array(p))) for s, p in zip(servos, pulses, strict=True)]
        thrusters = np.abs(acting[: len(self.model.vessel.thrusters)])
        return ActuatorOutputs(tuple(pulses), np.array(acting), float(np.mean(thrusters**1.5)))

    def outputs_at(self, time_s: float, armed: bool) -> ActuatorOutputs:
        """The outputs at that moment."""
        return self._table[self.program.row_at(time_s) if armed else -1]

    def start(self, pose: tuple[float, float, float]) -> Floats:
        """(nx,) at rest; memory states come with the first step."""
        state = np.full(self.model.state_size, np.nan)
        state[:6] = (*pose, 0.0, 0.0, 0.0)
        return state

    def step(
        self, state: Floats, tick: int, past: tuple[ActuatorOutputs, ...], used_as: float
    ) -> tuple[Floats, TrueState]:
        """State (nx,), the last `remembered` outputs with the present one last -> state, truth, of
        which nothing is late yet.
        """
        volts = self.battery.voltage(past[-1].effort, used_as)
        rows = np.array([outputs.command for outputs in past])[None]
        before = rows.shape[1] - 1
        inputs = InputTable.of(
            rows, self.dt, np.full(before + 1, volts), None, (tick - before) * self.dt
        )
        runs = Runs(0 * ONE, before * ONE, ONE, np.zeros(1))
        states, reports = self.model.run(state[None], runs, inputs, theta=self._theta)
        if not np.isfinite(states[0, 1]).all():
            raise ShadowError(
                f"{self.model.vessel.name}: its motion left all bounds after {tick * self.dt:.0f} "
                "s of play: check the signs of its damping and its effects"
            )
        forward, starboard = self._specific_force(states[0])
        amperes = self.battery.full_current * past[-1].effort
        report = Report(*reports[0, 0].tolist())
        return states[0, 1], TrueState(report, forward, starboard, volts, amperes)

    def _specific_force(self, states: Floats) -> tuple[float, float]:
        """Two states (2, nx) -> mean acceleration at the IMU, forward and starboard [m/s²]."""
        x, y = self.model.vessel.sensors.imu
        u, v, r = states[0, 3:6].tolist()
        u_dot, v_dot, r_dot = ((states[1, 3:6] - states[0, 3:6]) / self.dt).tolist()
        return u_dot - r * v - r_dot * y - r * r * x, v_dot + r * u + r_dot * x - r * r * y


GPS_AGE = 0.12  # s, of a receiver's solution when it is sent


class SensorError(NamedTuple):
    """Standard deviation and time constant [s] of the slow part, std of the white part."""

    std: float
    seconds: float
    white: float


class SensedValues(NamedTuple):
    """One number (or one kind of error) for everything that is sensed."""

    north: float  # m
    east: float
    yaw: float  # rad
    north_mps: float
    east_mps: float
    yaw_rate: float  # rad/s
    roll: float
    pitch: float
    forward: float  # specific force, m/s²
    starboard: float
    gps_north: float
    gps_east: float
    gps_north_mps: float
    gps_east_mps: float
    volts: float


ERRORS = {
    "north": SensorError(0.3, 60.0, 0.01),
    "east": SensorError(0.3, 60.0, 0.01),
    "yaw": SensorError(0.012, 120.0, 0.0006),
    "north_mps": SensorError(0.02, 2.0, 0.006),
    "east_mps": SensorError(0.02, 2.0, 0.006),
    "yaw_rate": SensorError(0.0004, 100.0, 0.003),
    "roll": SensorError(0.01, 1.5, 0.0005),
    "pitch": SensorError(0.006, 1.5, 0.0005),
    "forward": SensorError(0.02, 200.0, 0.08),
    "starboard": SensorError(0.02, 200.0, 0.08),
    "gps_north": SensorError(0.6, 30.0, 0.05),
    "gps_east": SensorError(0.6, 30.0, 0.05),
    "gps_north_mps": SensorError(0.05, 2.0, 0.03),
    "gps_east_mps": SensorError(0.05, 2.0, 0.03),
    "volts": SensorError(0.01, 10.0, 0.01),
}
TABLE = np.array([ERRORS[name] for name in SensedValues._fields])  # (n, 3)


@dataclass(frozen=True)
class SensorState:
    """Slow errors (n,), memory of the gyro's filter (2,)."""

    slow: Floats
    gyro: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class SensorModel:
    """The sensors of a boat, read every `dt` seconds."""

    dt: float
    noise: float
    gyro_filter_hz: float

    def start(self, rng: Generator) -> SensorState:
        """Slow errors as large as they will ever be."""
        return SensorState(self.noise * TABLE[:, 0] * rng.standard_normal(len(TABLE)))

    @cached_property
    def _decay(self) -> Floats:
        return np.exp(-self.dt / TABLE[:, 1])

    @cached_property
    def _step_std(self) -> Floats:
        return self.noise * TABLE[:, 0] * np.sqrt(1.0 - self._decay**2)

    @cached_property
    def _low_pass(self) -> tuple[list[float], list[float]] | None:
        """Numerator and denominator; None where the filter is off or faster than the loop."""
        if not 0.0 < self.gyro_filter_hz < 0.5 / self.dt:
            return None
        b, a = butter(2, self.gyro_filter_hz, fs=1.0 / self.dt)
        return b.tolist(), a.tolist()

    def read(
        self, state: SensorState, truth: TrueState, rng: Generator
    ) -> tuple[SensorState, SensedValues]:
        """One reading of everything."""
        normal = rng.standard_normal((2, len(TABLE)))
        slow = self._decay * state.slow + self._step_std * normal[0]
        errors = SensedValues._make((slow + self.noise * TABLE[:, 2] * normal[1]).tolist())
        memory, yaw_rate = self._filter_gyro(state.gyro, truth.report.r)
        ideal = _error_free(truth, yaw_rate, errors)
        sensed = SensedValues._make(v + e for v, e in zip(ideal, errors, strict=True))
        return SensorState(slow, memory), sensed

    def _filter_gyro(
        self, memory: tuple[float, float], x: float
    ) -> tuple[tuple[float, float], float]:
        """One step of the gyro's low-pass (transposed direct form II)."""
        if self._low_pass is None:
            return memory, x
        b, a = self._low_pass
        y = b[0] * x + memory[0]
        return (b[1] * x - a[1] * y + memory[1], b[2] * x - a[2] * y), y


def _error_free(truth: TrueState, yaw_rate: float, tilt: SensedValues) -> SensedValues:
    """Error-free values, on a hull that rolls and pitches by `tilt`."""
    motion = truth.report
    c, s = math.cos(motion.yaw), math.sin(motion.yaw)
    v_n, v_e = c * motion.u - s * motion.v, s * motion.u + c * motion.v
    ahead, side = motion.u_dot - motion.r * motion.v, motion.v_dot + motion.r * motion.u
    a_n, a_e = c * ahead - s * side, s * ahead + c * side
    return SensedValues(
        north=motion.north,
        east=motion.east,
        yaw=motion.yaw,
        north_mps=v_n,
        east_mps=v_e,
        yaw_rate=yaw_rate,
        roll=0.0,
        pitch=0.0,
        forward=truth.forward + GRAVITY * math.sin(tilt.pitch),
        starboard=truth.starboard - GRAVITY * math.sin(tilt.roll),
        gps_north=motion.north - GPS_AGE * v_n,
        gps_east=motion.east - GPS_AGE * v_e,
        gps_north_mps=v_n - GPS_AGE * a_n,
        gps_east_mps=v_e - GPS_AGE * a_e,
        volts=truth.volts,
    )
