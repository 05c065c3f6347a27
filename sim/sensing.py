"""From the motion of the body origin to what the sensors report, and back.

    antenna at (x, y):  position + R(ψ)(x, y),  u − r y,  v + r x

Sensor effects come on top (`observe` laws). They map the prediction, never the data; where the
true motion is needed from the reported one, the map is inverted by fixed-point iteration, which
converges because every sensor effect is a small departure from the identity.
"""

from sim.body import Body, Report
from sim.jit import jitable
from sim.state import to_body, to_world

RELATIVE_ROUNDING = 1e-13  # of values that are equal but for rounding


@jitable
def at_antenna(report: Report, body: Body) -> Report:
    """Motion of the body origin -> motion of the antenna [m, rad, m/s, rad/s, m/s², rad/s²]."""
    x, y = body.antenna_x, body.antenna_y
    north, east = to_world(x, y, report.yaw)
    return Report(
        report.north + north,
        report.east + east,
        report.yaw,
        report.u - report.r * y,
        report.v + report.r * x,
        report.r,
        report.u_dot - report.r_dot * y,
        report.v_dot + report.r_dot * x,
        report.r_dot,
    )


@jitable
def corrected_vector(
    guess: Report, measured: Report, predicted: Report, yaw: float, i: int
) -> tuple[float, float]:
    """The vector of components i and i + 1, corrected in the world and turned back by `yaw`."""
    north, east = to_world(guess[i], guess[i + 1], guess.yaw)
    north_m, east_m = to_world(measured[i], measured[i + 1], measured.yaw)
    north_p, east_p = to_world(predicted[i], predicted[i + 1], predicted.yaw)
    return to_body(north + (north_m - north_p), east + (east_m - east_p), yaw)


@jitable
def inversion_step(guess: Report, measured: Report, predicted: Report) -> Report:
    """One step of the fixed-point iteration: guess + (measured − predicted).

    Velocity and acceleration are compared in the world, where an error of the compass, of any size,
    does not change them: the iteration then converges fast.
    """
    yaw = guess.yaw + (measured.yaw - predicted.yaw)
    u, v = corrected_vector(guess, measured, predicted, yaw, 3)
    u_dot, v_dot = corrected_vector(guess, measured, predicted, yaw, 6)
    return Report(
        guess.north + (measured.north - predicted.north),
        guess.east + (measured.east - predicted.east),
        yaw,
        u,
        v,
        guess.r + (measured.r - predicted.r),
        u_dot,
        v_dot,
        guess.r_dot + (measured.r_dot - predicted.r_dot),
    )


@jitable
def reports_agree(a: Report, b: Report) -> bool:
    """Whether two reports differ by no more than rounding (or one of them is not a number)."""
    agree = True
    for i in range(len(a)):
        agree = agree and not abs(a[i] - b[i]) > RELATIVE_ROUNDING * (1.0 + abs(a[i]))
    return agree
