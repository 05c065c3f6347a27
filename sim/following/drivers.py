"""The loops of the live path: row by row as estimates come in, state carried between chunks.

`sim.compiled` copies this file's text into every kernel, see `sim.drivers`.
"""

import numpy as np
from numpy.typing import NDArray

from sim.body import Report
from sim.composed import (
    NX,
    Inputs,
    Numbers,
    State,
    at_rest,
    axpy,
    commanded,
    missing,
    pushed,
    required,
    state_from,
    unpack,
)  # fmt: skip
from sim.drivers import advance, held, report_of, true_motion
from sim.following.law import Gains, reference_rate, wanted_acceleration
from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.state import Floats, Pose, Velocity, Wrench

# -- the text from here on goes into the kernel --

LONGEST_STEP = 0.02  # s, of the shadow and of the free prediction


@jit
def limited(
    tau: Wrench, allocate: Floats, effect: Floats, low: Floats, high: Floats
) -> tuple[Wrench, bool]:
    """τ as the thrusters can give it: allocate (n, 3), clip, add up by effect (3, n)."""
    X, Y, N, bound = 0.0, 0.0, 0.0, False
    for i in range(len(low)):
        wanted = allocate[i, 0] * tau.X + allocate[i, 1] * tau.Y + allocate[i, 2] * tau.N
        thrust = min(max(wanted, low[i]), high[i])
        bound = bound or thrust != wanted
        X += effect[0, i] * thrust
        Y += effect[1, i] * thrust
        N += effect[2, i] * thrust
    return Wrench(X, Y, N), bound


@jit
def push(x: State, time: float, inputs: Inputs, tau: Wrench, h: float, p: Numbers) -> State:
    """One step of the plant under a constant force by Runge–Kutta -> the next state."""
    k1 = pushed(x, time, inputs, tau, p)
    k2 = pushed(axpy(x, 0.5 * h, k1), time + 0.5 * h, inputs, tau, p)
    k3 = pushed(axpy(x, 0.5 * h, k2), time + 0.5 * h, inputs, tau, p)
    k4 = pushed(axpy(x, h, k3), time + h, inputs, tau, p)
    return axpy(axpy(axpy(axpy(x, h / 6, k1), h / 3, k2), h / 3, k3), h / 6, k4)


@jit
def pull(
    x: State, ref: Floats, inner: Floats, time: float, h: float, inputs: Inputs, gains: Gains,
    p: Numbers,
) -> Wrench:  # fmt: skip
    """τ_c for a reference row (9,); `inner` (3,), the integral of e, grows by one step h."""
    eta_ref, nu_s = Pose(ref[0], ref[1], ref[2]), Velocity(x[3], x[4], x[5])
    nu_ref = reference_rate(
        eta_ref, Velocity(ref[3], ref[4], ref[5]), Pose(x[0], x[1], x[2]), gains
    )
    inner[0] += h * (nu_ref.u - nu_s.u)
    inner[1] += h * (nu_ref.v - nu_s.v)
    inner[2] += h * (nu_ref.r - nu_s.r)
    ref_dot = Velocity(ref[6], ref[7], ref[8])
    gamma = wanted_acceleration(
        nu_ref, ref_dot, nu_s, Velocity(inner[0], inner[1], inner[2]), gains
    )
    tau = required(x, gamma.u, gamma.v, gamma.r, time, inputs, p)
    return Wrench(tau.X, gains.sway * tau.Y, tau.N)


@entry
def follow(
    theta: Floats, carry: Floats, gains_row: Floats, times: Floats, references: Floats,
    jumps: NDArray[np.bool_], voltage: Floats, wind: Floats, allocate: Floats, effect: Floats,
    low: Floats, high: Floats, shadows: Floats, forces: Floats, bound: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Make the plant follow references (K, 9) at times (K,).

    carry (NX + 13,): plant state, integral of e (3), time and row of the last reference; a NaN
    time means that nothing was followed yet: the plant starts at the first reference. `jumps`
    marks references that did not come about by motion (an origin shift): the plant is set anew.
    allocate (n, 3), effect (3, n), low, high (n,): thrust limits; none where n = 0.
    -> shadows (K, 9) pose, velocity, acceleration; forces (K, 3) τ_c; bound (K,) limits binding.
    """
    p = unpack(theta)
    gains = Gains(gains_row[0], gains_row[1], gains_row[2], gains_row[3], gains_row[4])
    x = state_from(carry)
    inner, ref = carry[NX : NX + 3].copy(), np.empty(9)
    last_time, last = carry[NX + 3], carry[NX + 4 : NX + 13].copy()
    still = np.zeros(64)  # the plant's own thrusters are not what moves it
    tau = Wrench(0.0, 0.0, 0.0)
    for k in range(len(times)):
        inputs = held(still, voltage[k], wind[k, 0], wind[k, 1])
        if jumps[k] or not np.isfinite(last_time):
            for i in range(6):
                carry[i] = references[k, i]
            x = state_from(carry)
            last[:] = references[k]
            inner[:] = 0.0
            last_time = times[k]
        span = times[k] - last_time
        n = int(np.ceil(span / LONGEST_STEP - 1e-9))
        for j in range(n):
            h = span / n
            for i in range(9):
                ref[i] = last[i] + (j + 0.5) / n * (references[k, i] - last[i])
            t = last_time + j * h
            tau = pull(x, ref, inner, t, h, inputs, gains, p)
            if len(low) > 0:
                tau, hit = limited(tau, allocate, effect, low, high)
                bound[k] = bound[k] or hit
            x = push(x, t, inputs, tau, h, p)
        if span > 0.0:
            last_time = times[k]
            last[:] = references[k]
        now = pushed(x, last_time, inputs, tau, p)
        for i in range(6):
            shadows[k, i] = x[i]
        for i in range(3):
            shadows[k, 6 + i] = now[3 + i]
        forces[k, 0], forces[k, 1], forces[k, 2] = tau.X, tau.Y, tau.N
    for i in range(NX):
        carry[i] = x[i]
    carry[NX : NX + 3] = inner
    carry[NX + 3] = last_time
    carry[NX + 4 : NX + 13] = last


@entry
def predict(
    theta: Floats, carry: Floats, times: Floats, anchors: Floats, anchored: NDArray[np.bool_],
    commands: Floats, voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """The vessel's own motion under the boat's commands, row by row.

    carry (NX + 1,): state and time, NaN before the start. Where `anchored`, the state is set to
    the reported motion `anchors` (K, 9), memory kept; else it runs on. commands (K, na) hold over
    the interval that ends at their row -> out (K, 9) the reported motion.
    """
    p = unpack(theta)
    for k in range(len(times)):
        inputs = held(commands[k], voltage[k], wind[k, 0], wind[k, 1])
        fresh = not np.isfinite(carry[NX])
        span = 0.0 if fresh else times[k] - carry[NX]
        if span > 0.0:
            n = int(np.ceil(span / LONGEST_STEP - 1e-9))
            x = advance(state_from(carry), carry[NX], inputs, span, n, p)
            for i in range(NX):
                carry[i] = x[i]
        if anchored[k] or fresh:
            a = anchors[k]
            true = true_motion(Report(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]), p)
            carry[0], carry[1], carry[2] = true.north, true.east, true.yaw
            carry[3], carry[4], carry[5] = true.u, true.v, true.r
        if fresh:
            x = at_rest(state_from(carry), times[k], inputs, p)
            for i in range(NX):
                carry[i] = x[i]
        carry[NX] = times[k] if fresh else max(carry[NX], times[k])
        said = report_of(state_from(carry), times[k], inputs, p)
        for i in range(9):
            out[k, i] = said[i]


@entry
def missing_force(
    theta: Floats, carry: Floats, times: Floats, motion: Floats, before: Floats, around: Floats,
    voltage: Floats, wind: Floats, out: Floats, acting: Floats,
) -> None:  # fmt: skip
    """Balance along a measured motion: what the vessel would need on top of its own forces.

    carry (NX + 1,) as in `predict`: only the memory of actuators and effects runs along.
    motion (K, 9) as reported; commands (K, na): `before` hold over the interval that ends at
    their row, `around` act at its instant -> out (K, 3) missing force, acting (K, 3) τ(commands)
    [N, N, N m].
    """
    p = unpack(theta)
    for k in range(len(times)):
        m = motion[k]
        inputs = held(around[k], voltage[k], wind[k, 0], wind[k, 1])
        fresh = not np.isfinite(carry[NX])
        span = 0.0 if fresh else times[k] - carry[NX]
        if span > 0.0 and NX > 6:
            n = int(np.ceil(span / LONGEST_STEP - 1e-9))
            past = held(before[k], voltage[k], wind[k, 0], wind[k, 1])
            x = advance(state_from(carry), carry[NX], past, span, n, p)
            for i in range(6, NX):
                carry[i] = x[i]
        true = true_motion(Report(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]), p)
        carry[0], carry[1], carry[2] = true.north, true.east, true.yaw
        carry[3], carry[4], carry[5] = true.u, true.v, true.r
        x = state_from(carry)
        if fresh:
            x = at_rest(x, times[k], inputs, p)
            for i in range(NX):
                carry[i] = x[i]
        carry[NX] = times[k] if fresh else max(carry[NX], times[k])
        force = missing(x, true.u_dot, true.v_dot, true.r_dot, times[k], inputs, p)
        tau = commanded(x, times[k], inputs, p)
        out[k, 0], out[k, 1], out[k, 2] = force.X, force.Y, force.N
        acting[k, 0], acting[k, 1], acting[k, 2] = tau.X, tau.Y, tau.N
