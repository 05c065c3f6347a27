"""From the motion of the body origin to what the sensors report, and back.

    antenna at (x, y):  position + R(ψ)(x, y),  u − r y,  v + r x

Sensor effects come on top (`observe` laws). They map the prediction, never the data; where the
true motion is wanted from the reported one, the map is inverted by fixed-point iteration, which
converges because every sensor effect is a small departure from the identity.
"""

from sim.body import Body, Report
from sim.jit import jitable
from sim.state import to_body, to_world

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
def shifted(
    guess: Report, measured: Report, predicted: Report, yaw: float, i: int
) -> tuple[float, float]:
    """Components i and i + 1, a vector, corrected in the world and seen again under `yaw`."""
    north, east = to_world(guess[i], guess[i + 1], guess.yaw)
    north_m, east_m = to_world(measured[i], measured[i + 1], measured.yaw)
    north_p, east_p = to_world(predicted[i], predicted[i + 1], predicted.yaw)
    return to_body(north + (north_m - north_p), east + (east_m - east_p), yaw)


@jitable
def corrected(guess: Report, measured: Report, predicted: Report) -> Report:
    """One step of the fixed-point iteration: guess + (measured − predicted).

    Velocity and acceleration are compared in the world, where a compass that is off, by however
    much, leaves them alone: what is left then goes down fast.
    """
    yaw = guess.yaw + (measured.yaw - predicted.yaw)
    u, v = shifted(guess, measured, predicted, yaw, 3)
    u_dot, v_dot = shifted(guess, measured, predicted, yaw, 6)
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
def agree(a: Report, b: Report) -> bool:
    """True where two reports differ by no more than rounding (or one of them is not a number)."""
    alike = True
    for i in range(len(a)):
        alike = alike and not abs(a[i] - b[i]) > ROUNDING * (1.0 + abs(a[i]))
    return alike
