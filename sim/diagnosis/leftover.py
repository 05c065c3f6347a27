"""What the best model still leaves, and what it hangs on: place, time, heading, thrust …

    δν̇ = A(t) δν + M⁻¹ Σ c_k φ_k(t),     A = ∂ν̇/∂ν along the measured track

A force φ_k(t) that the model does not know would move the boat by δν. Groups of physical terms are
regressed on what the fit leaves, together with its own numbers, on blocks of time that the
regression did not see. A group that foretells them names what the catalogue does not hold. In the
runs, and not in the missing force itself: that holds the noise of the very velocities that the
terms are made of, and always seems to depend on them. Sparse regression on physical terms: Brunton,
Proctor and Kutz, PNAS 113, 2016; by groups, because terms of one group stand in for each other.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from sim.diagnosis.fit import Fit
from sim.diagnosis.heldout import CLIP, Gain, gain, unseen
from sim.diagnosis.inputs import commands_of
from sim.diagnosis.segments import Ints
from sim.diagnosis.transition import transitions
from sim.identification.shooting import Window, projected, run
from sim.model import Model
from sim.state import Eta, Floats
from sim.trial import Trial

RIDGE = 3.0  # in whitened rows: how much a term must say before it is listened to
SPOTS = 7  # along the longer side of the map
STAYED_S = 5.0  # in a spot, for it to count
AXES = ("surge", "sway", "yaw")
SAYS = {
    "place": "where it is on the map",
    "time": "the time",
    "heading": "its heading",
    "speed": "its speed through the water",
    "turn": "how it turns and slips",
    "thrust": "what the motors do",
    "always": "nothing that varies: a constant push on board",
}


@dataclass(frozen=True)
class Dependence:
    """One group of terms, what it is worth on unseen time, and the axes that it acts on."""

    on: str
    gain: Gain
    axes: tuple[str, ...]

    @property
    def share(self) -> float:
        """Of the squared errors of the best model, on unseen time, that the group foretells."""
        return 1.0 - 1.0 / self.gain.ratio

    @property
    def says(self) -> str:
        """In words."""
        return f"what is missing in {' and '.join(self.axes)} depends on {SAYS[self.on]}"


def dependences(fit: Fit) -> list[Dependence]:
    """Every group and what it foretells, the strongest first."""
    before = unseen(fit)
    columns = [_columns(fit, w) for w in fit.ground.seen_by(fit.unknowns, fit.z)]
    found = []
    for group in columns[0]:
        each = [c[group] for c in columns]  # places are of one recording: spots of its own map
        J = block_diag(*each) if group == "place" else np.concatenate(each)
        after, axes = _foretold(fit, J, before)
        found.append(Dependence(group, gain(before, after, fit.ground.block), axes))
    return sorted(found, key=lambda d: -d.gain.nats)


def _columns(fit: Fit, window: Window) -> dict[str, Floats]:
    """What each term of each group would do to the residuals of one trial: (N, K), unit columns."""
    number, trial = window.voyage.number, window.voyage.trial
    theta = fit.unknowns.theta(fit.z[None], number)[0]
    model = replace(fit.unknowns.model, theta=theta)
    rows = window.tiles.first[:, None] + np.arange(window.within.shape[1] * window.every)
    rows = np.minimum(rows, len(trial) - 1)
    A = transitions(model, trial, np.unique(rows), 1)[:, 3:, 3:]
    A = A[np.searchsorted(np.unique(rows), rows)]
    # past its end a run is padded, and at the end of the trial nothing goes on
    inside = np.arange(rows.shape[1]) < window.tiles.size[:, None]
    A = np.where(inside[..., None, None] & np.isfinite(A), A, 0.0)
    masses = np.array([theta[model.names.index(m)] for m in ("m11", "m22", "m33")])
    out = {}
    for group, terms in _terms(fit, window, model, rows).items():
        push = np.where(inside[..., None, None], terms, 0.0) * (trial.dt / masses)[:, None]
        moved = np.zeros_like(push)
        for j in range(1, rows.shape[1]):
            moved[:, j] = A[:, j - 1] @ moved[:, j - 1] + push[:, j - 1]
        means = moved.reshape(len(rows), -1, window.every, 3, terms.shape[3]).mean(axis=2)
        means *= window.within[..., None, None]
        J = np.stack([projected(window, m[None])[0] for m in np.moveaxis(means, -1, 0)], axis=1)
        out[group] = J / np.maximum(np.sqrt(np.mean(J**2, axis=0)), 1e-12)
    return out


def _terms(fit: Fit, window: Window, model: Model, rows: Ints) -> dict[str, Floats]:
    """Groups of forces (S, R, 3, K) on X, Y, N along the model's own runs (S, R).

    Not along the measured motion: that has answered to what is missing already, and would seem to
    foretell it.
    """
    trial = window.voyage.trial
    said = _held(run(window, fit.unknowns, fit.z[None])[0])[:, : rows.shape[1]]
    north, east, yaw, u, v, r = np.moveaxis(said[..., :6], -1, 0)
    low, high = _extent(trial)
    n, e = (
        2.0 * (x - a) / max(b - a, 1.0) - 1.0
        for x, a, b in zip((north, east), low, high, strict=True)
    )
    t = np.pi * trial.time[rows] / max(float(trial.time[-1]), 1.0)
    c = commands_of(model, trial)[:, : max(len(model.vessel.thrusters), 1)][rows]
    stack = np.stack
    place = stack([n, e, n * n, n * e, e * e], axis=-1)
    spots = _spots(trial, north, east) * (u * np.abs(u))[..., None]
    waves = stack([f(k * t) for k in (1, 2, 3, 4) for f in (np.sin, np.cos)], axis=-1)
    turned = stack([np.cos(yaw), np.sin(yaw), np.cos(2 * yaw), np.sin(2 * yaw)], axis=-1)
    speed = stack([u, u * np.abs(u), u**3, np.abs(u)], axis=-1)
    turn = stack([v, r, v * np.abs(v), r * np.abs(r), u * v, u * r, v * r], axis=-1)
    thrust = np.concatenate([c, np.abs(c), c * np.abs(c), c * u[..., None]], axis=-1)
    surge = np.zeros((*spots.shape[:2], 3, spots.shape[2]))
    surge[..., 0, :] = spots
    return {
        "place": np.concatenate([_world(place, yaw), surge], axis=-1),
        "time": np.concatenate([_world(waves, yaw), _alike(waves * u[..., None])], axis=-1),
        "heading": _alike(turned),
        "speed": _alike(speed),
        "turn": _alike(turn),
        "thrust": _alike(thrust),
        "always": _alike(np.ones((*rows.shape, 1))),
    }


def _held(said: Floats) -> Floats:
    """Reports (S, R, 9) with the last row of each run held past its end."""
    there = np.where(np.isfinite(said[..., 0]), np.arange(said.shape[1]), 0)
    last = np.maximum.accumulate(there, axis=1)
    return np.take_along_axis(said, last[..., None], axis=1)


def _extent(trial: Trial) -> tuple[Floats, Floats]:
    """South-west and north-east corner of what was visited."""
    place = trial.eta[trial.usable][:, : Eta.YAW]
    return place.min(axis=0), place.max(axis=0)


def _spots(trial: Trial, north: Floats, east: Floats) -> Floats:
    """Round spots over the places that were visited: (S, R, m), 1 in the middle of each."""
    low, high = _extent(trial)
    apart = max(float((high - low).max()) / SPOTS, 1.0)
    cell = np.floor((trial.eta[trial.usable][:, : Eta.YAW] - low) / apart)
    visited, count = np.unique(cell, axis=0, return_counts=True)
    middle = low + (visited[count * trial.dt > STAYED_S] + 0.5) * apart
    away = np.stack([north, east], axis=-1)[..., None, :] - middle
    return np.asarray(np.exp(-np.sum(away**2, axis=-1) / apart**2))


def _alike(terms: Floats) -> Floats:
    """Terms (..., m) -> (..., 3, 3m): each on each axis by itself."""
    return np.asarray(np.einsum("...m,ij->...ijm", terms, np.eye(3))).reshape(
        *terms.shape[:-1], 3, -1
    )


def _world(terms: Floats, yaw: Floats) -> Floats:
    """Forces to the north and to the east (..., m) -> what they are on board (..., 3, 2m)."""
    c, s = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    none = np.zeros_like(terms)
    north = np.stack([c * terms, -s * terms, none], axis=-2)
    east = np.stack([s * terms, c * terms, none], axis=-2)
    return np.concatenate([north, east], axis=-1)


def _foretold(fit: Fit, J: Floats, before: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Terms (N, K) beside the fit's own numbers -> unseen residuals (N,), and the axes helped."""
    P = np.diag(np.array([u.prior for u in fit.unknowns.each]) ** -2.0)
    pull = P @ (fit.z - fit.unknowns.start)
    n, K = len(fit.z), J.shape[1]
    both = np.hstack([fit.slope, J])
    prior = np.zeros((n + K, n + K))
    prior[:n, :n], prior[n:, n:] = P, RIDGE * np.eye(K)
    out = fit.residual.copy()
    for seen, judge in fit.ground.folds():
        A, w = both[seen], fit.weight[seen]
        H = A.T @ (w[:, None] * A) + prior
        s = A.T @ (w * fit.residual[seen]) + np.append(pull, np.zeros(K))
        out[judge] = fit.residual[judge] - both[judge] @ np.linalg.lstsq(H, s, rcond=1e-12)[0]
    was, left = (np.clip(r.reshape(-1, 3), -CLIP, CLIP) for r in (before, out))
    won = np.sum(was**2 - left**2, axis=0)
    helped = won > 0.2 * max(float(won.max()), 1e-9)
    return out, tuple(AXES[i] for i in range(3) if helped[i])
