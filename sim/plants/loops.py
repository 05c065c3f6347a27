"""The horizontal balance of a vessel at one moment, for plants of more than three degrees.

`sim.kernel.generator` copies the text below the mark into every kernel, see `sim.kernel.loops`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.jit import jitable as entry
from sim.kernel.loops import held_inputs, set_row
from sim.state import Floats, Wrench

if TYPE_CHECKING:
    from sim.kernel.signatures import (
        NX,
        balance,
        flow_at,
        settle_memory,
        state_from,
        state_rates_under_force,
        unpack,
        water_at,
    )
    from sim.state import Pose

# -- the text from here on goes into the kernel --


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
