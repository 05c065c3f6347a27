"""Rows of numbers in the loops of all kernels: compiled once, and not with each of them."""

from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.typing import signature
from numba.extending import intrinsic

from sim.body import Report
from sim.jit import jitable
from sim.state import Floats, to_body, to_world


@jitable
def set_row(row: Floats, values: tuple[float, ...] | Floats) -> None:
    """Values into the first places of a row.

    Of arrays too: for `row[:3] = values` numba compiles the text of an error, which takes seconds.
    """
    for i in range(len(values)):
        row[i] = values[i]


@jitable
def report_from(row: Floats) -> Report:
    """A row (9,) as a report."""
    return Report(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8])


@jitable
def motion_of_state(x: tuple[float, ...], k: tuple[float, ...]) -> Report:
    """The true motion of a state and its rates."""
    return Report(x[0], x[1], x[2], x[3], x[4], x[5], k[3], k[4], k[5])


@jitable
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


@jitable
def integral_at(total: Floats, position: float, i: int) -> float:
    """Command i integrated up to a position in steps; its edges are continued."""
    k = min(max(int(np.floor(position)), 0), len(total) - 2)
    return total[k, i] + (position - k) * (total[k + 1, i] - total[k, i])


def numbers_at(theta: Floats, start: int, kind: type) -> Any:
    """The named tuple of a kind from parameters (P,) or (P, B) that begin at `start`."""
    return kind(*theta[start : start + len(kind._fields)])  # type: ignore[attr-defined]


@intrinsic
def compiled_numbers_at(context: Any, theta: Any, start: Any, kind: Any) -> Any:
    """`numbers_at` for compiled code: to numba one line, and not one for each number."""
    count = len(kind.instance_class._fields)
    made = types.NamedUniTuple(types.float64, count, kind.instance_class)

    def loads(context: Any, builder: Any, call: Any, arguments: Any) -> Any:
        row = context.make_array(call.args[0])(context, builder, arguments[0])
        first = builder.gep(row.data, [arguments[1]])
        values = [builder.load(cgutils.gep(builder, first, k)) for k in range(count)]
        return context.make_tuple(builder, made, values)

    return signature(made, theta, types.intp, kind), loads
