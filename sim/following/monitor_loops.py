"""The loops that watch the vessel while it runs: uncertainty of the missing force, forecasts.

`sim.kernel.cache` copies this file's text into every kernel, see `sim.kernel.loops`.
"""

import numpy as np

from sim.body import Report
from sim.following.loops import LONGEST_STEP
from sim.jit import jitable as entry
from sim.kernel.loops import advance, held, report_of, true_motion
from sim.kernel.signatures import NX, at_rest, missing, state_from, unpack
from sim.state import Floats

# -- the text from here on goes into the kernel --

STEPS = (1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4)  # of eta, nu, nu_dot: differences


@entry
def missing_spread(
    theta: Floats, times: Floats, motion: Floats, covariance: Floats, around: Floats,
    voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """Uncertain motion (K, 9) with covariance (K, 9, 9) -> std of the missing force (K, 3).

    First order: √diag(J P Jᵀ), J by central differences of the balance. Actuators are taken at
    rest under their commands: their memory is known, it adds no spread.
    """
    p = unpack(theta)
    base, row = np.full(NX, np.nan), np.empty(9)
    J = np.empty((3, 9))
    for k in range(len(times)):
        inputs = held(around[k], voltage[k], wind[k, 0], wind[k, 1], p)
        for i in range(9):
            for side in range(2):
                row[:] = motion[k]
                row[i] += STEPS[i] * (1.0 - 2.0 * side)
                m = true_motion(
                    Report(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8]),
                    p,
                )
                base[0], base[1], base[2], base[3], base[4], base[5] = m[:6]
                x = at_rest(state_from(base), times[k], inputs, p)
                force = missing(x, m.u_dot, m.v_dot, m.r_dot, times[k], inputs, p)
                for j in range(3):
                    if side == 0:
                        J[j, i] = force[j]
                    else:
                        J[j, i] = (J[j, i] - force[j]) / (2.0 * STEPS[i])
        for j in range(3):
            variance = 0.0
            for a in range(9):
                for b in range(9):
                    variance += J[j, a] * covariance[k, a, b] * J[j, b]
            out[k, j] = np.sqrt(max(variance, 0.0))


@entry
def forecast(
    theta: Floats, bank: Floats, errors: Floats, horizons: Floats, every: float, times: Floats,
    motion: Floats, commands: Floats, voltage: Floats, wind: Floats, out: Floats,
) -> None:  # fmt: skip
    """Free predictions started again and again, and how wrong they turn out.

    bank (S, NX + 2): state, start time and time of each prediction, NaN where free; its first row
    follows the measurement and lends its memory to those that start. errors (H, 3): the latest
    known error of u, v, r at each horizon [s], NaN before. A prediction starts `every` seconds.
    motion (K, 9) as reported, commands (K, na) hold over the interval that ends at their row ->
    out (K, H, 3), measured − predicted. bank and errors are carried, changed in place.
    """
    p = unpack(theta)
    longest = horizons[len(horizons) - 1]
    newest = -np.inf
    for s in range(1, len(bank)):
        if bank[s, NX] > newest:
            newest = bank[s, NX]
    for k in range(len(times)):
        t, a = times[k], motion[k]
        inputs = held(commands[k], voltage[k], wind[k, 0], wind[k, 1], p)
        for s in range(len(bank)):
            before = bank[s, NX + 1]
            if np.isfinite(before) and t > before:
                n = int(np.ceil((t - before) / LONGEST_STEP - 1e-9))
                x = advance(state_from(bank[s]), before, inputs, t - before, n, p)
                for i in range(NX):
                    bank[s, i] = x[i]
                bank[s, NX + 1] = t
                if s > 0:
                    for h in range(len(horizons)):
                        if before - bank[s, NX] < horizons[h] <= t - bank[s, NX]:
                            said = report_of(state_from(bank[s]), t, inputs, p)
                            errors[h, 0], errors[h, 1] = a[3] - said.u, a[4] - said.v
                            errors[h, 2] = a[5] - said.r
                    if t - bank[s, NX] >= longest:
                        bank[s, NX], bank[s, NX + 1] = np.nan, np.nan
        fresh = not np.isfinite(bank[0, NX])
        true = true_motion(Report(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]), p)
        bank[0, 0], bank[0, 1], bank[0, 2] = true.north, true.east, true.yaw
        bank[0, 3], bank[0, 4], bank[0, 5] = true.u, true.v, true.r
        if fresh:
            x = at_rest(state_from(bank[0]), t, inputs, p)
            for i in range(NX):
                bank[0, i] = x[i]
            bank[0, NX], bank[0, NX + 1] = t, t
        if t >= newest + every:
            for s in range(1, len(bank)):
                if not np.isfinite(bank[s, NX]):
                    bank[s] = bank[0]
                    bank[s, NX], bank[s, NX + 1] = t, t
                    newest = t
                    break
        for h in range(len(horizons)):
            for i in range(3):
                out[k, h, i] = errors[h, i]
