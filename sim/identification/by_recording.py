"""One boat over many recordings: each is fitted alone, then what they say is put together.

    z_k = A_k β + δ_k + e_k,     e_k ~ N(0, V_k),     δ_k ~ N(0, T)

z_k are the boat's numbers as recording k alone tells them, its day (current, noise, offsets) fitted
along and left behind; V_k its covariance from its own noise: a short or noisy recording weighs
little. T, diagonal, is the scatter of voyages that no interval tells (load, water, growth); it is
found by restricted maximum likelihood (expectation, maximisation), and is at least `MIN_SCATTER`. β
are the numbers: shared by all, or, where boats of one type have recordings, hull numbers of all and
actuators of each boat. A_k picks those of recording k.

A recording is held against what the others say without it: d² = rᵀ (V_k + T + Var)⁻¹ r, beyond
chance by Holm's rule, with the degrees of freedom of a T that few others tell. The worst is left
out and named, and the rest is looked at again. Sources:
Harville, J. Am. Stat. Assoc. 72 (1977) (restricted likelihood); Davidian and Giltinan, Nonlinear
Models for Repeated Measurement Data, 1995, ch. 5 (two stages); Holm, Scand. J. Stat. 6 (1979).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import fdtrc, stdtrit

from sim.effects.catalogue import EFFECTS
from sim.identification import IdentifySettings
from sim.identification.at_rest import axes_at_rest
from sim.identification.identify import FITS, MIN_USABLE_S, fitted_model
from sim.identification.intervals import NORMAL_95, NUISANCE, named_covariance, uncertainty_of
from sim.identification.parameters import Unknown, unknowns_of
from sim.identification.shooting import FitInputs
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError, require_finite
from sim.state import CountedStep, Floats, Progress
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel, with_free_curves

# Chosen, not measured:
MIN_SCATTER = 0.02  # of a number, from voyage to voyage: no two are alike
MIN_OTHERS = 2  # recordings that another one is held against
ALARM = 0.05  # share of fleets in which a recording that agrees is named
ROUNDS = 60  # of expectation and maximisation
MIN_SHARE = 0.01  # of a variance that is scatter found from few: with less, it counts as known


class RecordingFit(NamedTuple):
    """The fit of one recording alone: value (n,), covariance (n, n) of its numbers.

    day  what is of its day, by name
    """

    recording: str
    boat: str
    names: tuple[str, ...]
    value: Floats
    covariance: Floats
    day: dict[str, float]


class Disagreement(NamedTuple):
    """A recording that the others speak against: the number furthest off, in their words."""

    recording: str
    name: str
    value: float
    others: float
    sigmas: float
    p_value: float

    @property
    def text(self) -> str:
        """In a sentence."""
        return (
            f"{self.recording} disagrees with the others and is left out: {self.name} is "
            f"{self.value:.4g} there, {self.others:.4g} on the others, {self.sigmas:.1f} standard "
            "deviations apart"
        )


@dataclass(frozen=True)
class PooledNumber:
    """One number over all recordings; boat: of which alone, empty: of all."""

    name: str
    boat: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]
    scatter: float
    recordings: int

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return vars(self) | {"ci95": list(self.ci95)}


@dataclass(frozen=True)
class ByRecording:
    """The boat's numbers over many recordings, and the recordings that disagree.

    vessels  the vessel of each boat with its numbers; one that no vessel can have stands at the
             limit, outside its interval
    weight   share of each recording in what is known, 0 where it was left out
    """

    vessels: dict[str, Vessel]
    numbers: tuple[PooledNumber, ...]
    fits: tuple[RecordingFit, ...]
    weight: tuple[float, ...]
    disagreements: tuple[Disagreement, ...]
    notices: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The JSON object that `shadow identify --by-recording --json` prints."""
        return {
            "vessel": next(iter(self.vessels.values())).name,
            "parameters": [one.to_dict() for one in self.numbers],
            "recordings": [
                {
                    "recording": fit.recording, "boat": fit.boat, "weight": weight,
                    "parameters": dict(zip(fit.names, fit.value.tolist(), strict=True)),
                    "std": dict(
                        zip(fit.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)
                    ),
                    "day": fit.day,
                }
                for fit, weight in zip(self.fits, self.weight, strict=True)
            ],
            "notices": list(self.notices),
            "disagree": [{**one._asdict(), "text": one.text} for one in self.disagreements],
        }  # fmt: skip


def fit_recording(
    trial: Trial, vessel: Vessel, boat: str, settings: IdentifySettings
) -> RecordingFit:
    """The numbers of one recording alone; a current of its day is fitted along.

    Of an axis along which it is at rest it has next to nothing to say.
    """
    require_finite(trial)
    vessel, settings = _with_day(vessel, replace(settings, at_rest=axes_at_rest([trial])))
    unknowns = unknowns_of(Model.of(vessel), 1, settings)
    fit = FITS[settings.method](FitInputs(unknowns, [trial], settings), None, lambda _: None)
    uncertainty = uncertainty_of(unknowns, fit, settings.block)
    wide = uncertainty.covariance * (uncertainty.factor / NORMAL_95) ** 2
    covariance = named_covariance(unknowns, fit.z, wide)
    own = [
        i for i, u in enumerate(unknowns.each) if u.trial is None and u.name not in NUISANCE
    ]  # fmt: skip
    named = unknowns.to_named(fit.z)
    values = dict(zip((u.name for u in unknowns.each), named, strict=True))
    names = tuple(unknowns.each[i].name for i in own)
    day = {name: float(value) for name, value in values.items() if name not in names}
    return RecordingFit(
        trial.name, boat, names, named[own], covariance[np.ix_(own, own)], day
    )  # fmt: skip


def _with_day(vessel: Vessel, settings: IdentifySettings) -> tuple[Vessel, IdentifySettings]:
    """The vessel with what every day has some of (a current), its numbers free."""
    every = [effect for effect in EFFECTS if effect.of_each_day]
    has = {added.effect.name for added in vessel.effects}
    missing = [effect for effect in every if effect.name not in has]
    none = [{p.name: p.neutral or 0.0 for p in effect.parameters} for effect in missing]
    vessel = vessel.with_effects(*map(AddedEffect, missing, none))
    return vessel, replace(settings, free=(*settings.free, *(f"{e.name}.*" for e in every)))


def pooled(fits: Sequence[RecordingFit], vessel: Vessel, own: Sequence[str] = ()) -> ByRecording:
    """Fits of recordings put together; numbers named `own` are each boat's, the rest are shared.

    Where there are several boats, the first one's own numbers are those of the vessel file: thrust
    and mass have one scale, which motion does not tell.
    """
    boats = list(dict.fromkeys(fit.boat for fit in fits))
    labels = _labels(fits, own)
    kept, named = list(range(len(fits))), list[Disagreement]()
    while True:
        worst = _worst(fits, kept, labels)
        if worst is None:
            break
        named.append(worst[1])
        kept.remove(worst[0])
    fit = _Fit.of([fits[k] for k in kept], [labels[k] for k in kept])
    theta = dict(zip(Model.of(vessel).names, Model.of(vessel).theta.tolist(), strict=True))
    known = {u.name: u for u in unknowns_of(
        Model.of(vessel), 1, IdentifySettings(free=tuple({n for n, _ in fit.labels}), offsets=False)
    ).each}  # fmt: skip
    half = fit.half_interval(len(kept))
    numbers = tuple(
        PooledNumber(
            name, boat, known[name].unit, theta[name],
            float(np.clip(fit.value[i], *_limits(known[name]))),
            (float(fit.value[i] - half[i]), float(fit.value[i] + half[i])),
            float(fit.scatter[i]), sum((name, boat) in labels[k] for k in kept),
        )
        for i, (name, boat) in enumerate(fit.labels)
    )  # fmt: skip
    weight = np.zeros(len(fits))
    weight[kept] = fit.weight
    return ByRecording(
        {boat: _vessel(vessel, numbers, boat) for boat in boats}, numbers, tuple(fits),
        tuple(weight.tolist()), tuple(named),
    )  # fmt: skip


def _limits(one: Unknown) -> tuple[float, float]:
    """Of a number by its name; a knot of a curve lies within all that its thruster gives."""
    return (one.lower, one.upper) if one.share_of is None else (-1.0, 1.0)


Label = tuple[str, str]  # name of a number, and its boat; empty: of all


def _labels(fits: Sequence[RecordingFit], own: Sequence[str]) -> list[list[Label]]:
    """Index into β of each recording's numbers."""
    return [[(n, fit.boat if n in own else "") for n in fit.names] for fit in fits]


def _vessel(vessel: Vessel, numbers: Sequence[PooledNumber], boat: str) -> Vessel:
    """The vessel with the numbers of a boat."""
    values = {one.name: one.value for one in numbers if one.boat in ("", boat)}
    unknowns = unknowns_of(Model.of(vessel), 1, IdentifySettings(free=tuple(values), offsets=False))
    z = unknowns.from_named(np.array([values[u.name] for u in unknowns.each]))
    return fitted_model(unknowns, np.clip(z, *unknowns.bounds)).vessel


@dataclass(frozen=True)
class _Fit:
    """β (m,) with its labels and covariance (m, m), weight (K,) of each recording.

    scatter  (m,) √T, at least `least` (m,)
    """

    labels: list[Label]
    value: Floats
    covariance: Floats
    scatter: Floats
    least: Floats
    weight: Floats

    @classmethod
    def of(cls, fits: Sequence[RecordingFit], labels: Sequence[Sequence[Label]]) -> "_Fit":
        """By restricted maximum likelihood."""
        every = list(dict.fromkeys(one for each in labels for one in each))
        picks = [_pick(each, every) for each in labels]
        size = np.array([_size(fits, labels, one) for one in every])
        T = (0.1 * size) ** 2
        for _ in range(ROUNDS):
            weights = [
                np.linalg.inv(fit.covariance + np.diag(A @ T))
                for fit, A in zip(fits, picks, strict=True)
            ]
            each = [A.T @ W @ A for W, A in zip(weights, picks, strict=True)]
            covariance = np.asarray(np.linalg.inv(sum(each)), dtype=float)
            seen = sum(A.T @ W @ f.value for f, W, A in zip(fits, weights, picks, strict=True))
            beta = covariance @ seen
            total, count = np.zeros(len(every)), np.zeros(len(every))
            for fit, W, A in zip(fits, weights, picks, strict=True):
                own = np.diag(A @ T)
                gain = own @ W
                delta = gain @ (fit.value - A @ beta)
                spread = own - gain @ own + gain @ A @ covariance @ A.T @ gain.T
                total += A.T @ (delta**2 + np.diag(spread))
                count += A.sum(axis=0)
            new = np.maximum(total / np.maximum(count, 1.0), (MIN_SCATTER * size) ** 2)
            done, T = bool(np.allclose(new, T, rtol=1e-3)), new
            if done:
                break
        share = np.array([float(np.trace(covariance @ one)) for one in each]) / len(every)
        scatter = np.asarray(np.sqrt(T), dtype=float)
        return cls(every, beta, covariance, scatter, MIN_SCATTER * size, share)

    def half_interval(self, recordings: int) -> Floats:
        """Half a 95 % interval (m,), by Student's t as far as T was found from few."""
        std = np.sqrt(np.diag(self.covariance))
        excess = (self.scatter**2 - self.least**2) / max(recordings, 1)
        share = np.clip(excess / std**2, MIN_SHARE, 1.0)
        return np.asarray(stdtrit(max(recordings - 1, 1) / share, 0.975) * std)


def _pick(labels: Sequence[Label], every: Sequence[Label]) -> Floats:
    """A (n, m) of a recording."""
    return np.array([[float(one == other) for other in every] for one in labels])


def _size(fits: Sequence[RecordingFit], labels: Sequence[Sequence[Label]], one: Label) -> float:
    """Size of a number: the median over recordings, at least a tenth of its best std."""
    said = [
        (abs(fit.value[each.index(one)]), fit.covariance[each.index(one), each.index(one)])
        for fit, each in zip(fits, labels, strict=True)
        if one in each
    ]
    values, variances = np.array(said).T
    return max(float(np.median(values)), 0.1 * float(np.sqrt(variances.min())))


def _worst(
    fits: Sequence[RecordingFit], kept: Sequence[int], labels: Sequence[Sequence[Label]]
) -> tuple[int, Disagreement] | None:
    """The recording that the others speak against most; None where none is beyond chance."""
    if len(kept) <= MIN_OTHERS:
        return None
    found = []
    for k in kept:
        rest = [i for i in kept if i != k]
        others = _Fit.of([fits[i] for i in rest], [labels[i] for i in rest])
        rows = [j for j, one in enumerate(labels[k]) if _told(one, rest, labels)]
        at = [others.labels.index(labels[k][j]) for j in rows]
        if not rows:
            continue
        said = others.covariance[np.ix_(at, at)] + np.diag(others.scatter[at] ** 2)
        V = fits[k].covariance[np.ix_(rows, rows)] + said
        r = fits[k].value[rows] - others.value[at]
        found_out = others.scatter[at] ** 2 - others.least[at] ** 2  # T that few others tell
        share = float(np.mean(found_out / np.diag(V)))
        degrees = (len(rest) - 1) / max(share, MIN_SHARE)
        p = float(fdtrc(len(rows), degrees, r @ np.linalg.solve(V, r) / len(rows)))
        far = np.abs(r) / np.sqrt(np.diag(V))
        j = int(np.argmax(far))
        found.append((k, Disagreement(
            fits[k].recording, fits[k].names[rows[j]], float(fits[k].value[rows[j]]),
            float(others.value[at[j]]), float(far[j]), p,
        )))  # fmt: skip
    if not found:
        return None
    worst = min(found, key=lambda one: one[1].p_value)
    return worst if worst[1].p_value < ALARM / len(kept) else None


def _told(one: Label, rest: Sequence[int], labels: Sequence[Sequence[Label]]) -> bool:
    """Whether enough other recordings determine a number."""
    return sum(one in labels[i] for i in rest) >= MIN_OTHERS


def identify_by_recording(
    trials: Sequence[Trial],
    vessel: Vessel,
    settings: IdentifySettings | None = None,
    boats: Sequence[str] | None = None,
    progress: Progress = lambda _: None,
) -> ByRecording:
    """Fit every trial alone and put them together; `boats` (K,): whose each is, by default one's.

    With several boats the thrust of each, ahead and astern, is its own; the first one's is that of
    the vessel file. A trial too short to be fitted alone is left out with a notice;
    NoUsableTimeError where all are.
    """
    settings, whose = settings or IdentifySettings(), boats or ["" for _ in trials]
    vessel = with_free_curves(vessel, settings.free)
    own = [f"{t.name}.{end}" for t in vessel.thrusters for end in ("ahead", "astern")]
    pairs = list(zip(trials, whose, strict=True))
    long = [(trial, boat) for trial, boat in pairs if _usable_s(trial) >= MIN_USABLE_S]
    if not long:
        raise NoUsableTimeError(f"no recording has {MIN_USABLE_S:.0f} s of usable time")
    several, first = len({boat for _, boat in long}) > 1, long[0][1]
    fits = []
    for i, (trial, boat) in enumerate(long):
        progress(CountedStep(f"{trial.name} ({i + 1} of {len(long)})", i, len(long)))
        free = (*settings.free, *own) if several and boat != first else settings.free
        fits.append(fit_recording(trial, vessel, boat, replace(settings, free=free)))
    short = tuple(
        f"{trial.name} is left out: {_usable_s(trial):.0f} s of usable time, "
        f"{MIN_USABLE_S:.0f} s are needed"
        for trial, _ in pairs
        if _usable_s(trial) < MIN_USABLE_S
    )
    found = pooled(fits, vessel, own if several else ())
    return replace(found, notices=(*short, *_vague(found)))


def _vague(found: ByRecording) -> tuple[str, ...]:
    """A notice where an interval holds more than twice a number, and zero: what to do instead."""
    names = [n.name for n in found.numbers if n.ci95[1] - n.ci95[0] > 2.0 * abs(n.value)]
    if not names:
        return ()
    return (
        f"these recordings, each alone, tell little of {', '.join(names)}: intervals are wider "
        "than the numbers; fit them together, without --by-recording, or record for longer",
    )


def _usable_s(trial: Trial) -> float:
    return float(trial.usable.sum()) * trial.dt
