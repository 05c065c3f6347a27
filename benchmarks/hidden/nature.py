"""The truth: a boat and the causes that act on it, as one differential equation.

State: north, east, yaw, v_north, v_east (over ground, Newton's frame), r, one shaft speed n per
motor in shares of full speed, and one angle per rudder. A motor thrusts k n|n|; a command sets n.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.hidden.boats import Boat, Hull
from benchmarks.hidden.hull import answer, damping
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.rudder import blade
from benchmarks.hidden.scene import Push, Report, Scene, Stream

PUSH_S = 0.05  # in which a rudder that is pushed moves
YAW, V_NORTH, V_EAST, R, SHAFTS = 2, 3, 4, 5, 6  # places in the state


@dataclass(frozen=True)
class Cause:
    """Something that can be hidden, and where it acts; what is left out does not act."""

    delay: float = 0.0  # s, until the motors hear a command
    shaft_lag: float = 0.0  # s, until a shaft turns as commanded
    rudder_lag: float = 0.0  # s, until a rudder stands as commanded
    rudder_play: float = 0.0  # rad to either side, in which a rudder is not moved
    rudder_rate: float = math.inf  # rad/s, that a rudder turns at most
    turned: float = 0.0  # rad, of all motors, clockwise
    arms: float = 1.0  # of the distance of all motors from the centre line
    rudder_turned: float = 0.0  # rad, of all rudders, to starboard
    rudder_gain: float = 1.0  # of the angle of all rudders
    tired: float = 1.0  # how many times as fast the battery empties and sags
    latency: float = 0.0  # s, age of reported position and velocity
    command: Callable[[list[float]], list[float]] | None = None
    thrust: Callable[[float, Motor, Scene], float] | None = None
    water: Callable[[float, float, float], Stream] | None = None  # time, north, east
    push: Callable[[Scene, Sequence[float]], Push] | None = None  # scene, thrusts
    hull: Callable[[Hull, float], Hull] | None = None  # hull, time
    report: Callable[[Report], Report] | None = None


class Nature:
    """A boat among causes: laws only, no state."""

    def __init__(self, boat: Boat, causes: Sequence[Cause] = ()) -> None:
        self.boat = boat
        self.delay = sum(c.delay for c in causes)
        self.shaft_lag = sum(c.shaft_lag for c in causes)
        self.rudder_lag = sum(c.rudder_lag for c in causes)
        self.rudder_play = sum(c.rudder_play for c in causes)
        self.rudder_rate = min((c.rudder_rate for c in causes), default=math.inf)
        limited = self.rudder_rate < math.inf
        self._stands_apart = bool(self.rudder_lag or self.rudder_play or limited)
        self.tired = math.prod(c.tired for c in causes)
        self.latency = sum(c.latency for c in causes)
        self._turned = sum(c.turned for c in causes)
        self._arms = math.prod(c.arms for c in causes)
        self._rudder_turned = sum(c.rudder_turned for c in causes)
        self._rudder_gain = math.prod(c.rudder_gain for c in causes)
        self._commands = [c.command for c in causes if c.command]
        self._thrusts = [c.thrust for c in causes if c.thrust]
        self._waters = [c.water for c in causes if c.water]
        self._pushes = [c.push for c in causes if c.push]
        self._hulls = [c.hull for c in causes if c.hull]
        self._reports = [c.report for c in causes if c.report]

    def rates(
        self, time: float, state: list[float], commands: Sequence[float], voltage: float
    ) -> list[float]:
        """The derivative of the state at a time [s]: list of 6 + motors + rudders."""
        water = self.water(time, state[0], state[1])
        scene = self._scene(time, state, water, voltage)
        motors = len(self.boat.motors)
        asked, angles = self._shaft_speeds(commands[:motors]), self._angles(commands[motors:])
        shafts = state[SHAFTS : SHAFTS + motors] if self.shaft_lag else asked
        stand = state[SHAFTS + motors :] if self._stands_apart else angles
        push = self._push(scene, shafts, stand)
        u_dot, v_dot, r_dot = answer(scene.hull, scene.u, scene.v, scene.r, push)
        forward, starboard = u_dot - scene.r * scene.v, v_dot + scene.r * scene.u
        c, s = math.cos(state[YAW]), math.sin(state[YAW])
        return [
            state[V_NORTH],
            state[V_EAST],
            state[R],
            c * forward - s * starboard + water.north_dot,
            s * forward + c * starboard + water.east_dot,
            r_dot,
            *_following(asked, state[SHAFTS : SHAFTS + motors], self.shaft_lag),
            *self._steering(angles, state[SHAFTS + motors :]),
        ]

    def water(self, time: float, north: float, east: float) -> Stream:
        """How the water moves there and then."""
        streams = [water(time, north, east) for water in self._waters]
        return Stream(*(sum(part) for part in zip(*streams, strict=True))) if streams else STILL

    def reported(self, report: Report) -> Report:
        """True motion -> motion as the sensors' own errors show it (latency apart)."""
        for law in self._reports:
            report = law(report)
        return report

    def _scene(self, time: float, state: list[float], water: Stream, voltage: float) -> Scene:
        north, east, yaw, v_north, v_east, r = state[:SHAFTS]
        hull = self.boat.hull
        for law in self._hulls:
            hull = law(hull, time)
        c, s = math.cos(yaw), math.sin(yaw)
        over_u, over_v = c * v_north + s * v_east, c * v_east - s * v_north
        u = over_u - (c * water.north + s * water.east)
        v = over_v - (c * water.east - s * water.north)
        return Scene(time, north, east, yaw, u, v, r, over_u, over_v, voltage, hull)

    def _shaft_speeds(self, commands: Sequence[float]) -> list[float]:
        asked = list(commands)
        for law in self._commands:
            asked = law(asked)
        if self.boat.curve == 2:
            return asked
        return [math.copysign(math.sqrt(abs(c)), c) for c in asked]

    def _angles(self, commands: Sequence[float]) -> list[float]:
        rudders = zip(commands, self.boat.rudders, strict=True)
        return [c * rudder.most * self._rudder_gain + self._rudder_turned for c, rudder in rudders]

    def _steering(self, angles: Sequence[float], now: Sequence[float]) -> list[float]:
        """Rates of the rudders, each pushed from where its play ends, as fast as it can turn."""
        if not self._stands_apart:
            return _following(angles, now, 0.0)
        pushed = [
            max(min(n, a + self.rudder_play), a - self.rudder_play)
            for a, n in zip(angles, now, strict=True)
        ]
        rates = _following(pushed, now, self.rudder_lag or PUSH_S)
        return [max(min(rate, self.rudder_rate), -self.rudder_rate) for rate in rates]

    def _push(self, scene: Scene, shafts: Sequence[float], angles: Sequence[float]) -> Push:
        motors, rudders = self.boat.motors, list(zip(self.boat.rudders, angles, strict=True))
        thrusts = [self._thrust(n, m, scene) for n, m in zip(shafts, motors, strict=True)]
        steered = {r.behind: -angle for r, angle in rudders if not r.area}
        of = {m.name: f for m, f in zip(motors, thrusts, strict=True)}
        pushes = [damping(scene.hull, scene.u, scene.v, scene.r)]
        pushes += [self._motor(of[m.name], m, steered.get(m.name, 0.0)) for m in motors]
        pushes += [blade(r, angle, of[r.behind], scene) for r, angle in rudders if r.area]
        pushes += [law(scene, thrusts) for law in self._pushes]
        return Push(*(sum(part) for part in zip(*pushes, strict=True)))

    def _thrust(self, n: float, motor: Motor, scene: Scene) -> float:
        force = n * abs(n) * (motor.ahead if n > 0.0 else -motor.astern)
        for law in self._thrusts:
            force = law(force, motor, scene)
        return force

    def _motor(self, force: float, motor: Motor, steered: float) -> Push:
        angle = self._turned + steered
        X, Y = force * math.cos(angle), force * math.sin(angle)
        return Push(X, Y, motor.x * Y - self._arms * motor.y * X)


def _following(asked: Sequence[float], now: Sequence[float], lag: float) -> list[float]:
    """Rates of what follows what is asked with a lag [s]; without one it does so at once."""
    return [(a - n) / lag if lag else 0.0 for a, n in zip(asked, now, strict=True)]


STILL = Stream(0.0, 0.0)
