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
from sim.sensing import inversion_step, reports_agree
from sim.state import Floats, Wrench, to_body, to_world

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
    """One step of classical Runge–Kutta of fourth order from a state and its rates k1."""
    k2 = state_rates(axpy(x, 0.5 * h, k1), t + 0.5 * h, inputs, p)
    k3 = state_rates(axpy(x, 0.5 * h, k2), t + 0.5 * h, inputs, p)
    k4 = state_rates(axpy(x, h, k3), t + h, inputs, p)
    return axpy(axpy(axpy(axpy(x, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


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
def set_row(row: Floats, values: tuple[float, ...] | Floats) -> None:
    """Values into the first places of a row.

    Of arrays too: for `row[:3] = values` numba compiles the text of an error, which takes seconds.
    """
    for i in range(len(values)):
        row[i] = values[i]


@jit
def report_from(row: Floats) -> Report:
    """A row (9,) as a report."""
    return Report(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8])


@jit
def motion_of_state(x: State, k: State) -> Report:
    """The true motion of a state and its rates."""
    return Report(x[0], x[1], x[2], x[3], x[4], x[5], k[3], k[4], k[5])


@jit
def report_of_state(x: State, time: float, inputs: HeldInputs, p: Numbers) -> Report:
    """What the sensors report of a state, accelerations included."""
    return observe(motion_of_state(x, state_rates(x, time, inputs, p)), p)


@jit
def apply_latency(rows: Floats, undelayed: Floats, steps: float) -> None:
    """Delay position and velocity over ground in reports (K, 9) by `steps` rows.

    Heading, yaw rate and accelerations have sensors of their own, which are not late. `undelayed`
    (>= K, 9) are the reports without delay. Rows before the first of them are left as they are.
    """
    for k in range(len(rows)):
        i = min(int(np.floor(k - steps)), len(rows) - 2)
        if i >= 0:
            s, now, then = k - steps - i, undelayed[i], undelayed[i + 1]
            north, east = to_world(now[3], now[4], now[2])
            north_next, east_next = to_world(then[3], then[4], then[2])
            rows[k, 0] = now[0] + s * (then[0] - now[0])
            rows[k, 1] = now[1] + s * (then[1] - now[1])
            rows[k, 3], rows[k, 4] = to_body(
                north + s * (north_next - north), east + s * (east_next - east), rows[k, 2]
            )


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
def integral_at(total: Floats, position: float, i: int) -> float:
    """Command i integrated up to a position in steps; its edges are continued."""
    k = min(max(int(np.floor(position)), 0), len(total) - 2)
    return total[k, i] + (position - k) * (total[k + 1, i] - total[k, i])


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
            for i in range(len(x)):
                states[b, k, i] = x[i]
            k1 = state_rates(x, t, inputs, p)
            set_row(reports[b, k], observe(motion_of_state(x, k1), p))
            if latency != 0.0:
                set_row(undelayed[k], observe_undelayed(motion_of_state(x, k1), p))
            last = k
            if k < steps[b]:
                x = rk4_step(x, k1, t, inputs, h, p)
                for i in range(1, substeps):
                    x = rk4_step(x, state_rates(x, t + i * h, inputs, p), t + i * h, inputs, h, p)
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
