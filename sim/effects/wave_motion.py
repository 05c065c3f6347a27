"""Wave motion: a train of long-crested waves that pushes the boat to and fro as it passes.

    F = force sin(omega t − k s + phase)
    k = omega² / g,   s = N cos direction + E sin direction

F acts along direction [rad from north, towards]; force [N] at the crests, omega [rad/s], t [s after
the first sample], N and E [m] position, phase [rad], g = 9.81 m/s². Sailing with or against the
waves moves the frequency of encounter. Valid for: one frequency, deep water, waves longer than the
boat. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, §10.2 (dispersion and
frequency of encounter).

A search begins at the peaks of matched filters over frequency and direction:

    A_w(ω, θ) = mean over window w of f_θ exp −i (ω t − ω² s_θ / g)

f_θ is the missing force along direction θ, s_θ the place along it. A boat that has moved by s meets
waves ω² s / g later: over a whole voyage that is many turns of phase, so direction and frequency
must be met more closely than any step of a fit can mend. Over short windows the peak is broad: they
are searched whole, Σ_w |A_w|²; the few best are followed through windows three times as long, and
steps a third as wide, up to the whole voyage.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Parameter,
    Remainder,
    Scope,
    Values,
)
from sim.state import Floats, Wrench, to_body

GRAVITY = 9.81  # m/s²
FINEST = 0.8  # rad/s where waves begin; slower ones are currents and gusts
FASTEST = 6.0  # rad/s
EVERY = 0.4  # s between the samples that are looked at
WINDOW = 50.0  # s, the first
LONGER = 3  # times, the next
OMEGAS = 0.04  # rad/s between frequencies of the first look
DIRECTIONS = 96  # of the first look
FOLLOWED = 8  # of its best points
TRAINS = 2  # the second in what the first leaves: side lobes of a strong one are no train
GRID = np.arange(-3, 4)  # steps to either side


class Parameters(NamedTuple):
    force: float
    omega: float
    direction: float
    phase: float


def force(flow: Flow, p: Parameters) -> Wrench:
    """Place, heading and time -> X, Y, N [N, N, N m]."""
    c, s = np.cos(p.direction), np.sin(p.direction)
    along = c * flow.north + s * flow.east
    k = p.omega * p.omega / GRAVITY
    push = p.force * np.sin(p.omega * flow.time - k * along + p.phase)
    X, Y = to_body(push * c, push * s, flow.yaw)
    return Wrench(X, Y, 0.0)


def phase_at(time: Floats, north: Floats, east: Floats, p: Values) -> Floats:
    """Times (T,) [s], places (T,) [m] -> phase of the wave there (T,) [rad, 0 … 2π]."""
    away = north * np.cos(p["direction"])
    away = away + east * np.sin(p["direction"])
    turn = p["omega"] * time - p["omega"] ** 2 / GRAVITY * away + p["phase"]
    return np.asarray(turn % (2.0 * np.pi))


@dataclass(frozen=True)
class _Sea:
    """What is searched: time (T,), place and missing force north and east (T, 2) [s, m, N]."""

    time: Floats
    place: Floats
    force: Floats

    def filtered(self, omega: Floats, direction: Floats) -> Floats:
        """Frequencies (...) and directions (...) -> demodulated force (..., T), complex."""
        unit = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        along, force = unit @ self.place.T, unit @ self.force.T
        turn = omega[..., None] * self.time - (omega**2 / GRAVITY)[..., None] * along
        return np.asarray(force * np.exp(-1j * turn))

    def without(self, train: Values) -> "_Sea":
        """What one train leaves."""
        unit = np.array([np.cos(train["direction"]), np.sin(train["direction"])])
        along = (train["omega"] ** 2 / GRAVITY) * (self.place @ unit)
        push = train["force"] * np.sin(train["omega"] * self.time - along + train["phase"])
        return replace(self, force=self.force - push[:, None] * unit)

    def power(self, omega: Floats, direction: Floats, window: float) -> Floats:
        """Σ over windows of |A|²: (...)."""
        first = np.flatnonzero(np.diff(self.time // window, prepend=-1.0))
        sums = np.add.reduceat(self.filtered(omega, direction), first, axis=-1)
        return np.asarray((np.abs(sums) ** 2).sum(axis=-1))


def strongest_trains(vessel: object, remainder: Callable[[], Remainder]) -> list[Values]:
    """The strongest trains in what a model leaves: force, omega, direction, phase."""
    left = remainder()
    every = max(round(EVERY / float(np.median(np.diff(left.time)))), 1)
    sea, found = _Sea(*(column[::every] for column in left)), []
    for _ in range(TRAINS):
        found.append(_strongest(sea))
        sea = sea.without(found[-1])
    return found


def _strongest(sea: _Sea) -> Values:
    length = float(np.ptp(sea.time))
    window, d_omega, d_theta = WINDOW, OMEGAS, 2.0 * np.pi / DIRECTIONS
    points = _first_look(sea, window, d_omega, d_theta)
    while window < length:
        window, d_omega, d_theta = LONGER * window, d_omega / LONGER, d_theta / LONGER
        points = [_nearby(sea, p, window, d_omega, d_theta) for p in points]
    means = [sea.filtered(np.array([w]), np.array([t])).mean() for w, t in points]
    best = int(np.argmax(np.abs(means)))
    return {
        "force": 2.0 * float(np.abs(means[best])),
        "omega": points[best][0],
        "direction": points[best][1],
        "phase": (float(np.angle(means[best])) + 0.5 * np.pi) % (2.0 * np.pi),
    }


def _first_look(
    sea: _Sea, window: float, d_omega: float, d_theta: float
) -> list[tuple[float, float]]:
    """The best points of the whole grid."""
    fastest = min(FASTEST, 0.7 * np.pi / float(np.median(np.diff(sea.time))))
    omega = np.arange(FINEST, fastest, d_omega)
    theta = d_theta * np.arange(DIRECTIONS)
    found = np.stack([sea.power(omega, np.full(len(omega), t), window) for t in theta])
    best = np.argsort(found, axis=None)[::-1][:FOLLOWED]
    at_theta, at_omega = np.unravel_index(best, found.shape)
    return [(float(omega[j]), float(theta[i])) for i, j in zip(at_theta, at_omega, strict=True)]


def _nearby(
    sea: _Sea, point: tuple[float, float], window: float, d_omega: float, d_theta: float
) -> tuple[float, float]:
    """The best point of a finer grid around one."""
    omega, theta = np.meshgrid(point[0] + d_omega * GRID, point[1] + d_theta * GRID)
    best = np.unravel_index(np.argmax(sea.power(omega, theta, window)), omega.shape)
    return float(omega[best]), float(theta[best])


EFFECT = Effect(
    name="wave_motion",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter("force", "N", lower=0.0, upper=1000.0, start=5.0, scale=1.0, neutral=0.0),
        Parameter("omega", "rad/s", lower=0.2, upper=12.0, start=2.0, scale=0.05),
        Parameter("direction", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.1,
                  kind=Kind.CIRCLE, says="towards, clockwise from north"),
        Parameter("phase", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.2, kind=Kind.CIRCLE,
                  says="at the origin, at the first sample"),
    ),
    looks_like="an oscillation of one frequency and zero mean that is faster against the waves "
    "than with them; like sensor noise, but in a narrow band",
    partial=True,
    evidence=EvidenceAxis(ForceAxis.ALONG, "phase", phase_at),
    search=strongest_trains,
)  # fmt: skip
