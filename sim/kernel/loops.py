"""The loops around the composed laws. `sim.kernel.cache` copies this file's text into every kernel,

where `jit` compiles; in numpy mode `jit` leaves the functions as they are.
"""

import numpy as np
from numpy.typing import NDArray

from sim.body import Report
from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.kernel.signatures import (
    NX,
    Inputs,
    Numbers,
    State,
    actuated,
    at_rest,
    axpy,
    delay_of,
    latency_of,
    observe,
    observe_now,
    rates,
    state_from,
    unpack,
)
from sim.sensing import agree, corrected
from sim.state import Floats, to_body, to_world

# -- the text from here on goes into the kernel --

INVERSIONS = 200  # at most: a receiver that is 0.3 s late takes 60 at 2 rad/s


@jit
def step(x: State, k1: State, t: float, inputs: Inputs, h: float, p: Numbers) -> State:
    """One step of classical Runge–Kutta of fourth order from a state and its rates k1."""
    k2 = rates(axpy(x, 0.5 * h, k1), t + 0.5 * h, inputs, p)
    k3 = rates(axpy(x, 0.5 * h, k2), t + 0.5 * h, inputs, p)
    k4 = rates(axpy(x, h, k3), t + h, inputs, p)
    return axpy(axpy(axpy(axpy(x, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@jit
def advance(x: State, time: float, inputs: Inputs, dt: float, substeps: int, p: Numbers) -> State:
    """One interval of held inputs in equal steps -> the next state."""
    h = dt / substeps
    for i in range(substeps):
        x = step(x, rates(x, time + i * h, inputs, p), time + i * h, inputs, h, p)
    return x


@jit
def set_row(row: Floats, values: tuple[float, ...]) -> None:
    """Values into the first places of a row."""
    for i in range(len(values)):
        row[i] = values[i]


@jit
def motion_of(x: State, k: State) -> Report:
    """The true motion of a state and its rates."""
    return Report(x[0], x[1], x[2], x[3], x[4], x[5], k[3], k[4], k[5])


@jit
def report_of(x: State, time: float, inputs: Inputs, p: Numbers) -> Report:
    """What the sensors report of a state, accelerations included."""
    return observe(motion_of(x, rates(x, time, inputs, p)), p)


@jit
def aged(rows: Floats, prompt: Floats, steps: float, dt: float) -> None:
    """Position and velocity over ground in reports (K, 9) dt [s] apart become `steps` steps old.

    Heading, turning and accelerations have sensors of their own, which are not late. `prompt`
    (>= K, 9) is the past: the same reports if nothing were late. Rows whose past is not known stay.
    """
    for k in range(len(rows)):
        i = min(int(np.floor(k - steps)), len(rows) - 2)
        if i >= 0:
            s, now, then = k - steps - i, prompt[i], prompt[i + 1]
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
    for _ in range(INVERSIONS):
        predicted = observe(guess, p)
        if agree(measured, predicted):
            break
        guess = corrected(guess, measured, predicted)
    return guess


@jit
def integral_at(total: Floats, position: float, i: int) -> float:
    """Command i integrated up to a position in steps; its edges are continued."""
    k = min(max(int(np.floor(position)), 0), len(total) - 2)
    return total[k, i] + (position - k) * (total[k + 1, i] - total[k, i])


@jit
def held(
    row: Floats, voltage: float, wind_north: float, wind_east: float, p: Numbers
) -> Inputs:  # fmt: skip
    """Inputs from a row of commands (na,); a wind of NaN was not measured."""
    if np.isfinite(wind_north + wind_east):
        return Inputs(actuated(row, p), voltage, wind_north, wind_east, 1.0)
    return Inputs(actuated(row, p), voltage, 0.0, 0.0, 0.0)


@jit
def inputs_at(
    total: Floats, position: float, voltage: float, wind_north: float, wind_east: float,
    row: Floats, p: Numbers,
) -> Inputs:  # fmt: skip
    """Inputs over one step that begins at `position`: commands are the mean over the step."""
    for i in range(len(row)):
        row[i] = integral_at(total, position + 1.0, i) - integral_at(total, position, i)
    return held(row, voltage, wind_north, wind_east, p)


@entry
def rollout(
    theta: Floats, x0: Floats, table: NDArray[np.int64], start: NDArray[np.int64],
    steps: NDArray[np.int64], delay: Floats, total: Floats, voltage: Floats, wind: Floats,
    time: Floats, dt: float, substeps: int, states: Floats, reports: Floats,
) -> None:  # fmt: skip
    """Run the model freely from each start.

    theta (B or 1, P), x0 (B, nx), table/start/steps/delay (B,), total (C, T+1, na) integrated
    commands, voltage (C, T), wind (C, T, 2), time (C, T) -> states (B, H+1, nx), reports
    (B, H+1, 9); rows beyond a run's steps, or after it diverged, are left as they are (NaN).
    NaN in the memory part of x0 means: at rest under the first command.
    """
    row, h = np.empty(total.shape[2]), dt / substeps
    prompt = np.empty(reports.shape[1:])
    for b in range(len(x0)):
        p = unpack(theta[b % len(theta)])
        c = table[b]
        shift, age, last = (delay[b] + delay_of(p)) / dt, latency_of(p) / dt, 0
        x = state_from(x0[b])
        for k in range(steps[b] + 1):
            j = min(start[b] + k, time.shape[1] - 1)
            t = time[c, start[b]] + k * dt
            inputs = inputs_at(
                total[c], start[b] + k - shift, voltage[c, j], wind[c, j, 0], wind[c, j, 1], row, p
            )
            if k == 0 and NX > 6 and not np.isfinite(x[NX - 1]):
                x = at_rest(x, t, inputs, p)
            for i in range(len(x)):
                states[b, k, i] = x[i]
            k1 = rates(x, t, inputs, p)
            set_row(reports[b, k], observe(motion_of(x, k1), p))
            if age != 0.0:
                set_row(prompt[k], observe_now(motion_of(x, k1), p))
            last = k
            if k < steps[b]:
                x = step(x, k1, t, inputs, h, p)
                for i in range(1, substeps):
                    x = step(x, rates(x, t + i * h, inputs, p), t + i * h, inputs, h, p)
            if not np.isfinite(x[0] + x[1] + x[2] + x[3] + x[4] + x[5]) or abs(x[3]) > 1e3:
                break
        if age != 0.0:
            aged(reports[b, : last + 1], prompt, age, dt)


@entry
def true_states(theta: Floats, motion: Floats, out: Floats) -> None:
    """Reported motion (B, 9) -> true pose and velocity (B, 6), for each theta (B or 1, P)."""
    for b in range(len(motion)):
        m = motion[b]
        p = unpack(theta[b % len(theta)])
        true = true_motion(Report(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]), p)
        out[b, 0], out[b, 1], out[b, 2] = true.north, true.east, true.yaw
        out[b, 3], out[b, 4], out[b, 5] = true.u, true.v, true.r
