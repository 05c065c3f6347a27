"""Groups of pushes that a catalogue may lack, and how each would move the boat off a model's runs.

    δν_{k+1} = A_k δν_k + push_k,     A = ∂ν_{k+1}/∂ν_k along the measured track

Forces act as F Δt / m. Water that flows at ν_c acts as the hull's own damping, (I − A) ν_c, and
turns beneath a boat that turns.

The rhythm in which motors fail, if they do: a motor that cuts out again and again, say.

    A_i(ω) = mean over time of  f |c_i| c_i exp −i ω t

f is what the model lacks on one axis, c_i a motor's command. A push of that motor that comes and
goes shows as a line, whatever the motor is told meanwhile.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis.fit import Fit
from sim.identification.runs import RunSet, simulate_runs
from sim.model import Model
from sim.prediction.inputs import vessel_commands
from sim.prediction.missing_force import missing_force_only
from sim.prediction.transition import transitions
from sim.state import Eta, Floats, Ints
from sim.trial import Trial

SPOTS = 7  # along the longer side of the map
BUMPS = 7  # over the speeds
STAYED_S = 5.0  # in a spot, for it to count
OWN = frozenset({"place", "flow", "rhythm"})  # terms of one recording: its map, its time
SAYS = {
    "place": "where it is on the map",
    "flow": "where it is on the map, as water that does not flow alike everywhere would",
    "time": "the time",
    "heading": "its heading",
    "speed": "its speed through the water",
    "turn": "how it turns and slips",
    "thrust": "what the motors do",
    "rhythm": "a motor that comes and goes in a rhythm of its own",
    "always": "nothing that varies: a constant push on board",
}


def moved_by(fit: Fit, window: RunSet) -> dict[str, Floats]:
    """What each term of each group would do to the errors of one trial's runs: (S, n, 3, K)."""
    number, trial = window.source.number, window.source.trial
    theta = fit.unknowns.theta(fit.z[None], number)[0]
    model = replace(fit.unknowns.model, theta=theta)
    rows = window.rows.first[:, None] + np.arange(window.within.shape[1] * window.every)
    rows = np.minimum(rows, len(trial) - 1)
    each = np.unique(rows)
    A = transitions(model, trial, each, 1)[:, 3:, 3:][np.searchsorted(each, rows)]
    # past its end a run is padded, and at the end of the trial nothing goes on
    inside = np.arange(rows.shape[1]) < window.rows.size[:, None]
    A = np.where(inside[..., None, None] & np.isfinite(A), A, 0.0)
    scene = _Scene.of(fit, window, model, rows)
    masses = np.array([theta[model.names.index(m)] for m in ("m11", "m22", "m33")])
    pushes = {on: terms * (trial.dt / masses)[:, None] for on, terms in scene.forces().items()}
    pushes["flow"] = scene.flows(A)
    out = {}
    for on, terms in pushes.items():
        push = np.where(inside[..., None, None], terms, 0.0)
        moved = np.zeros_like(push)
        for j in range(1, rows.shape[1]):
            moved[:, j] = A[:, j - 1] @ moved[:, j - 1] + push[:, j - 1]
        means = moved.reshape(len(rows), -1, window.every, 3, terms.shape[3]).mean(axis=2)
        out[on] = means * window.within[..., None, None]
    return out


@dataclass(frozen=True)
class _Scene:
    """The model's own runs (S, R), and where on the map and in time they are.

    Not the measured motion: that has answered to what is missing already, and would seem to
    foretell it.
    """

    model: Model
    trial: Trial
    rows: Ints
    said: Floats

    @classmethod
    def of(cls, fit: Fit, window: RunSet, model: Model, rows: Ints) -> "_Scene":
        said = _held(simulate_runs(window, fit.unknowns, fit.z[None])[0])[:, : rows.shape[1]]
        return cls(model, window.source.trial, rows, np.moveaxis(said[..., :6], -1, 0))

    def forces(self) -> Mapping[str, Floats]:
        """Groups of forces (S, R, 3, K) on X, Y, N."""
        _, _, yaw, u, v, r = self.said
        time = self.trial.time[self.rows]
        t = np.pi * time / max(float(self.trial.time[-1]), 1.0)
        motors = max(len(self.model.vessel.thrusters), 1)
        c = vessel_commands(self.model, self.trial)[:, :motors][self.rows]
        stack = np.stack
        waves = stack([f(k * t) for k in (1, 2, 3, 4) for f in (np.sin, np.cos)], axis=-1)
        turned = stack([np.cos(yaw), np.sin(yaw), np.cos(2 * yaw), np.sin(2 * yaw)], axis=-1)
        speed = np.concatenate([stack([u, u * np.abs(u), u**3], axis=-1), _bumps(u)], axis=-1)
        turn = stack([v, r, v * np.abs(v), r * np.abs(r), u * v, u * r, v * r], axis=-1)
        thrust = np.concatenate([c, np.abs(c), c * np.abs(c), c * u[..., None]], axis=-1)
        spots = self.spots() * (u * np.abs(u))[..., None]
        surge = np.zeros((*spots.shape[:2], 3, spots.shape[2]))
        surge[..., 0, :] = spots
        return {
            "place": np.concatenate([_world(self.places(), yaw), surge], axis=-1),
            "time": np.concatenate([_world(waves, yaw), _alike(waves * u[..., None])], axis=-1),
            "heading": _alike(turned),
            "speed": _alike(speed),
            "turn": _alike(turn),
            "thrust": _alike(thrust),
            "rhythm": _alike(_beats(rhythms(self.model, self.trial), c, time)),
            "always": _alike(np.ones((*self.rows.shape, 1))),
        }

    def flows(self, A: Floats) -> Floats:
        """Steps of the velocity over the ground (S, R, 3, K) by water that flows here and there."""
        _, _, yaw, _, _, r = self.said
        water = _world(self.places(), yaw)
        turned = np.zeros_like(water)
        turned[..., 0, :] = r[..., None] * water[..., 1, :]
        turned[..., 1, :] = -r[..., None] * water[..., 0, :]
        return (np.eye(3) - A) @ water + self.trial.dt * turned

    def places(self) -> Floats:
        """Smooth functions of the place (S, R, 5), of the size of one."""
        low, high = self._extent()
        n, e = (
            2.0 * (x - a) / max(b - a, 1.0) - 1.0
            for x, a, b in zip(self.said[:2], low, high, strict=True)
        )
        return np.stack([n, e, n * n, n * e, e * e], axis=-1)

    def spots(self) -> Floats:
        """Round spots over the places that were visited: (S, R, m), 1 in the middle of each."""
        trial, (low, high) = self.trial, self._extent()
        apart = max(float((high - low).max()) / SPOTS, 1.0)
        cell = np.floor((trial.eta[trial.usable][:, : Eta.YAW] - low) / apart)
        visited, count = np.unique(cell, axis=0, return_counts=True)
        middle = low + (visited[count * trial.dt > STAYED_S] + 0.5) * apart
        away = np.moveaxis(self.said[:2], 0, -1)[..., None, :] - middle
        return np.asarray(np.exp(-np.sum(away**2, axis=-1) / apart**2))

    def _extent(self) -> tuple[Floats, Floats]:
        """South-west and north-east corner of what was visited."""
        place = self.trial.eta[self.trial.usable][:, : Eta.YAW]
        return place.min(axis=0), place.max(axis=0)


def _beats(omega: Floats, c: Floats, time: Floats) -> Floats:
    """Each motor's push, swinging at its frequency and at twice that: (S, R, 4m)."""
    push = c[..., : len(omega)] * np.abs(c[..., : len(omega)])
    turn = time[..., None] * omega
    return np.concatenate(
        [push * f(k * turn) for k in (1.0, 2.0) for f in (np.sin, np.cos)], axis=-1
    )


def _bumps(u: Floats) -> Floats:
    """Round bumps over the speeds that were sailed, ahead and astern: (S, R, BUMPS)."""
    middle = np.linspace(float(u.min()), float(u.max()), BUMPS)
    width = max(float(middle[1] - middle[0]), 1e-3)
    return np.asarray(np.exp(-(((u[..., None] - middle) / width) ** 2)))


def _held(said: Floats) -> Floats:
    """Reports (S, R, 9) with the last row of each run held past its end."""
    there = np.where(np.isfinite(said[..., 0]), np.arange(said.shape[1]), 0)
    last = np.maximum.accumulate(there, axis=1)
    return np.take_along_axis(said, last[..., None], axis=1)


def _alike(terms: Floats) -> Floats:
    """Terms (..., m) -> (..., 3, 3m): each on each axis by itself."""
    return np.asarray(np.einsum("...m,ij->...ijm", terms, np.eye(3))).reshape(
        *terms.shape[:-1], 3, -1
    )


def _world(terms: Floats, yaw: Floats) -> Floats:
    """To the north and to the east (..., m) -> what that is on board (..., 3, 2m)."""
    c, s = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    none = np.zeros_like(terms)
    north = np.stack([c * terms, -s * terms, none], axis=-2)
    east = np.stack([s * terms, c * terms, none], axis=-2)
    return np.concatenate([north, east], axis=-1)


SLOWEST, FASTEST = 60.0, 2.0  # s, periods that are looked for
FINER = 4  # points per line of the spectrum


def rhythms(model: Model, trial: Trial) -> Floats:
    """The frequency [rad/s] that stands out most in what each motor fails to do: (motors,)."""
    left = missing_force_only(trial, model)[:, (0, 2)]
    left = np.where(trial.usable[:, None], left, 0.0)
    left = left / np.maximum(left.std(axis=0), 1e-12)
    c = vessel_commands(model, trial)[:, : len(model.vessel.thrusters)]
    told = left[:, None, :] * (c * np.abs(c))[..., None]
    size = FINER * len(trial)
    power = np.sum(np.abs(np.fft.rfft(told, size, axis=0)) ** 2, axis=-1)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, trial.dt)
    inside = (omega > 2.0 * np.pi / SLOWEST) & (omega < 2.0 * np.pi / FASTEST)
    return np.asarray(omega[inside][np.argmax(power[inside], axis=0)])
