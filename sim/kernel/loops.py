"""The loops around the composed laws: integration, inversion of the sensors, free runs, balance.

`sim.kernel.generator` copies the text below the mark into every kernel, where `jit` and `entry`
compile; in plain Python they leave the functions as they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.body import HeldInputs, Report
from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.kernel.rows import (
    apply_latency,
    integral_at,
    motion_of_state,
    report_from,
    set_row,
)
from sim.sensing import inversion_step, reports_agree
from sim.state import Floats, Wrench

if TYPE_CHECKING:
    from sim.kernel import (
        NX,
        Numbers,
        State,
        axpy,
        balance,
        delay_of,
        flow_at,
        latency_of,
        observe,
        observe_undelayed,
        settle_memory,
        state_from,
        state_rates,
        state_rates_under_force,
        static_actuation,
        unpack,
        water_at,
    )
    from sim.state import Pose

# -- the text from here on goes into the kernel --

MAX_INVERSION_STEPS = 200  # a receiver that is 0.3 s late takes 60 at 2 rad/s


@jit
def rk4_step(x: State, k1: State, t: float, inputs: HeldInputs, h: float, p: Numbers) -> State:
    """One step of classical Runge–Kutta of fourth order from a state and its rates k1.

    Its stages are a loop, for each call of `state_rates` in the text is a copy of all laws to
    compile.
    """
    after, k = axpy(x, h / 6, k1), k1
    for stage in range(3):
        reach, weight = (h, h / 6) if stage == 2 else (0.5 * h, h / 3)
        k = state_rates(axpy(x, reach, k), t + reach, inputs, p)
        after = axpy(after, weight, k)
    return after


@jit
def advance(
    x: State, time: float, inputs: HeldInputs, dt: float, substeps: int, p: Numbers
) -> State:
    """One interval of held inputs in equal steps -> the next state."""
    h = dt / substeps
    for i in range(substeps):
        x = rk4_step(x, state_rates(x, time + i * h, inputs, p), time + i * h, inputs, h, p)
    return x


@jit
def report_of_state(x: State, time: float, inputs: HeldInputs, p: Numbers) -> Report:
    """What the sensors report of a state, accelerations included."""
    return observe(motion_of_state(x, state_rates(x, time, inputs, p)), p)


@jit
def true_motion(measured: Report, p: Numbers) -> Report:
    """Reported motion -> the motion that the sensors would report so (inverse of `observe`)."""
    guess = measured
    for _ in range(MAX_INVERSION_STEPS):
        predicted = observe(guess, p)
        if reports_agree(measured, predicted):
            break
        guess = inversion_step(guess, measured, predicted)
    return guess


@jit
def held_inputs(
    row: Floats, voltage: float, wind_north: float, wind_east: float, p: Numbers
) -> HeldInputs:
    """Inputs from a row of commands (na,); a wind of NaN was not measured."""
    if np.isfinite(wind_north + wind_east):
        return HeldInputs(static_actuation(row, p), voltage, wind_north, wind_east, 1.0)
    return HeldInputs(static_actuation(row, p), voltage, 0.0, 0.0, 0.0)


@jit
def inputs_at(
    total: Floats, position: float, voltage: float, wind_north: float, wind_east: float,
    row: Floats, p: Numbers,
) -> HeldInputs:  # fmt: skip
    """Inputs over one step that begins at `position`: commands are the mean over the step."""
    for i in range(len(row)):
        row[i] = integral_at(total, position + 1.0, i) - integral_at(total, position, i)
    return held_inputs(row, voltage, wind_north, wind_east, p)


@entry
def rollout(
    theta: Floats, x0: Floats, table: NDArray[np.int64], start: NDArray[np.int64],
    steps: NDArray[np.int64], delay: Floats, total: Floats, voltage: Floats, wind: Floats,
    time: Floats, dt: float, substeps: int, states: Floats, reports: Floats,
) -> None:  # fmt: skip
    """Simulate freely from each start.

    theta (B or 1, P), x0 (B, nx), table/start/steps/delay (B,), total (C, T+1, na) integrated
    commands, voltage (C, T), wind (C, T, 2), time (C, T) -> states (B, H+1, nx), reports
    (B, H+1, 9); rows beyond a run's steps, or after it diverged, are left as they are (NaN).
    NaN in the memory part of x0: it starts settled under the first command.
    """
    row, h = np.empty(total.shape[2]), dt / substeps
    undelayed = np.empty(reports.shape[1:])
    for b in range(len(x0)):
        p = unpack(theta[b % len(theta)])
        c = table[b]
        late, latency, last = (delay[b] + delay_of(p)) / dt, latency_of(p) / dt, 0
        x = state_from(x0[b])
        for k in range(steps[b] + 1):
            j = min(start[b] + k, time.shape[1] - 1)
            t = time[c, start[b]] + k * dt
            inputs = inputs_at(
                total[c], start[b] + k - late, voltage[c, j], wind[c, j, 0], wind[c, j, 1], row, p
            )
            if k == 0 and NX > 6 and not np.isfinite(x[NX - 1]):
                x = settle_memory(x, t, inputs, p)
            set_row(states[b, k], x)
            last = k
            for i in range(substeps if k < steps[b] else 1):
                k1 = state_rates(x, t + i * h, inputs, p)
                if i == 0:
                    set_row(reports[b, k], observe(motion_of_state(x, k1), p))
                    if latency != 0.0:
                        set_row(undelayed[k], observe_undelayed(motion_of_state(x, k1), p))
                if k < steps[b]:
                    x = rk4_step(x, k1, t + i * h, inputs, h, p)
            if not np.isfinite(x[0] + x[1] + x[2] + x[3] + x[4] + x[5]) or abs(x[3]) > 1e3:
                break
        if latency != 0.0:
            apply_latency(reports[b, : last + 1], undelayed, latency)


@entry
def true_states(theta: Floats, motion: Floats, out: Floats) -> None:
    """Reported motion (B, 9) -> true pose and velocity (B, 6), for each theta (B or 1, P)."""
    for b in range(len(motion)):
        p = unpack(theta[b % len(theta)])
        set_row(out[b], true_motion(report_from(motion[b]), p)[:6])


@entry
def horizontal_balance(
    theta: Floats, row: Floats, air: Floats, time: float, dt: float, out: Floats
) -> None:
    """What a state takes to keep its velocity, and the memory of its effects dt [s] later.

    row (NX,): state; a memory of NaN starts settled, and is carried on by dt in place. air (3,):
    voltage [V], wind north, east [m/s] -> out (9,): M11, M12, M13, M22, M23, M33 of the inertia,
    then X, Y, N of the balance without acceleration and without thrusters [N, N, N m].
    """
    p, no_commands = unpack(theta), np.zeros(64)
    inputs = held_inputs(no_commands, air[0], air[1], air[2], p)
    x = state_from(row)
    if NX > 6 and not np.isfinite(x[NX - 1]):
        x = settle_memory(x, time, inputs, p)
    water = water_at(time, Pose(x[0], x[1], x[2]), p)
    flow = flow_at(x, time, inputs, water, p)
    nothing = Wrench(0.0, 0.0, 0.0)
    M, rest = balance(x, 0.0, 0.0, 0.0, water, flow, nothing, p)
    set_row(out, M)
    set_row(out[6:], rest)
    if NX > 6:
        rates = state_rates_under_force(x, time, inputs, nothing, p)
        for i in range(6, NX):
            row[i] = x[i] + dt * rates[i]
