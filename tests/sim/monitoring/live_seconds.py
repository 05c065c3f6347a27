"""Seconds of a made voyage as the live diagnosis sees them."""

from collections.abc import Iterator

import numpy as np

from sim.model import Model
from sim.monitoring import SecondMeans, world_to_body
from sim.state import Floats
from sim.vessel import Vessel
from tests.sim.voyages import WAM_V

NOISE = np.array([4.0, 4.0, 1.0])  # N, N, N m
STATED = 1.5 * NOISE
NONE = np.full((2, 3), np.nan)


def seconds(
    count: int, *, vessel: Vessel = WAM_V, stream: Floats | None = None, push: Floats | None = None,
    body: Floats | None = None, headings: int = 8, seed: int = 1, first: int = 0,
    thrust: Floats | None = None, compass: float = 0.0, drag: float = 0.0, leg_s: int = 20,
    steer: float = 0.15,
) -> Iterator[SecondMeans]:  # fmt: skip
    """A boat on legs of `leg_s`, its motion made up, its missing force what the causes say.

    stream (2,) [m/s] of the water, push (2,) [N] in the world, body (3,) [N, N, N m], thrust (2,)
    share that port and starboard give too much, compass [rad] reported − true, drag its growth.
    """
    rng, model = np.random.default_rng(seed), Model.of(vessel)
    stream = np.zeros(2) if stream is None else stream
    for k in range(first, first + count):
        leg = k // leg_s
        yaw = 2.0 * np.pi * ((3 * leg) % headings) / 8.0
        u = 0.8 + 0.5 * (leg % 3) + 0.05 * rng.standard_normal()
        through = np.array([u, 0.05 * rng.standard_normal(), 0.02 * rng.standard_normal()])
        nu = through + np.append(world_to_body(stream, yaw), 0.0)
        motion = np.concatenate([[0.0, 0.0, yaw], nu, 0.02 * rng.standard_normal(3)])
        turn = steer * (leg % 4 - 1.5)
        command = np.array([[0.4 + turn, 0.4 - turn] * (len(vessel.actuators) // 2)])
        missing, commanded = forces(model, motion, stream, command)
        missing = missing + NOISE * rng.standard_normal(3)
        if push is not None:
            missing[:2] += world_to_body(push, yaw)
        if body is not None:
            missing = missing + body
        if thrust is not None:
            each = thrust * 90.0 * command[0]  # N full ahead, 0.7 m off the middle
            missing = missing + np.array([each.sum(), 0.0, 0.7 * (each[0] - each[1])])
        if drag:
            d = vessel.dynamics
            missing[0] += drag * (d.X_u + d.X_uu * abs(nu[0])) * nu[0]
        if compass:
            missing = missing + off_course(model, motion, compass, command)
        variance = np.array([0.03, 0.03, 0.004]) ** 2
        yield SecondMeans(
            float(k), motion, variance, missing, STATED, commanded, command[0], NONE, command[0]
        )


def off_course(model: Model, motion: Floats, angle: float, command: Floats) -> Floats:
    """What a heading that reads so much too far to starboard adds to the missing force."""
    true = motion.copy()
    for i in (3, 6):
        true[i : i + 2] = world_to_body(motion[i : i + 2], -angle)
    F, _ = model.missing_force(
        np.array([motion, true]), np.zeros(2), np.tile(command, (2, 1)), np.tile(command, (2, 1))
    )
    return F[0] - F[1]


def forces(model: Model, motion: Floats, stream: Floats, command: Floats) -> tuple[Floats, Floats]:
    """What a current adds to the missing force: balance over ground less balance through water."""
    row, yaw, r = motion[None], motion[2], motion[5]
    u_c, v_c = world_to_body(stream, yaw)
    wet = motion.copy()
    wet[3:] -= np.array([u_c, v_c, 0.0, r * v_c, -r * u_c, 0.0])
    over, commanded = model.missing_force(row, np.zeros(1), command, command)
    through, _ = model.missing_force(wet[None], np.zeros(1), command, command)
    return (over - through)[0], commanded[0]
