"""Ten kinds again that no catalogue holds.

Nothing was tuned on any before they were first reported on.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Scene, Stream


def thrust_gap(low: float, high: float) -> Cause:
    """A controller skips a band of thrust, `low` to `high` of full: it stays at the band's foot."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        share = F / motor.ahead
        return low * motor.ahead if low < share < high else F

    return Cause(thrust=thrust)


def keel_stall(speed: float, share: float) -> Cause:
    """A keel stalls: above a speed sideways [m/s] a `share` of the sideways damping is gone."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        stalled = 0.5 + 0.5 * math.tanh((abs(s.v) - speed) / (0.2 * speed))
        return Push(0.0, -share * stalled * damping(s.hull, s.u, s.v, s.r).Y, 0.0)

    return Cause(push=push)


def turning_drag(X_rr: float) -> Cause:
    """A hull that turns is dragged back by X_rr r², whatever its speed."""
    return Cause(push=lambda s, thrusts: Push(math.copysign(X_rr, -s.u) * s.r**2, 0.0, 0.0))


def leeway_drag(X_vv: float) -> Cause:
    """A hull that slips sideways is dragged back by X_vv v²."""
    return Cause(push=lambda s, thrusts: Push(math.copysign(X_vv, -s.u) * s.v**2, 0.0, 0.0))


def warming_up(share: float, seconds: float) -> Cause:
    """Cold batteries: a `share` of the thrust is missing at first, and comes within `seconds`."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * math.exp(-s.time / seconds))

    return Cause(thrust=thrust)


def eddy(north: float, east: float, radius: float, speed: float) -> Cause:
    """Water that turns around a place, `speed` [m/s] at `radius` [m], less further out and in."""

    def water(time: float, n: float, e: float) -> Stream:
        x, y = (n - north) / radius, (e - east) / radius
        size = speed * math.exp(0.5 - 0.5 * (x * x + y * y))
        return Stream(-size * y, size * x)

    return Cause(water=water)


def squalls(force: float, towards: float, period: float, lasts: float) -> Cause:
    """A wind's force [N] amidships, `towards` [rad], that comes each `period` and `lasts` [s]."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        now = force if s.time % period < lasts else 0.0
        X, Y = s.in_body(now * math.cos(towards), now * math.sin(towards))
        return Push(X, Y, 0.0)

    return Cause(push=push)


def crossed_wash(share: float, x: float) -> Cause:
    """The wash of motors that pull apart meets a skeg at `x` [m]: a `share` of their difference
    pushes it sideways.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = share * (thrusts[0] - thrusts[-1])
        return Push(0.0, Y, x * Y)

    return Cause(push=push)


def gyro_gain(gain: float) -> Cause:
    """The gyro's rate is (1 + gain) times the boat's; the heading is true."""
    return Cause(report=lambda m: m._replace(r=(1.0 + gain) * m.r))


def log_gain(gain: float) -> Cause:
    """The receiver's velocity is (1 + gain) times the boat's; the position is true."""
    k = 1.0 + gain
    return Cause(report=lambda m: m._replace(v_north=k * m.v_north, v_east=k * m.v_east))


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        thrust_gap, keel_stall, turning_drag, leeway_drag, warming_up, eddy, squalls,
        crossed_wash, gyro_gain, log_gain,
    )
}  # fmt: skip
