"""Trains of long-crested waves: the law that the effects of waves share, and how one is looked for.

    F = force sin(omega t − k s + phase)
    k = omega² / g,   s = N cos direction + E sin direction

F acts along direction [rad from north, towards]; force [N] at the crests, omega [rad/s], t [s after
the first sample], N and E [m] position, phase [rad], g = 9.81 m/s². Sailing with or against the
waves moves the frequency of encounter. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd
ed. 2021, §10.2 (dispersion and frequency of encounter).

A search starts at the peaks of matched filters over frequency and direction:

    A_w(ω, θ) = mean over window w of f_θ exp −i (ω t − ω² s_θ / g)

f_θ is the missing force along direction θ, s_θ the place along it. A boat that has moved by s meets
waves ω² s / g later: over a whole voyage that is many turns of phase, so direction and frequency
must be right more closely than the steps of a fit can correct. Over short windows the peak is
broad: the whole grid is searched for Σ_w |A_w|², and the best points are refined over windows three
times as long, in steps a third as wide, up to the whole voyage.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numba
import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    EvidenceAxis,
    ForceAxis,
    Parameter,
    ResidualForce,
    Values,
    circular_parameter,
)
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Floats, Wrench, to_body

GRAVITY = 9.81  # m/s²
# the search; chosen by hand, not measured
MIN_OMEGA = 0.8  # rad/s where waves begin; slower ones are currents and gusts
MAX_OMEGA = 6.0  # rad/s
SAMPLE_S = 0.4  # between the samples that are used
FIRST_WINDOW_S = 50.0
REFINEMENT = 3  # times longer windows and finer steps, from one pass to the next
OMEGA_STEP = 0.04  # rad/s of the first grid
DIRECTIONS = 96  # of the first grid
CANDIDATES = 8  # the best points of the first grid are followed
TRAINS = 2  # the second in what the first leaves: side lobes of a strong one are no train
OFFSETS = np.arange(-3.0, 4.0)  # steps to either side of a point that is refined


@jitable
def train_force(flow: Flow, p: Any) -> Wrench:
    """Place, heading and time -> X, Y, N [N, N, N m] of one train."""
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
class _Samples:
    """Time (T,), place and missing force north and east (T, 2) [s, m, N]."""

    time: Floats
    place: Floats
    force: Floats

    def filtered(self, omega: Floats, direction: Floats) -> Floats:
        """Frequencies (...) and directions (...) -> demodulated force (..., T), complex."""
        unit = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        along, force = unit @ self.place.T, unit @ self.force.T
        turn = omega[..., None] * self.time - (omega**2 / GRAVITY)[..., None] * along
        return np.asarray(force * np.exp(-1j * turn))

    def without(self, train: Values) -> "_Samples":
        """The samples less the force of one train."""
        unit = np.array([np.cos(train["direction"]), np.sin(train["direction"])])
        along = (train["omega"] ** 2 / GRAVITY) * (self.place @ unit)
        push = train["force"] * np.sin(train["omega"] * self.time - along + train["phase"])
        return replace(self, force=self.force - push[:, None] * unit)

    def power(self, omega: Floats, direction: Floats, window: float) -> Floats:
        """Σ over windows of |A|² at frequencies (M,), evenly apart, and directions (D,): (D, M)."""
        number, out = (self.time // window).astype(np.int64), np.empty((len(direction), len(omega)))
        _powers(self.time, self.place, self.force, number, omega, direction, out)
        return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _powers(time, place, force, window, omega, direction, out):  # type: ignore[no-untyped-def]
    """Samples (T,), (T, 2), (T, 2) in windows by number (T,) -> Σ |A|² on a grid, in `out` (D, M).

    The phase is of second order in ω: from one frequency to the next e^{−i phase} is turned on by a
    step that is itself turned on by one number.
    """
    d, size = omega[1] - omega[0] if len(omega) > 1 else 0.0, len(time)
    wave, step, bend = np.empty((size, 2)), np.empty((size, 2)), np.empty((size, 2))
    for n in range(len(direction)):
        c, s, w = np.cos(direction[n]), np.sin(direction[n]), omega[0]
        for t in range(size):
            along = (c * place[t, 0] + s * place[t, 1]) / GRAVITY
            push = c * force[t, 0] + s * force[t, 1]
            turn, first = w * time[t] - w * w * along, d * time[t] - (2.0 * w + d) * d * along
            second = -2.0 * d * d * along
            wave[t, 0], wave[t, 1] = push * np.cos(turn), -push * np.sin(turn)
            step[t, 0], step[t, 1] = np.cos(first), -np.sin(first)
            bend[t, 0], bend[t, 1] = np.cos(second), -np.sin(second)
        for m in range(len(omega)):
            total, real, imaginary = 0.0, 0.0, 0.0
            for t in range(size):
                a, b, p, q = wave[t, 0], wave[t, 1], step[t, 0], step[t, 1]
                real += a
                imaginary += b
                wave[t, 0], wave[t, 1] = a * p - b * q, a * q + b * p
                step[t, 0] = p * bend[t, 0] - q * bend[t, 1]
                step[t, 1] = p * bend[t, 1] + q * bend[t, 0]
                if t + 1 == size or window[t + 1] != window[t]:
                    total += real * real + imaginary * imaginary
                    real = imaginary = 0.0
            out[n, m] = total


def strongest_trains(vessel: object, residual: Callable[[], ResidualForce]) -> list[Values]:
    """The strongest trains in what a model leaves: force, omega, direction, phase."""
    rows = residual()
    every = max(round(SAMPLE_S / float(np.median(np.diff(rows.time)))), 1)
    samples = _Samples(*(column[::every] for column in (rows.time, rows.place, rows.force)))
    trains: list[Values] = []
    for _ in range(TRAINS):
        trains.append(_strongest(samples))
        samples = samples.without(trains[-1])
    return trains


def _strongest(samples: _Samples) -> Values:
    length = float(np.ptp(samples.time))
    window, d_omega, d_theta = FIRST_WINDOW_S, OMEGA_STEP, 2.0 * np.pi / DIRECTIONS
    points = _coarse_peaks(samples, window, d_omega, d_theta)
    while window < length:
        window, d_omega, d_theta = REFINEMENT * window, d_omega / REFINEMENT, d_theta / REFINEMENT
        points = [_refined(samples, p, window, d_omega, d_theta) for p in points]
    means = [samples.filtered(np.array([w]), np.array([t])).mean() for w, t in points]
    best = int(np.argmax(np.abs(means)))
    return {
        "force": 2.0 * float(np.abs(means[best])),
        "omega": points[best][0],
        "direction": points[best][1],
        "phase": (float(np.angle(means[best])) + 0.5 * np.pi) % (2.0 * np.pi),
    }


def _coarse_peaks(
    samples: _Samples, window: float, d_omega: float, d_theta: float
) -> list[tuple[float, float]]:
    """The best points of the whole grid: omega [rad/s], direction [rad]."""
    highest = min(MAX_OMEGA, 0.7 * np.pi / float(np.median(np.diff(samples.time))))
    omega = np.arange(MIN_OMEGA, highest, d_omega)
    theta = np.asarray(d_theta * np.arange(DIRECTIONS), np.float64)
    power = samples.power(omega, theta, window)
    best = np.argsort(power, axis=None)[::-1][:CANDIDATES]
    at_theta, at_omega = np.unravel_index(best, power.shape)
    return [(float(omega[j]), float(theta[i])) for i, j in zip(at_theta, at_omega, strict=True)]


def _refined(
    samples: _Samples, point: tuple[float, float], window: float, d_omega: float, d_theta: float
) -> tuple[float, float]:
    """The best point of a finer grid around one."""
    omega = np.asarray(point[0] + d_omega * OFFSETS, np.float64)
    theta = np.asarray(point[1] + d_theta * OFFSETS, np.float64)
    at_theta, at_omega = divmod(int(np.argmax(samples.power(omega, theta, window))), len(omega))
    return float(omega[at_omega]), float(theta[at_theta])


def words_of_train(p: FittedValues) -> str:
    """One train, in a sentence."""
    period = 2.0 * pi / p["omega"]
    return (f"waves of a period of {period:.1f} s push with {p.size('force', 'N')} towards "
            f"{p.towards('direction')}")  # fmt: skip


TRAIN_PARAMETERS = (
    Parameter("force", "N", lower=0.0, upper=1000.0, start=5.0, scale=1.0, neutral=0.0),
    Parameter("omega", "rad/s", lower=0.2, upper=12.0, start=2.0, scale=0.05),
    circular_parameter("direction", "towards, clockwise from north", sided=True),
    circular_parameter("phase", "at the origin, at the first sample", scale=0.2),
)
PASSING = EvidenceAxis(ForceAxis.ALONG, "phase", phase_at)
