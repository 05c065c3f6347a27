"""The loops of the live path: row by row as estimates come in, state carried between chunks.

`sim.kernel.cache` copies this file's text into every kernel, see `sim.kernel.loops`.
"""

import numpy as np
from numpy.typing import NDArray

from sim.body import Report
from sim.following.blend import Track, blended, gap, track_of
from sim.following.law import Gains, reference_rate, wanted_acceleration
from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.kernel.loops import advance, held, report_of, set_row, true_motion
from sim.kernel.signatures import (
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
)
from sim.state import Floats, Pose, Velocity, Wrench, wrap

# -- the text from here on goes into the kernel --

LONGEST_STEP = 0.02  # s, of the free prediction
CONTROL_STEP = 0.01  # s, over which the control force is held: K times this is well below 1


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
    allocate: Floats, effect: Floats, low: Floats, high: Floats, p: Numbers,
) -> tuple[Wrench, bool]:  # fmt: skip
    """τ_c for a reference row (9,), and whether limits bind.

    `inner` (3,), the integral of e, grows by one step h unless they do.
    """
    eta_ref, nu_s = Pose(ref[0], ref[1], ref[2]), Velocity(x[3], x[4], x[5])
    nu_ref = reference_rate(
        eta_ref, Velocity(ref[3], ref[4], ref[5]), Pose(x[0], x[1], x[2]), gains
    )
    ref_dot = Velocity(ref[6], ref[7], ref[8])
    grown = Velocity(
        inner[0] + h * (nu_ref.u - nu_s.u),
        inner[1] + h * (nu_ref.v - nu_s.v),
        inner[2] + h * (nu_ref.r - nu_s.r),
    )
    gamma = wanted_acceleration(nu_ref, ref_dot, nu_s, grown, gains)
    wanted = required(x, gamma.u, gamma.v, gamma.r, time, inputs, p)
    tau, bound = Wrench(wanted.X, gains.sway * wanted.Y, wanted.N), False
    if len(low) > 0:
        tau, bound = limited(tau, allocate, effect, low, high)
    if not bound:
        inner[0], inner[1], inner[2] = grown.u, grown.v, grown.r
    return tau, bound


@entry
def follow(
    theta: Floats, carry: Floats, gains_row: Floats, times: Floats, references: Floats,
    jumps: NDArray[np.bool_], voltage: Floats, wind: Floats, allocate: Floats, effect: Floats,
    low: Floats, high: Floats, shadows: Floats, forces: Floats, bound: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Make the plant follow references (K, 9) at times (K,).

    carry (NX + 16,): plant state, integral of e (3), τ_c (3), time and row of the last reference;
    a NaN time means that nothing was followed yet: the plant starts at the first reference.
    `jumps` marks references that did not come about by motion (an origin shift): the plant is set
    anew. allocate (n, 3), effect (3, n), low, high (n,): thrust limits; none where n = 0.
    -> shadows (K, 9) pose, velocity, acceleration; forces (K, 3) τ_c; bound (K,) limits binding.
    """
    p = unpack(theta)
    gains = Gains(gains_row[0], gains_row[1], gains_row[2], gains_row[3], gains_row[4])
    x, ref = state_from(carry), np.empty(9)
    inner, last, at = carry[NX : NX + 3], carry[NX + 7 : NX + 16], NX + 6
    tau = Wrench(carry[NX + 3], carry[NX + 4], carry[NX + 5])
    still = np.zeros(64)  # the plant's own thrusters are not what moves it
    for k in range(len(times)):
        inputs = held(still, voltage[k], wind[k, 0], wind[k, 1], p)
        if jumps[k] or not np.isfinite(carry[at]):
            for i in range(6):
                carry[i] = references[k, i]
            x = at_rest(state_from(carry), times[k], inputs, p)
            carry[at], inner[:], last[:] = times[k], 0.0, references[k]
            tau, bound[k] = pull(
                x, last, inner, times[k], 0.0, inputs, gains, allocate, effect, low, high, p
            )
        span = times[k] - carry[at]
        n = int(np.ceil(span / CONTROL_STEP - 1e-9))
        for j in range(n):
            h, t = span / n, carry[at] + j * (span / n)
            for i in range(9):  # errors at the start of the step, accelerations over it
                part = (j + 0.5 * (i > 5)) / n
                change = references[k, i] - last[i]
                ref[i] = last[i] + part * (wrap(change) if i == 2 else change)
            tau, hit = pull(x, ref, inner, t, h, inputs, gains, allocate, effect, low, high, p)
            bound[k] = bound[k] or hit
            x = push(x, t, inputs, tau, h, p)
        if span > 0.0:
            carry[at], last[:] = times[k], references[k]
        now = pushed(x, carry[at], inputs, tau, p)
        for i in range(6):
            shadows[k, i] = x[i]
        for i in range(3):
            shadows[k, 6 + i] = now[3 + i]
        forces[k, 0], forces[k, 1], forces[k, 2] = tau.X, tau.Y, tau.N
    for i in range(NX):
        carry[i] = x[i]
    carry[NX + 3], carry[NX + 4], carry[NX + 5] = tau.X, tau.Y, tau.N


@jit
def faded(source: Report, carry: Floats, fade: float) -> Report:
    """The source plus what is left of the last difference; carry as in `refer`."""
    t = carry[NX] - carry[NX + 2]
    if t < 40.0 * fade:
        o = carry[NX + 3 : NX + 12]
        offset = Track(o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8])
        return blended(source, offset, t, fade)
    return source


@entry
def refer(
    theta: Floats, carry: Floats, fade: float, times: Floats, estimates: Floats,
    modelled: NDArray[np.bool_], anchored: NDArray[np.bool_], jumps: NDArray[np.bool_],
    commands: Floats, voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """The reference: estimates (K, 9), or where `modelled` the vessel's own motion under commands.

    Commands (K, na) hold over the interval that ends at their row. Where `anchored` the model is
    set to the estimate, its memory kept, and runs on from there. At a hand-over, either way, the
    reference goes on where it was and the difference fades with the time constant `fade` [s];
    at `jumps` it is dropped. carry (NX + 21,): state, time, source, time and size (9) of the
    last difference, last row (9); NaN before the start -> out (K, 9).
    """
    p = unpack(theta)
    for k in range(len(times)):
        inputs = held(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        e = estimates[k]
        estimate = Report(e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8])
        fresh = not np.isfinite(carry[NX])
        handed = not fresh and modelled[k] != (carry[NX + 1] > 0.0)
        if handed and modelled[k]:
            c = carry[NX + 12 : NX + 21]
            before = Report(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8])
            own = report_of(state_from(carry), carry[NX], inputs, p)
            carry[NX + 2] = carry[NX]
            set_row(carry[NX + 3 : NX + 12], gap(track_of(before), track_of(own)))
        span = 0.0 if fresh else times[k] - carry[NX]
        if span > 0.0:
            n = int(np.ceil(span / LONGEST_STEP - 1e-9))
            set_row(carry, advance(state_from(carry), carry[NX], inputs, span, n, p))
        carry[NX] = times[k] if fresh else max(carry[NX], times[k])
        if handed and not modelled[k]:
            own = faded(report_of(state_from(carry), carry[NX], inputs, p), carry, fade)
            carry[NX + 2] = carry[NX]
            set_row(carry[NX + 3 : NX + 12], gap(track_of(own), track_of(estimate)))
        if anchored[k] or jumps[k] or fresh:
            true = true_motion(estimate, p)
            carry[0], carry[1], carry[2] = true.north, true.east, true.yaw
            carry[3], carry[4], carry[5] = true.u, true.v, true.r
        if fresh:
            set_row(carry, at_rest(state_from(carry), times[k], inputs, p))
        if jumps[k]:
            carry[NX + 2] = np.nan
        source = estimate
        if modelled[k]:
            source = report_of(state_from(carry), carry[NX], inputs, p)
        carry[NX + 1] = 1.0 if modelled[k] else 0.0
        set_row(carry[NX + 12 : NX + 21], faded(source, carry, fade))
        out[k] = carry[NX + 12 : NX + 21]


@entry
def missing_force(
    theta: Floats, carry: Floats, times: Floats, motion: Floats, before: Floats, around: Floats,
    voltage: Floats, wind: Floats, out: Floats, acting: Floats,
) -> None:  # fmt: skip
    """Balance along a measured motion: what the vessel would need on top of its own forces.

    carry (NX + 1,): state and time, NaN before the start; of the state, only the memory of
    actuators and effects runs along, and starts anew where motion was not known.
    motion (K, 9) as reported; commands (K, na): `before` hold over the interval that ends at
    their row, `around` act at its instant -> out (K, 3) missing force, acting (K, 3) τ(commands)
    [N, N, N m].
    """
    p = unpack(theta)
    for k in range(len(times)):
        m = motion[k]
        inputs = held(around[k], voltage[k], wind[k, 0], wind[k, 1], p)
        fresh = not np.isfinite(carry[NX])
        span = 0.0 if fresh else times[k] - carry[NX]
        if span > 0.0 and NX > 6:
            n = int(np.ceil(span / LONGEST_STEP - 1e-9))
            past = held(before[k], voltage[k], wind[k, 0], wind[k, 1], p)
            x = advance(state_from(carry), carry[NX], past, span, n, p)
            for i in range(6, NX):
                carry[i] = x[i]
        true = true_motion(Report(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]), p)
        carry[0], carry[1], carry[2] = true.north, true.east, true.yaw
        carry[3], carry[4], carry[5] = true.u, true.v, true.r
        x = state_from(carry)
        if not np.isfinite(carry[6:NX].sum()):
            x = at_rest(x, times[k], inputs, p)
            set_row(carry, x)
        carry[NX] = times[k] if fresh else max(carry[NX], times[k])
        force = missing(x, true.u_dot, true.v_dot, true.r_dot, times[k], inputs, p)
        tau = commanded(x, times[k], inputs, p)
        out[k, 0], out[k, 1], out[k, 2] = force.X, force.Y, force.N
        acting[k, 0], acting[k, 1], acting[k, 2] = tau.X, tau.Y, tau.N
