"""What the filter's covariance leaves out: a heading that is off by a slowly changing angle e.

    ψ + e    (u + e v, v − e u)    (u̇ + e v̇, v̇ − e u̇)         [rad, m/s, m/s²]

are what the filter sees where ψ, (u, v), (u̇, v̇) are true. Nothing tells e from motion, so it is
no state: linearised filters believe that they learn such an angle, and turn a good sway into a
bad one. Its variance is added to what is reported.
"""

from gateway.estimation.names import State
from gateway.jit import compiled
from sim.state import Floats
from sim.trial import MOTION


@compiled
def heading_slope(i: int, x: Floats) -> float:
    """How component i of the motion (9,) moves with the heading error: unit of i per rad."""
    if i == State.YAW:
        return 1.0
    if i == State.U:
        return float(x[State.V])
    if i == State.V:
        return float(-x[State.U])
    if i == State.U_DOT:
        return float(x[State.V_DOT])
    if i == State.V_DOT:
        return float(-x[State.U_DOT])
    return 0.0


@compiled
def add_heading_error(x: Floats, sigma: float, covariance: Floats) -> None:
    """Adds to the covariance (9, 9) of the motion x (9,) that of a heading error of std sigma."""
    for i in range(MOTION):
        for j in range(MOTION):
            covariance[i, j] += sigma * sigma * heading_slope(i, x) * heading_slope(j, x)
