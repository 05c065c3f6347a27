"""The loops of the live path: row by row as estimates come in, state carried between chunks.

`sim.kernel.generator` copies the text below the mark into every kernel, see `sim.kernel.loops`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.body import HeldInputs, Report
from sim.following import (
    MAX_SPEED_MPS,
    MAX_TURN_RADPS,
    Gains,
    WorldMotion,
    blend,
    can_return,
    commanded_acceleration,
    corrected_reference,
    is_possible,
    offset_between,
    runs_on,
    to_world_motion,
    within,
)
from sim.jit import jitable as entry
from sim.jit import jitable as jit
from sim.kernel.loops import advance, held_inputs, report_of_state, true_motion
from sim.kernel.rows import report_from, set_row
from sim.state import Floats, Pose, Velocity, Wrench, wrap

if TYPE_CHECKING:
    from sim.kernel import (
        NX,
        Numbers,
        State,
        axpy,
        commanded_wrench,
        missing_wrench,
        required_wrench,
        settle_memory,
        state_from,
        state_rates_under_force,
        unpack,
    )

# -- the text from here on goes into the kernel --

PREDICTION_STEP = 0.02  # s, the longest of a free prediction
CONTROL_STEP = 0.01  # s, over which the control force is held: K times this is well below 1


@jit
def allocate_thrust(
    tau: Wrench, allocation: Floats, effectiveness: Floats, low: Floats, high: Floats
) -> tuple[Wrench, bool]:
    """τ -> B clip(B⁺ τ, low, high) and whether it was clipped; B⁺ (n, 3), B (3, n)."""
    X, Y, N, limited = 0.0, 0.0, 0.0, False
    for i in range(len(low)):
        desired = allocation[i, 0] * tau.X + allocation[i, 1] * tau.Y + allocation[i, 2] * tau.N
        thrust = min(max(desired, low[i]), high[i])
        limited = limited or thrust != desired
        X += effectiveness[0, i] * thrust
        Y += effectiveness[1, i] * thrust
        N += effectiveness[2, i] * thrust
    return Wrench(X, Y, N), limited


@jit
def rk4_step_under_force(
    x: State, time: float, inputs: HeldInputs, tau: Wrench, h: float, p: Numbers
) -> State:
    """One Runge–Kutta step of the plant under a constant force -> the next state."""
    after, at, t = x, x, time
    for stage in range(4):
        k = state_rates_under_force(at, t, inputs, tau, p)
        after = axpy(after, h / 3 if 0 < stage < 3 else h / 6, k)
        reach = h if stage == 2 else 0.5 * h
        at, t = axpy(x, reach, k), time + reach
    return after


@jit
def control_force(
    x: State, ref: Floats, integral: Floats, time: float, h: float, inputs: HeldInputs,
    gains: Gains, limits: tuple[Floats, Floats, Floats, Floats], p: Numbers,
) -> tuple[Wrench, bool]:  # fmt: skip
    """τ_c for a reference row (9,), and whether thrust limits bind.

    `integral` (3,), of e, grows by one step h unless they do.
    """
    eta_ref, nu_s = Pose(ref[0], ref[1], ref[2]), Velocity(x[3], x[4], x[5])
    nu_ref = corrected_reference(
        eta_ref, Velocity(ref[3], ref[4], ref[5]), Pose(x[0], x[1], x[2]), gains
    )
    nu_ref_dot = Velocity(ref[6], ref[7], ref[8])
    grown = Velocity(
        integral[0] + h * (nu_ref.u - nu_s.u),
        integral[1] + h * (nu_ref.v - nu_s.v),
        integral[2] + h * (nu_ref.r - nu_s.r),
    )
    gamma = commanded_acceleration(nu_ref, nu_ref_dot, nu_s, grown, gains)
    desired = required_wrench(x, gamma.u, gamma.v, gamma.r, time, inputs, p)
    tau, limited = Wrench(desired.X, gains.sway * desired.Y, desired.N), False
    if len(limits[2]) > 0:
        tau, limited = allocate_thrust(tau, *limits)
    if not limited:
        set_row(integral, grown)
    return tau, limited


@jit
def set_motion(row: Floats, motion: Floats) -> None:
    """Pose and velocity (6,) into a row, velocities within what a boat can do."""
    set_row(row, motion[:3])
    row[3] = within(motion[3], MAX_SPEED_MPS)
    row[4] = within(motion[4], MAX_SPEED_MPS)
    row[5] = within(motion[5], MAX_TURN_RADPS)


@jit
def start_following(
    carry: Floats, reference: Floats, time: float, inputs: HeldInputs, p: Numbers
) -> State:
    """The plant set to a reference (9,) -> its state; carry of `follow` without what was before."""
    set_motion(carry, reference)
    carry[NX : NX + 3] = 0.0
    carry[NX + 6] = time
    set_row(carry[NX + 7 :], reference)
    return settle_memory(state_from(carry), time, inputs, p)


@entry
def follow(
    theta: Floats, carry: Floats, gains_row: Floats, times: Floats, references: Floats,
    jumps: NDArray[np.bool_], voltage: Floats, wind: Floats, allocation: Floats,
    effectiveness: Floats, low: Floats, high: Floats, shadows: Floats, forces: Floats,
    limited: NDArray[np.bool_], diverged: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Make the plant follow references (K, 9) at times (K,).

    carry (NX + 16,): plant state, integral of e (3), τ_c (3), time and row of the last reference;
    a time of NaN means that nothing was followed yet: the plant starts at the first reference.
    `jumps` marks references that did not come about by motion (an origin shift): the plant is set
    anew, as it is after a long silence and where its motion is none of a boat's (`diverged`).
    allocation (n, 3), effectiveness (3, n), low, high (n,): thrust limits; none where n = 0.
    -> shadows (K, 9) pose, velocity, acceleration; forces (K, 3) τ_c; limited (K,), diverged (K,).
    """
    p = unpack(theta)
    gains = Gains(gains_row[0], gains_row[1], gains_row[2], gains_row[3], gains_row[4])
    limits = (allocation, effectiveness, low, high)
    x, ref = state_from(carry), np.empty(9)
    integral, last, at = carry[NX : NX + 3], carry[NX + 7 : NX + 16], NX + 6
    tau = Wrench(carry[NX + 3], carry[NX + 4], carry[NX + 5])
    no_commands = np.zeros(64)  # the plant's own thrusters are not what moves it
    for k in range(len(times)):
        inputs = held_inputs(no_commands, voltage[k], wind[k, 0], wind[k, 1], p)
        if jumps[k] or not runs_on(times[k], carry[at]):
            x = start_following(carry, references[k], times[k], inputs, p)
            tau, limited[k] = control_force(
                x, last, integral, times[k], 0.0, inputs, gains, limits, p
            )
        span = times[k] - carry[at]
        n = int(np.ceil(span / CONTROL_STEP - 1e-9))
        for j in range(n):
            h, t = span / n, carry[at] + j * (span / n)
            for i in range(9):  # errors at the start of the step, accelerations over it
                part = (j + 0.5 * (i > 5)) / n
                change = references[k, i] - last[i]
                ref[i] = last[i] + part * (wrap(change) if i == 2 else change)
            tau, clipped = control_force(x, ref, integral, t, h, inputs, gains, limits, p)
            limited[k] = limited[k] or clipped
            x = rk4_step_under_force(x, t, inputs, tau, h, p)
        if span > 0.0:
            carry[at] = times[k]
            set_row(last, references[k])
        if not is_possible(x[3], x[4], x[5]):
            diverged[k] = True
            x = start_following(carry, references[k], carry[at], inputs, p)
            tau, _ = control_force(x, last, integral, carry[at], 0.0, inputs, gains, limits, p)
        rates = state_rates_under_force(x, carry[at], inputs, tau, p)
        set_row(shadows[k], x[:6])
        set_row(shadows[k, 6:], rates[3:6])
        set_row(forces[k], tau)
    set_row(carry, x)
    set_row(carry[NX + 3 :], tau)


@jit
def predict(x: State, time: float, inputs: HeldInputs, span: float, p: Numbers) -> State:
    """The state `span` [s] later under held inputs."""
    n = int(np.ceil(span / PREDICTION_STEP - 1e-9))
    return advance(x, time, inputs, span, n, p)


@jit
def with_decayed_offset(source: Report, carry: Floats, fade: float) -> Report:
    """The source plus the decayed offset of the last hand-over; carry of `compute_reference`."""
    t = carry[NX] - carry[NX + 2]
    if t < 40.0 * fade:
        o = carry[NX + 3 : NX + 12]
        offset = WorldMotion(o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8])
        return blend(source, offset, t, fade)
    return source


@entry
def compute_reference(
    theta: Floats, carry: Floats, fade: float, times: Floats, estimates: Floats,
    from_model: NDArray[np.bool_], anchored: NDArray[np.bool_], jumps: NDArray[np.bool_],
    commands: Floats, voltage: Floats, wind: Floats, out: Floats, diverged: NDArray[np.bool_],
    reset: NDArray[np.bool_],
) -> None:  # fmt: skip
    """The reference: estimates (K, 9), or where `from_model` the vessel's motion under commands.

    Commands (K, na) hold over the interval that ends at their row. Where `anchored` the model is
    set to the estimate, its memory kept, and runs on from there. At a hand-over, either way, the
    reference goes on where it was and the offset decays with the time constant `fade` [s]; at
    `jumps` it is dropped, and where the model led so far astray that no boat comes back (`reset`).
    Where the model's motion is none of a boat's it begins anew at the estimate: `diverged`, where
    that is what is followed. After a long silence all begins anew.
    carry (NX + 21,): state, time, source, time and size (9) of the last offset, last row (9); NaN
    before the start -> out (K, 9), diverged (K,), reset (K,).
    """
    p, motion = unpack(theta), np.empty(6)
    for k in range(len(times)):
        inputs = held_inputs(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        estimate = report_from(estimates[k])
        first = not runs_on(times[k], carry[NX])
        if first:
            carry[:] = np.nan
        switched = not first and from_model[k] != (carry[NX + 1] > 0.0)
        if switched and from_model[k]:
            before = report_from(carry[NX + 12 : NX + 21])
            own = report_of_state(state_from(carry), carry[NX], inputs, p)
            carry[NX + 2] = carry[NX]
            offset = offset_between(to_world_motion(before), to_world_motion(own))
            set_row(carry[NX + 3 : NX + 12], offset)
        span = 0.0 if first else times[k] - carry[NX]
        if span > 0.0:
            set_row(carry, predict(state_from(carry), carry[NX], inputs, span, p))
        carry[NX] = times[k] if first else max(carry[NX], times[k])
        if not first and not is_possible(carry[3], carry[4], carry[5]):
            set_row(motion, true_motion(estimate, p)[:6])
            set_motion(carry, motion)
            set_row(carry, settle_memory(state_from(carry), carry[NX], inputs, p))
            carry[NX + 2] = np.nan
            diverged[k] = from_model[k]
        if switched and not from_model[k]:
            own = report_of_state(state_from(carry), carry[NX], inputs, p)
            own = with_decayed_offset(own, carry, fade)
            carry[NX + 2] = carry[NX]
            offset = offset_between(to_world_motion(own), to_world_motion(estimate))
            set_row(carry[NX + 3 : NX + 12], offset)
            if not can_return(offset, fade):
                carry[NX + 2] = np.nan
                reset[k] = True
        if anchored[k] or jumps[k] or first:
            set_row(carry, true_motion(estimate, p)[:6])
        if first:
            set_row(carry, settle_memory(state_from(carry), times[k], inputs, p))
        if jumps[k]:
            carry[NX + 2] = np.nan
        source = estimate
        if from_model[k]:
            source = report_of_state(state_from(carry), carry[NX], inputs, p)
        carry[NX + 1] = 1.0 if from_model[k] else 0.0
        set_row(carry[NX + 12 : NX + 21], with_decayed_offset(source, carry, fade))
        set_row(out[k], carry[NX + 12 : NX + 21])


@entry
def missing_force(
    theta: Floats, carry: Floats, times: Floats, motion: Floats, held: Floats, commands: Floats,
    voltage: Floats, wind: Floats, out: Floats, commanded: Floats, memory: Floats,
) -> None:  # fmt: skip
    """The balance along a measured motion: what the vessel needs beside its commanded forces.

    carry (NX + 1,): state and time, NaN before the start; of the state, only the memory of
    actuators and effects runs along, and starts anew where motion was not known and after a long
    silence.
    motion (K, 9) as reported; commands (K, na): those `held` over the interval that ends at their
    row, and those at its instant -> out (K, 3) missing force, commanded (K, 3) τ(commands)
    [N, N, N m], memory (K, NX − 6) at each row.
    """
    p = unpack(theta)
    for k in range(len(times)):
        inputs = held_inputs(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        first = not runs_on(times[k], carry[NX])
        if first:
            carry[:] = np.nan
        span = 0.0 if first else times[k] - carry[NX]
        if span > 0.0 and NX > 6:
            past = held_inputs(held[k], voltage[k], wind[k, 0], wind[k, 1], p)
            x = predict(state_from(carry), carry[NX], past, span, p)
            for i in range(6, NX):
                carry[i] = x[i]
        true = true_motion(report_from(motion[k]), p)
        set_row(carry, true[:6])
        x = state_from(carry)
        if not np.isfinite(carry[6:NX].sum()):
            x = settle_memory(x, times[k], inputs, p)
            set_row(carry, x)
        carry[NX] = times[k] if first else max(carry[NX], times[k])
        for i in range(6, NX):
            memory[k, i - 6] = carry[i]
        force = missing_wrench(x, true.u_dot, true.v_dot, true.r_dot, times[k], inputs, p)
        set_row(out[k], force)
        set_row(commanded[k], commanded_wrench(x, times[k], inputs, p))
