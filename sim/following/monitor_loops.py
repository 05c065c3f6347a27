"""The loops that monitor the vessel while it runs: deviation of the missing force, forecasts.

`sim.kernel.generator` copies the text below the mark into every kernel, see `sim.kernel.loops`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.following import MAX_SPEED_MPS, MAX_TURN_RADPS, runs_on, within
from sim.following.loops import predict
from sim.jit import jitable as entry
from sim.kernel.loops import held_inputs, report_of_state, true_motion
from sim.kernel.rows import report_from, set_row
from sim.state import Floats

if TYPE_CHECKING:
    from sim.kernel import NX, missing_wrench, settle_memory, state_from, unpack

# -- the text from here on goes into the kernel --

# difference steps of eta, nu, nu_dot [m, rad, s]; chosen far above rounding and far below the
# motion over which damping bends, not measured
DIFFERENCE_STEPS = (1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4)


@entry
def missing_force_std(
    theta: Floats, times: Floats, motion: Floats, covariance: Floats, commands: Floats,
    voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """Uncertain motion (K, 9) with covariance (K, 9, 9) -> std of the missing force (K, 3).

    First order: √diag(J P Jᵀ), J by central differences of the balance. Actuators are taken as
    settled under their commands (K, na): their memory is known and adds no uncertainty.
    """
    p = unpack(theta)
    base, row = np.full(NX, np.nan), np.empty(9)
    J = np.empty((3, 9))
    for k in range(len(times)):
        inputs = held_inputs(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        for i in range(9):
            for side in range(2):
                set_row(row, motion[k])
                row[i] += DIFFERENCE_STEPS[i] * (1.0 - 2.0 * side)
                m = true_motion(report_from(row), p)
                set_row(base, m[:6])
                x = settle_memory(state_from(base), times[k], inputs, p)
                force = missing_wrench(x, m.u_dot, m.v_dot, m.r_dot, times[k], inputs, p)
                for j in range(3):
                    if side == 0:
                        J[j, i] = force[j]
                    else:
                        J[j, i] = (J[j, i] - force[j]) / (2.0 * DIFFERENCE_STEPS[i])
        for j in range(3):
            variance = 0.0
            for a in range(9):
                for b in range(9):
                    variance += J[j, a] * covariance[k, a, b] * J[j, b]
            out[k, j] = np.sqrt(max(variance, 0.0))


@entry
def forecast(
    theta: Floats, runs: Floats, errors: Floats, horizons: Floats, every: float, times: Floats,
    motion: Floats, commands: Floats, voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """Free predictions started again and again, and their errors.

    runs (S, NX + 2): state, start time and time of each prediction, NaN where free; the first row
    follows the measurement and lends its memory to those that start. errors (H, 3): the latest
    known error of u, v, r at each horizon [s], NaN before. A prediction starts `every` seconds;
    all are dropped after a long silence, and none is taken to be faster than a boat can be.
    motion (K, 9) as reported, commands (K, na) hold over the interval that ends at their row ->
    out (K, H, 3), measured − predicted. runs and errors are carried, changed in place.
    """
    p = unpack(theta)
    longest = horizons[len(horizons) - 1]
    newest = -np.inf
    for s in range(1, len(runs)):
        if runs[s, NX] > newest:
            newest = runs[s, NX]
    for k in range(len(times)):
        t, measured = times[k], report_from(motion[k])
        inputs = held_inputs(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        for s in range(len(runs)):
            before = runs[s, NX + 1]
            if not runs_on(t, before):
                newest = newest if np.isnan(before) else -np.inf
                runs[s] = np.nan
            elif t > before:
                set_row(runs[s], predict(state_from(runs[s]), before, inputs, t - before, p))
                runs[s, NX + 1] = t
                if s > 0:
                    for h in range(len(horizons)):
                        if before - runs[s, NX] < horizons[h] <= t - runs[s, NX]:
                            predicted = report_of_state(state_from(runs[s]), t, inputs, p)
                            errors[h, 0] = measured.u - within(predicted.u, MAX_SPEED_MPS)
                            errors[h, 1] = measured.v - within(predicted.v, MAX_SPEED_MPS)
                            errors[h, 2] = measured.r - within(predicted.r, MAX_TURN_RADPS)
                    if t - runs[s, NX] >= longest:
                        runs[s, NX], runs[s, NX + 1] = np.nan, np.nan
        first = not np.isfinite(runs[0, NX])
        set_row(runs[0], true_motion(measured, p)[:6])
        if first:
            set_row(runs[0], settle_memory(state_from(runs[0]), t, inputs, p))
            runs[0, NX], runs[0, NX + 1] = t, t
        if t >= newest + every:
            for s in range(1, len(runs)):
                if not np.isfinite(runs[s, NX]):
                    set_row(runs[s], runs[0])
                    runs[s, NX], runs[s, NX + 1] = t, t
                    newest = t
                    break
        for h in range(len(horizons)):
            set_row(out[k, h], errors[h])
