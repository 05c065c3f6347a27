"""One step of a boat under commands, waves included, in six degrees of freedom.

Surge, sway and yaw follow the balance of the vessel under its commands and the force of the waves.
Heave z [m, down], roll φ and pitch θ [rad] are oscillators about the surface of the water as the
hull sees it (`sim.plants.waves`):

    q̈ + 2 ζ ω_n q̇ + ω_n² (q − q_w) = 0        q = z, φ, θ

q_w: what the waves ask for, held over the step: then the step is exact, however long. In calm water
q_w = 0, the force of the waves is 0, and the three degrees move as those of the vessel alone.

`sim.kernel.generator` copies the text below the mark into every kernel, see `sim.kernel.loops`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.kernel.loops import held_inputs
from sim.kernel.rows import motion_of_state, report_from, set_row
from sim.plants.waves import HullShape, WaveLoad, oscillator_step, wave_load
from sim.state import Floats

if TYPE_CHECKING:
    from sim.body import HeldInputs
    from sim.kernel import (
        NX,
        Numbers,
        State,
        axpy,
        commanded_wrench,
        observe,
        settle_memory,
        state_from,
        state_rates_with_force,
        unpack,
        water_at,
    )
    from sim.state import Pose, Wrench

# -- the text from here on goes into the kernel --


@jit
def rk4_step_with_force(
    x: State, time: float, inputs: HeldInputs, tau: Wrench, h: float, p: Numbers
) -> State:
    """One Runge–Kutta step under held commands and a constant force beside them."""
    after, at, t = x, x, time
    for stage in range(4):
        k = state_rates_with_force(at, t, inputs, tau, p)
        after = axpy(after, h / 3 if 0 < stage < 3 else h / 6, k)
        reach = h if stage == 2 else 0.5 * h
        at, t = axpy(x, reach, k), time + reach
    return after


@jit
def wave_force(load: WaveLoad) -> Wrench:
    """Horizontal part of the load of waves -> X, Y, N [N, N, N m]."""
    return Wrench(load.X, load.Y, load.N)


@entry
def step_afloat(
    theta: Floats, row: Floats, commands: Floats, air: Floats, shape_row: Floats, waves: Floats,
    time: float, dt: float, substeps: int, out: Floats,
) -> None:  # fmt: skip
    """Go on by dt [s] from `time` [s] in equal substeps; with dt = 0 only `out` is written.

    row (NX + 6,): state, then z, ż, φ, φ̇, θ, θ̇; changed in place. A memory of NaN starts settled.
    commands (na,); air (3,): voltage [V], wind north, east [m/s, NaN: not measured]; shape_row
    (12,) of `HullShape`; waves (K, 5) of `sim.plants.waves` -> out (32,): true motion (9), reported
    motion (9), second derivatives of z, φ and θ, elevation of the water [m], its velocity north
    and east [m/s], τ(commands) (3), force of the waves (3); two are free.
    """
    p = unpack(theta)
    s = HullShape(
        shape_row[0], shape_row[1], shape_row[2], shape_row[3], shape_row[4], shape_row[5],
        shape_row[6], shape_row[7], shape_row[8], shape_row[9], shape_row[10], shape_row[11],
    )  # fmt: skip
    inputs = held_inputs(commands, air[0], air[1], air[2], p)
    x = state_from(row)
    if NX > 6 and not np.isfinite(x[NX - 1]):
        x = settle_memory(x, time, inputs, p)
    h = dt / substeps
    q = row[NX:]
    if h > 0.0:
        for i in range(substeps):
            t = time + i * h
            load = wave_load(waves, s, x[0], x[1], x[2], t + 0.5 * h)
            x = rk4_step_with_force(x, t, inputs, wave_force(load), h, p)
            q[0], q[1] = oscillator_step(q[0], q[1], load.heave, s.heave_rate, s.heave_damping, h)
            q[2], q[3] = oscillator_step(q[2], q[3], load.roll, s.roll_rate, s.roll_damping, h)
            q[4], q[5] = oscillator_step(q[4], q[5], load.pitch, s.pitch_rate, s.pitch_damping, h)
    end = time + dt
    load = wave_load(waves, s, x[0], x[1], x[2], end)
    rates = state_rates_with_force(x, end, inputs, wave_force(load), p)
    set_row(row, x)
    motion = motion_of_state(x, rates)
    set_row(out, motion)
    set_row(out[9:], observe(motion, p))
    out[18] = s.heave_rate**2 * (load.heave - q[0]) - 2.0 * s.heave_damping * s.heave_rate * q[1]
    out[19] = s.roll_rate**2 * (load.roll - q[2]) - 2.0 * s.roll_damping * s.roll_rate * q[3]
    out[20] = s.pitch_rate**2 * (load.pitch - q[4]) - 2.0 * s.pitch_damping * s.pitch_rate * q[5]
    water = water_at(end, Pose(x[0], x[1], x[2]), p)
    out[21], out[22], out[23] = load.elevation, water.north, water.east
    set_row(out[24:], commanded_wrench(x, end, inputs, p))
    out[27], out[28], out[29] = load.X, load.Y, load.N


@entry
def drive(
    theta: Floats, row: Floats, commands: Floats, air: Floats, motion: Floats, time: float,
    dt: float, out: Floats,
) -> None:  # fmt: skip
    """The actuators of a boat whose hull is moved elsewhere; its sensors.

    row (NX …): state with the hull's pose and velocity; its memory goes on by dt [s] in place, and
    starts settled where it is NaN. motion (9,): true motion -> out (14,): τ(commands) at `time` (3)
    [N, N, N m], the motion as reported (9), velocity of the water north and east [m/s].
    """
    p = unpack(theta)
    inputs = held_inputs(commands, air[0], air[1], air[2], p)
    x = state_from(row)
    if NX > 6 and not np.isfinite(x[NX - 1]):
        x = settle_memory(x, time, inputs, p)
    set_row(out, commanded_wrench(x, time, inputs, p))
    set_row(out[3:], observe(report_from(motion), p))
    water = water_at(time, Pose(x[0], x[1], x[2]), p)
    out[12], out[13] = water.north, water.east
    if NX > 6:
        after = rk4_step_with_force(x, time, inputs, Wrench(0.0, 0.0, 0.0), dt, p)
        for i in range(6, NX):
            row[i] = after[i]
