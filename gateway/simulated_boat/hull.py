"""The true boat: one step of the model under the pulses that its outputs give."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gateway.errors import ShadowError
from gateway.simulated_boat.program import Program
from sim.body import Report
from sim.model import InputTable, Model, Runs
from sim.state import Floats

ONE = np.ones(1, np.int64)
FULL_POWER_W_PER_N = 4.0  # electrical, of small propellers
SAG, DRAINED = 0.06, 0.15  # share of the voltage lost at full current; when empty
ENDURANCE_S = 3600.0  # at full current


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


@dataclass(frozen=True)
class SimulatedHull:
    """A vessel under a program: state (nx,) -> state, what is true of it."""

    model: Model
    program: Program
    dt: float
    nominal_v: float

    @cached_property
    def full_current(self) -> float:
        """All thrusters full ahead [A]."""
        thrust = sum(thruster.thrust[1] for thruster in self.model.vessel.thrusters)
        return FULL_POWER_W_PER_N * thrust / self.nominal_v

    @cached_property
    def remembered(self) -> int:
        """The number of outputs that `step` needs: the present one and those that act late."""
        delay = self.model.delay
        return int(np.ceil(delay / self.dt)) + 2 if delay > 0.0 else 1

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
        """State (nx,), the last `remembered` outputs with the present one last -> state, truth."""
        volts = self._volts(past[-1].effort, used_as)
        rows = np.array([outputs.command for outputs in past])[None]
        before = rows.shape[1] - 1
        inputs = InputTable.of(
            rows, self.dt, np.full(before + 1, volts), None, (tick - before) * self.dt
        )
        runs = Runs(0 * ONE, before * ONE, ONE, np.zeros(1))
        states, reports = self.model.run(state[None], runs, inputs)
        if not np.isfinite(states[0, 1]).all():
            raise ShadowError(
                f"{self.model.vessel.name}: its motion left all bounds after {tick * self.dt:.0f} "
                "s of play: check the signs of its damping and its effects"
            )
        forward, starboard = self._specific_force(states[0])
        amperes = self.full_current * past[-1].effort
        report = Report(*reports[0, 0].tolist())
        return states[0, 1], TrueState(report, forward, starboard, volts, amperes)

    def _volts(self, effort: float, used_as: float) -> float:
        drained = min(used_as / (self.full_current * ENDURANCE_S), 1.0)
        return self.nominal_v * (1.1 - SAG * effort - DRAINED * drained)

    def _specific_force(self, states: Floats) -> tuple[float, float]:
        """Two states (2, nx) -> mean acceleration at the IMU, forward and starboard [m/s²]."""
        x, y = self.model.vessel.sensors.imu
        u, v, r = states[0, 3:6].tolist()
        u_dot, v_dot, r_dot = ((states[1, 3:6] - states[0, 3:6]) / self.dt).tolist()
        return u_dot - r * v - r_dot * y - r * r * x, v_dot + r * u + r_dot * x - r * r * y
