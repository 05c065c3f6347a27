"""Peers on the same data: sparse regression (PySINDy), and plain regression with BIC.

    python -m benchmarks.hidden --by benchmarks.hidden.peers:sindy --no-judge
    python -m benchmarks.hidden --by benchmarks.hidden.peers:bic --no-judge

Both look at the missing force of the smoothed motion, as a regression on what each effect of the
catalogue would add to it for a small change of each of its parameters: the same physical terms.
The base stays as the file says: where no thruster pushes sideways all sway terms of the base
together equal the missing force, whatever is hidden, and a regression finds just that. Effects
without a small change (a swapped plug, the moment of a fault, a train of waves) are tried at a
grid of their values.

    sindy  sequentially thresholded least squares (STLSQ: Brunton, Proctor and Kutz, PNAS 2016); the
           effect whose terms carry most of the force is named
    bic    forward selection while BIC falls (Schwarz 1978), each sample taken as independent
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Kind, Parameter
from sim.model import Model
from sim.prediction import missing_force
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel

SMALL = 0.2  # of a parameter's scale: a small change
MOMENTS = 12  # of a fault, tried along the voyage
OMEGAS, PERIODS = (1.2, 1.5, 1.8, 2.2, 2.7), (0.25, 0.4, 0.7)  # rad/s; shares of the voyage
RIDGE = 0.03  # of the number of samples
THRESHOLD = 0.1  # of the force's root mean square that a term must carry to stay
MOST = 3  # effects named


@dataclass(frozen=True)
class Terms:
    """What each effect could add to the force: names of effects, columns (N, k) each, target (N,).

    All in standard deviations of the force on each axis.
    """

    names: tuple[str, ...]
    columns: tuple[Floats, ...]
    target: Floats


class Said:
    """A diagnosis as a peer can give one."""

    def __init__(self, effects: Sequence[str], scores: dict[str, float]) -> None:
        self._effects, self._scores = list(effects), scores

    def to_dict(self) -> dict[str, Any]:
        """As `shadow diagnose --json`, without parameters."""
        return {
            "verdict": "explained" if self._effects else "adequate", "base_changed": False,
            "effects": self._effects, "ladder": [],
            "ranking": [
                {"effect": name, "probability": p, "confounded_with": []}
                for name, p in sorted(self._scores.items(), key=lambda item: -item[1])
            ],
        }  # fmt: skip


def bic(logs: Sequence[str | Path], vessel: str | Path, *, improve: bool = True) -> Said:
    """Plain regression: the effect that lowers BIC most, until none does."""
    terms = terms_of(load_trials(logs[0])[0], load_vessel(vessel))
    chosen: list[int] = []
    first: dict[str, float] = {}
    best = _bic(terms, chosen)
    while len(chosen) < MOST:
        tried = {
            i: _bic(terms, [*chosen, i])
            for i in range(len(terms.names))
            if terms.names[i] not in {terms.names[c] for c in chosen}
        }
        if not chosen:
            first = _weights(terms.names, tried)
        i = min(tried, key=lambda i: tried[i])
        if tried[i] >= best:
            break
        chosen, best = [*chosen, i], tried[i]
    return Said([terms.names[i] for i in chosen], first)


def sindy(logs: Sequence[str | Path], vessel: str | Path, *, improve: bool = True) -> Said:
    """Sparse regression: the effects whose terms survive the threshold, largest first."""
    from pysindy.optimizers import STLSQ

    terms = terms_of(load_trials(logs[0])[0], load_vessel(vessel))
    terms = _best_of_each(terms)  # many near copies of one term share its coefficient out
    library, target = np.hstack(terms.columns), terms.target
    size = np.sqrt(np.mean(library**2, axis=0)) + 1e-12
    scale = float(np.sqrt(np.mean(target**2)))
    found = STLSQ(threshold=THRESHOLD, alpha=RIDGE * len(target), max_iter=20)
    found.fit(library / size, target[:, None] / scale)
    carries = np.split(np.abs(found.coef_[0]), np.cumsum([c.shape[1] for c in terms.columns])[:-1])
    scores: dict[str, float] = {}
    for name, part in zip(terms.names, carries, strict=True):
        scores[name] = max(scores.get(name, 0.0), float(np.hypot.reduce(part)))
    alive = sorted((n for n, s in scores.items() if s > 0.0), key=lambda n: -scores[n])
    total = sum(scores.values()) or 1.0
    return Said(alive[:MOST], {name: s / total for name, s in scores.items()})


def _best_of_each(terms: Terms) -> Terms:
    """Each effect with the one of its sets that leaves least alone."""
    best: dict[str, tuple[float, int]] = {}
    for i, name in enumerate(terms.names):
        best[name] = min(best.get(name, (math.inf, i)), (_bic(terms, [i]), i))
    kept = [i for _, i in best.values()]
    columns = tuple(terms.columns[i] for i in kept)
    return Terms(tuple(terms.names[i] for i in kept), columns, terms.target)


def terms_of(trial: Trial, vessel: Vessel) -> Terms:
    """All columns, on the usable rows, weighted by the size of the force on each axis."""
    force = _force(trial, vessel)
    names, columns = [], []
    for effect in EFFECTS:
        if vessel.unmet_needs(effect):
            continue
        for column in _columns(trial, vessel, effect, force):
            names.append(effect.name)
            columns.append(column)
    rows = trial.usable
    weight = 1.0 / np.maximum(force[rows].std(axis=0), 1e-9)

    def stacked(x: Floats) -> Floats:
        weighted = x[rows] * (weight[:, None] if x.ndim == 3 else weight)
        return weighted.reshape(-1, *x.shape[2:])

    return Terms(tuple(names), tuple(map(stacked, columns)), stacked(force))


def _force(trial: Trial, vessel: Vessel) -> Floats:
    return missing_force(trial, Model.of(vessel)).force


def _columns(trial: Trial, vessel: Vessel, effect: Effect, force: Floats) -> Iterator[Floats]:
    """Sets of columns (T, 3, k): one for each choice of what cannot be made small."""
    for fixed in _grid(trial, vessel, effect):
        moves = list(_moves(effect, fixed))
        still = {p.name: _neutral(p) for p in effect.parameters} | fixed
        parts = [_added(trial, vessel, effect, still | move, force) for move in moves]
        column = np.stack(parts, axis=-1)
        if np.isfinite(column).all() and np.abs(column).max() > 1e-9:
            yield column


def _added(
    trial: Trial, vessel: Vessel, effect: Effect, values: dict[str, float], force: Floats
) -> Floats:
    """What the effect would take from the missing force: (T, 3)."""
    return force - _force(trial, vessel.with_effects(AddedEffect(effect, values)))


def _grid(trial: Trial, vessel: Vessel, effect: Effect) -> Iterator[dict[str, float]]:
    """Values of what has no small change."""
    long = float(trial.time[-1])
    tried: dict[str, Sequence[float]] = {}
    for p in effect.parameters:
        if p.kind is Kind.MOMENT:
            tried[p.name] = np.linspace(0.1, 0.9, MOMENTS) * long
        elif p.name == "thruster":
            tried[p.name] = [1.0 + i for i in range(len(vessel.thrusters))]
        elif p.name == "order":
            tried[p.name] = [
                float("".join(str(1 + i) for i in reversed(range(len(vessel.actuators)))))
            ]
        elif p.name == "omega":
            tried[p.name] = OMEGAS
        elif p.name == "period":
            tried[p.name] = [share * long for share in PERIODS]
        elif p.name == "x" and effect.name == "towed_load":
            tried[p.name] = [-vessel.hull.length, 0.0]
        elif p.name == "above":
            tried[p.name] = [0.1]
    for values in product(*tried.values()):
        yield dict(zip(tried, map(float, values), strict=True))


def _moves(effect: Effect, fixed: dict[str, float]) -> Iterator[dict[str, float]]:
    """Small changes: one for each parameter, or for each way that a magnitude can point."""
    numbers = [p for p in effect.parameters if p.kind is Kind.NUMBER and p.name not in fixed]
    circles = [p.name for p in effect.parameters if p.kind is Kind.CIRCLE]
    if circles:
        for at in product((0.0, 0.5 * math.pi), repeat=len(circles)):
            yield {numbers[0].name: _moved(numbers[0]), **dict(zip(circles, at, strict=True))}
    elif numbers:
        for p in numbers:
            yield {p.name: _moved(p)}
    else:
        yield {}


def _neutral(p: Parameter) -> float:
    return p.start if p.neutral is None else p.neutral


def _moved(p: Parameter) -> float:
    """A little away from doing nothing, to the side that is allowed."""
    step = SMALL * p.scale
    at = _neutral(p)
    return at + step if at + step <= p.upper else at - step


def _bic(terms: Terms, chosen: Sequence[int]) -> float:
    left, n, k = terms.target, len(terms.target), 0
    if chosen:
        columns = np.hstack([terms.columns[i] for i in chosen])
        columns, k = columns / np.abs(columns).max(axis=0), columns.shape[1]
        left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    return n * math.log(float(left @ left) / n) + k * math.log(n)


def _weights(names: Sequence[str], tried: dict[int, float]) -> dict[str, float]:
    """Akaike's weights, by effect: what BIC would call probabilities."""
    least = min(tried.values())
    weights = {i: math.exp(-0.5 * min(b - least, 1400.0)) for i, b in tried.items()}
    total = sum(weights.values())
    out: dict[str, float] = {}
    for i, w in weights.items():
        out[names[i]] = out.get(names[i], 0.0) + w / total
    return out
