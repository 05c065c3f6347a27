"""Groups of forces that a catalogue may lack, and how each would move the boat off a model's runs.

    δν_{k+1} = A_k δν_k + push_k,     A = ∂ν_{k+1}/∂ν_k along the measured track

Forces act as F Δt / m. Water that flows at ν_c acts as the hull's own damping, (I − A) ν_c, and
turns beneath a boat that turns. One group holds the rhythm of a motor that cuts out again and
again:

    A_i(ω) = mean over time of  f |c_i| c_i exp −i ω t

f is what the model lacks on one axis, c_i a motor's command. A push of that motor that comes and
goes shows as a line, whatever the motor is told meanwhile.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit
from sim.identification.runs import RunSet, simulate_runs
from sim.model import Model
from sim.prediction import missing_force_only, vessel_commands
from sim.prediction.segments import transitions
from sim.state import Eta, Floats, Ints
from sim.trial import Trial

PER_TRIAL = frozenset({"place", "flow", "rhythm"})  # terms of one recording: its map, its time
ALWAYS = "always"
GROUPS = {
    "place": "where it is on the map",
    "flow": "where it is on the map, as water that does not flow alike everywhere would",
    "time": "the time",
    "heading": "its heading",
    "speed": "its speed through the water",
    "turn": "how it turns and slips",
    "thrust": "what the motors do",
    "rhythm": "a motor that comes and goes in a rhythm of its own",
    ALWAYS: "nothing that varies: a constant push on board",
}


def error_responses(fit: Fit, runs: RunSet) -> dict[str, Floats]:
    """What each term of each group would do to the errors of one trial's runs: (S, n, 3, K).

    Of tied runs also to the gap at their end, (S, n + 1, 3, K).

    A group whose response is no finite number (a hull that runs away) is left out with zeros.
    """
    trial, model = runs.source.trial, fit.model(runs.source.number)
    tied, n = runs.follows is not None, runs.within.shape[1] * runs.every
    rows = runs.rows.first[:, None] + np.arange(n + tied)
    rows = np.minimum(rows, len(trial) - 1)
    each = np.unique(rows)
    A = transitions(model, trial, each, 1)[:, 3:, 3:][np.searchsorted(each, rows)]
    # past its end a run is padded, and at the end of the trial nothing goes on
    inside = np.arange(rows.shape[1]) < runs.rows.size[:, None]
    A = np.where(inside[..., None, None] & np.isfinite(A), A, 0.0)
    states = _RunStates.of(fit, runs, model, rows)
    masses = model.theta[[model.names.index(m) for m in ("m11", "m22", "m33")]]
    pushes = {on: terms * (trial.dt / masses)[:, None] for on, terms in states.forces().items()}
    pushes["flow"] = states.flows(A)
    out = {}
    for on, terms in pushes.items():
        push = np.where(inside[..., None, None], terms, 0.0)
        moved = np.zeros_like(push)
        for j in range(1, rows.shape[1]):
            moved[:, j] = A[:, j - 1] @ moved[:, j - 1] + push[:, j - 1]
        means = moved[:, :n].reshape(len(rows), -1, runs.every, 3, terms.shape[3]).mean(axis=2)
        response = means * runs.within[..., None, None]
        if runs.follows is not None:
            end = moved[np.arange(len(rows)), np.minimum(runs.rows.size, n)]
            gap = end * runs.follows[:, None, None]
            response = np.concatenate([response, gap[:, None]], axis=1)
        out[on] = response if np.isfinite(response).all() else np.zeros_like(response)
    return out


@dataclass(frozen=True)
class _RunStates:
    """The model's own runs: rows of the trial (S, R), reported eta and nu there (6, S, R).

    Not the measured motion: that has answered to what is missing already, and would seem to
    predict it.
    """

    model: Model
    trial: Trial
    rows: Ints
    motion: Floats

    @classmethod
    def of(cls, fit: Fit, runs: RunSet, model: Model, rows: Ints) -> "_RunStates":
        """Past its end a run is held at its last row."""
        reports = simulate_runs(runs, fit.unknowns, fit.z[None])[0]
        known = np.where(np.isfinite(reports[..., 0]), np.arange(reports.shape[1]), 0)
        last = np.maximum.accumulate(known, axis=1)
        last = last[:, np.minimum(np.arange(rows.shape[1]), reports.shape[1] - 1)]
        held = np.take_along_axis(reports, last[..., None], axis=1)
        return cls(model, runs.source.trial, rows, np.moveaxis(held[..., :6], -1, 0))

    def forces(self) -> Mapping[str, Floats]:
        """Groups of forces (S, R, 3, K) on X, Y, N."""
        _, _, yaw, u, v, r = self.motion
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
        spots = self._spots() * (u * np.abs(u))[..., None]
        surge = np.zeros((*spots.shape[:2], 3, spots.shape[2]))
        surge[..., 0, :] = spots
        drift = _on_each_axis(waves * u[..., None])
        return {
            "place": np.concatenate([_on_board(self._places(), yaw), surge], axis=-1),
            "time": np.concatenate([_on_board(waves, yaw), drift], axis=-1),
            "heading": _on_each_axis(turned),
            "speed": _on_each_axis(speed),
            "turn": _on_each_axis(turn),
            "thrust": _on_each_axis(thrust),
            "rhythm": _on_each_axis(_swinging(rhythms(self.model, self.trial), c, time)),
            ALWAYS: _on_each_axis(np.ones((*self.rows.shape, 1))),
        }

    def flows(self, A: Floats) -> Floats:
        """Steps of the velocity over the ground (S, R, 3, K) by water that flows here and there."""
        _, _, yaw, _, _, r = self.motion
        water = _on_board(self._places(), yaw)
        turned = np.zeros_like(water)
        turned[..., 0, :] = r[..., None] * water[..., 1, :]
        turned[..., 1, :] = -r[..., None] * water[..., 0, :]
        return (np.eye(3) - A) @ water + self.trial.dt * turned

    def _places(self) -> Floats:
        """Smooth functions of the place (S, R, 5), of the size of one."""
        low, high = self._extent()
        n, e = (
            2.0 * (x - a) / max(b - a, 1.0) - 1.0
            for x, a, b in zip(self.motion[:2], low, high, strict=True)
        )
        return np.stack([n, e, n * n, n * e, e * e], axis=-1)

    def _spots(self) -> Floats:
        """Round spots over the places that were visited: (S, R, m), 1 in the middle of each."""
        trial, (low, high) = self.trial, self._extent()
        apart = max(float((high - low).max()) / thresholds.MAP_SPOTS, 1.0)
        cell = np.floor((trial.eta[trial.usable][:, : Eta.YAW] - low) / apart)
        visited, count = np.unique(cell, axis=0, return_counts=True)
        middle = low + (visited[count * trial.dt > thresholds.MIN_SPOT_S] + 0.5) * apart
        away = np.moveaxis(self.motion[:2], 0, -1)[..., None, :] - middle
        return np.asarray(np.exp(-np.sum(away**2, axis=-1) / apart**2))

    def _extent(self) -> tuple[Floats, Floats]:
        """South-west and north-east corner of what was visited."""
        place = self.trial.eta[self.trial.usable][:, : Eta.YAW]
        return place.min(axis=0), place.max(axis=0)


def _swinging(omega: Floats, c: Floats, time: Floats) -> Floats:
    """Each motor's push, swinging at its frequency and at twice that: (S, R, 4m)."""
    push = c[..., : len(omega)] * np.abs(c[..., : len(omega)])
    turn = time[..., None] * omega
    return np.concatenate(
        [push * f(k * turn) for k in (1.0, 2.0) for f in (np.sin, np.cos)], axis=-1
    )


def _bumps(u: Floats) -> Floats:
    """Round bumps over the speeds that were sailed, ahead and astern: (S, R, bumps)."""
    middle = np.linspace(float(u.min()), float(u.max()), thresholds.SPEED_BUMPS)
    width = max(float(middle[1] - middle[0]), 1e-3)
    return np.asarray(np.exp(-(((u[..., None] - middle) / width) ** 2)))


def _on_each_axis(terms: Floats) -> Floats:
    """Terms (..., m) -> (..., 3, 3m): each on each axis by itself."""
    each = np.asarray(np.einsum("...m,ij->...ijm", terms, np.eye(3)))
    return each.reshape(*terms.shape[:-1], 3, -1)


def _on_board(terms: Floats, yaw: Floats) -> Floats:
    """To the north and to the east (..., m) -> what that is on board (..., 3, 2m)."""
    c, s = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    none = np.zeros_like(terms)
    north = np.stack([c * terms, -s * terms, none], axis=-2)
    east = np.stack([s * terms, c * terms, none], axis=-2)
    return np.concatenate([north, east], axis=-1)


def rhythms(model: Model, trial: Trial) -> Floats:
    """The frequency [rad/s] that stands out most in what each motor fails to do: (motors,).

    The lowest of the band where the trial is too short for any line in it.
    """
    missing = missing_force_only(trial, model)[:, (0, 2)]
    missing = np.where(trial.usable[:, None], missing, 0.0)
    missing = missing / np.maximum(missing.std(axis=0), 1e-12)
    c = vessel_commands(model, trial)[:, : len(model.vessel.thrusters)]
    product = missing[:, None, :] * (c * np.abs(c))[..., None]
    size = thresholds.POINTS_PER_LINE * len(trial)
    power = np.sum(np.abs(np.fft.rfft(product, size, axis=0)) ** 2, axis=-1)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, trial.dt)
    lowest, highest = 2.0 * np.pi / thresholds.MAX_PERIOD_S, 2.0 * np.pi / thresholds.MIN_PERIOD_S
    inside = (omega > lowest) & (omega < highest)
    if not inside.any():
        return np.full(c.shape[1], lowest)
    return np.asarray(omega[inside][np.argmax(power[inside], axis=0)])
