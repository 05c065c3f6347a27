"""From the motion of the body origin to what the sensors report, and back.

    antenna at (x, y):  position + R(ψ)(x, y),  u − r y,  v + r x

Sensor effects come on top (`observe` laws). They map the prediction, never the data; where the
true motion is wanted from the reported one, the map is inverted by fixed-point iteration, which
converges because every sensor effect is a small departure from the identity.
"""

from sim.body import Body, Report
from sim.jit import jitable
from sim.state import to_world

ROUNDING = 1e-13  # relative


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
def corrected(guess: Report, measured: Report, predicted: Report) -> Report:
    """One step of the fixed-point iteration: guess + (measured − predicted)."""
    return Report(
        guess.north + (measured.north - predicted.north),
        guess.east + (measured.east - predicted.east),
        guess.yaw + (measured.yaw - predicted.yaw),
        guess.u + (measured.u - predicted.u),
        guess.v + (measured.v - predicted.v),
        guess.r + (measured.r - predicted.r),
        guess.u_dot + (measured.u_dot - predicted.u_dot),
        guess.v_dot + (measured.v_dot - predicted.v_dot),
        guess.r_dot + (measured.r_dot - predicted.r_dot),
    )


@jitable
def agree(a: Report, b: Report) -> bool:
    """True where two reports differ by no more than rounding (or one of them is not a number)."""
    alike = True
    for i in range(len(a)):
        alike = alike and not abs(a[i] - b[i]) > ROUNDING * (1.0 + abs(a[i]))
    return alike
