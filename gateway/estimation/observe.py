"""What each kind of event would read in a given state, and how that depends on the state.

    yaw: ψ    rate: r − d ṙ    position: (N, E) + e_p
    velocity: R(ψ) (u, v) + e_v    body velocity: (u, v) + e_v
    acceleration: (u̇ − r v, v̇ + r u)

Units rad, rad/s, m, m/s, m/s²; the e are the coloured errors of the sensors, d is the delay of
the gyro's low-pass filter.
"""

import numpy as np

from gateway.estimation.names import Kind, State
from gateway.jit import compiled
from sim.state import Floats, wrap


@compiled
def observe(kind: int, x: Floats, z: Floats, gyro_delay: float, H: Floats, y: Floats) -> int:
    """State (13,), reading (2,) -> Jacobian H (2, 13), innovation y (2,); how many components."""
    H[:] = 0.0
    y[:] = 0.0
    if kind == Kind.YAW:
        H[0, State.YAW] = 1.0
        y[0] = wrap(z[0] - x[State.YAW])
        return 1
    if kind == Kind.YAW_RATE:
        H[0, State.R], H[0, State.R_DOT] = 1.0, -gyro_delay
        y[0] = z[0] - x[State.R] + gyro_delay * x[State.R_DOT]
        return 1
    if kind == Kind.VELOCITY:
        return _velocity(x, z, H, y)
    if kind == Kind.POSITION:
        H[0, State.NORTH] = H[0, State.POSITION_ERROR_NORTH] = 1.0
        H[1, State.EAST] = H[1, State.POSITION_ERROR_EAST] = 1.0
        y[0] = z[0] - x[State.NORTH] - x[State.POSITION_ERROR_NORTH]
        y[1] = z[1] - x[State.EAST] - x[State.POSITION_ERROR_EAST]
        return 2
    if kind == Kind.BODY_VELOCITY:
        H[0, State.U] = H[0, State.VELOCITY_ERROR_FIRST] = 1.0
        H[1, State.V] = H[1, State.VELOCITY_ERROR_SECOND] = 1.0
        y[0] = z[0] - x[State.U] - x[State.VELOCITY_ERROR_FIRST]
        y[1] = z[1] - x[State.V] - x[State.VELOCITY_ERROR_SECOND]
        return 2
    if kind == Kind.ACCELERATION:
        return _acceleration(x, z, H, y)
    return 0


@compiled
def _velocity(x: Floats, z: Floats, H: Floats, y: Floats) -> int:
    """Velocity over ground towards north and east [m/s]."""
    c, s = np.cos(x[State.YAW]), np.sin(x[State.YAW])
    north = c * x[State.U] - s * x[State.V]
    east = s * x[State.U] + c * x[State.V]
    H[0, State.YAW], H[0, State.U], H[0, State.V] = -east, c, -s
    H[1, State.YAW], H[1, State.U], H[1, State.V] = north, s, c
    H[0, State.VELOCITY_ERROR_FIRST] = H[1, State.VELOCITY_ERROR_SECOND] = 1.0
    y[0] = z[0] - north - x[State.VELOCITY_ERROR_FIRST]
    y[1] = z[1] - east - x[State.VELOCITY_ERROR_SECOND]
    return 2


@compiled
def _acceleration(x: Floats, z: Floats, H: Floats, y: Floats) -> int:
    """Acceleration of the sensor's place, forward and starboard [m/s²]."""
    u, v, r = x[State.U], x[State.V], x[State.R]
    H[0, State.U_DOT], H[0, State.V], H[0, State.R] = 1.0, -r, -v
    H[1, State.V_DOT], H[1, State.U], H[1, State.R] = 1.0, r, u
    y[0] = z[0] - x[State.U_DOT] + r * v
    y[1] = z[1] - x[State.V_DOT] - r * u
    return 2
