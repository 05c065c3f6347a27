"""What of the boat itself may be wrong while it sails: a thruster, the compass, the drag, anything.

What each adds to the missing force, beside the small errors of a model that is right:

    thruster i   s τ_i                          s share of its thrust that it has too much
    compass      F(ν) − F(R(δ) ν)               δ reported − true heading [rad]
    drag         s (X_u + X_u|u| |u|) u         s growth of the damping ahead
    anything     w                              a force on the hull, wandering: [N, N, N m]

`F` is the balance of the vessel, τ_i the force of thruster i as commanded (mean of the second,
static curve). The last one is not a cause but what a named one has to beat: where it predicts
better than all of them, none of them is it.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from sim.actuators import thrust_at, thruster_force
from sim.body import ThrusterParameters
from sim.model import Model
from sim.monitoring.live_second import SecondMeans
from sim.state import Floats
from sim.vessel import Points, Thruster, as_table

# Chosen on the tuning voyages of benchmarks/live_naming.py.
THRUST_PRIOR = 0.6  # standard deviation of a thruster's share
COMPASS_PRIOR_RAD = 0.25
DRAG_PRIOR = 0.8
ANYTHING_PRIOR = 0.25  # of the thrust full ahead, and of that at half the beam
ANYTHING_DRIFT_S = 120.0  # in which it wanders by its prior
STEP_RAD = 1e-3

# second, value (n,) -> X, Y, N (3,) and its slope (3, n)
ForceAndSlope = Callable[[SecondMeans, Floats], tuple[Floats, Floats]]


class OwnCause(NamedTuple):
    """A cause aboard: prior standard deviations (n,), time of its walk [s], what it adds."""

    kind: str  # thrust, compass, drag, anything
    name: str  # of the thruster; empty else
    prior: Floats
    drift_s: float
    force: ForceAndSlope


def own_causes(model: Model, drift_s: float) -> tuple[OwnCause, ...]:
    """All causes aboard a vessel; `drift_s` is the time of a steady cause's walk."""
    return tuple(_of(model, drift_s))


def _of(model: Model, drift_s: float) -> Iterator[OwnCause]:
    vessel = model.vessel
    owner = {t.name: t.curve for t in vessel.thrusters}
    for i, thruster in enumerate(vessel.thrusters):
        curve = thruster.curve
        curve = owner.get(curve, curve) if isinstance(curve, str) else curve
        yield OwnCause(
            "thrust", thruster.name, np.array([THRUST_PRIOR]), drift_s,
            _thrust(thruster, i, as_table(curve)),
        )  # fmt: skip
    yield OwnCause("compass", "", np.array([COMPASS_PRIOR_RAD]), drift_s, _compass(model))
    yield OwnCause("drag", "", np.array([DRAG_PRIOR]), drift_s, _drag(model))
    thrust = sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass
    prior = ANYTHING_PRIOR * thrust * np.array([1.0, 1.0, 0.5 * vessel.hull.beam])
    yield OwnCause("anything", "", prior, ANYTHING_DRIFT_S, lambda second, w: (w, np.eye(3)))


def _thrust(thruster: Thruster, index: int, table: Points) -> ForceAndSlope:
    x, y = thruster.position
    points = np.array(table, float)
    astern, ahead = thruster.thrust
    drive = ThrusterParameters(float(index), x, y, thruster.azimuth, astern, ahead, 1.0)

    def force(second: SecondMeans, s: Floats) -> tuple[Floats, Floats]:
        command = float(second.mean_commands[index])
        share = float(np.interp(command, points[:, 0], points[:, 1]))
        thrust = float(thrust_at(command, share, drive))
        slope = np.array(thruster_force(thrust, thruster.azimuth, drive), float)[:, None]
        return slope[:, 0] * s[0], slope

    return force


def _compass(model: Model) -> ForceAndSlope:
    def force(second: SecondMeans, delta: Floats) -> tuple[Floats, Floats]:
        rows = np.tile(second.motion, (3, 1))
        for row, angle in zip(rows[1:], (delta[0], delta[0] + STEP_RAD), strict=True):
            c, s = np.cos(angle), np.sin(angle)
            for i in (3, 6):  # velocity, acceleration: both turn with the heading
                u, v = row[i : i + 2].tolist()
                row[i : i + 2] = c * u - s * v, s * u + c * v
        commands = np.tile(second.commands, (3, 1))
        F, _ = model.missing_force(rows, np.full(3, second.time), commands, commands)
        return F[0] - F[1], ((F[1] - F[2]) / STEP_RAD)[:, None]

    return force


def _drag(model: Model) -> ForceAndSlope:
    d = model.vessel.dynamics

    def force(second: SecondMeans, s: Floats) -> tuple[Floats, Floats]:
        u = float(second.nu[0])
        slope = np.array([[(d.X_u + d.X_uu * abs(u)) * u], [0.0], [0.0]])
        return slope[:, 0] * s[0], slope

    return force
