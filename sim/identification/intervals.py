"""How sure the parameters are: from blocks of time, never from the count of samples.

    cov = (G − 1)/G Σ_g (δ_g − δ̄)(δ_g − δ̄)ᵀ,     δ_g = −(H − H_g)⁻¹ s_g

δ_g is how far the solution moves when block g is left out (the jackknife form of the
cluster-robust covariance, CR3: Bell and McCaffrey, Survey Methodology 28, 2002). It holds whatever
the residuals' correlation within a block. Few blocks make it uncertain itself: no standard
deviation goes below that of the noise model, and Student's t with G − 1 degrees serves for 1.96.

What is told of a parameter: value, interval, and every doubt in words.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from sim.effects.catalogue import explaining
from sim.effects.effect import Symptom
from sim.identification.parameters import MASSES, OFFSETS, ROUNDING, Unknowns
from sim.identification.shooting import FitResult
from sim.state import Floats

LENGTHS = (1.0, 2.0, 3.0)  # of a block: what wanders slowly shows in the longer ones alone
FEWEST = 6  # blocks: on short recordings they shrink towards so many
SHORTEST = 5.0  # s
DOUBTED = 0.1  # of the information of what is only assumed


class Uncertainty(NamedTuple):
    """How far off z may be.

    information  (n, n) of the data and of what is known beforehand
    covariance   (n, n), with what is assumed taken for almost nothing
    factor       standard deviations in half a 95 % interval
    """

    information: Floats
    covariance: Floats
    factor: float


def uncertainty_of(unknowns: Unknowns, shot: FitResult, block: float) -> Uncertainty:
    """From the residuals block by block; of short and longer blocks those that doubt more."""
    weighted = shot.jacobian * shot.weight[:, None]
    told = weighted.T @ shot.jacobian + unknowns.evidence
    model = np.linalg.inv(told + DOUBTED * unknowns.assumptions)
    H = told + unknowns.assumptions
    widen, factor = np.ones(len(H)), float(student.ppf(0.975, 2))
    for length in block * np.array(LENGTHS):
        number = _blocks(shot, length)
        count = int(number.max()) + 1
        if count < 3:
            break
        t = float(student.ppf(0.975, count - 1))
        factor = t if length == block else factor
        robust = np.diag(_jackknifed(H, weighted, shot, number)) / np.diag(model)
        widen = np.maximum(widen, np.sqrt(robust) * t / factor)
    return Uncertainty(told, model * np.outer(widen, widen), factor)


def _jackknifed(
    H: Floats, weighted: Floats, shot: FitResult, number: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> Floats:
    """Covariance (n, n) from leaving out each block in turn."""
    blocks = [number == g for g in range(int(number.max()) + 1)]
    each = np.stack([weighted[g].T @ shot.jacobian[g] for g in blocks])
    score = np.stack([weighted[g].T @ shot.residual[g] for g in blocks])
    moved = np.linalg.solve(H - each, score[..., None])[..., 0]
    moved -= moved.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * moved.T @ moved)


def _blocks(shot: FitResult, length: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Number of the block of time of each residual: (N,)."""
    total = sum(
        float(np.ptp(shot.time[shot.trial_number == v])) for v in np.unique(shot.trial_number)
    )
    width = max(min(length, total / FEWEST), SHORTEST)
    label = shot.trial_number * 1e6 + np.floor(shot.time / width)
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)


TOLD_LITTLE = 0.75  # of the parameter's size in half an interval: the data say little
AT_LIMIT = 1e-3  # of the scale
SHARES = 0.35  # of the largest part: a parameter takes part in a combination
NUISANCE = (*OFFSETS, ROUNDING)

TOO_LATE = {OFFSETS[0]: Symptom.LATE_COMMANDS, OFFSETS[1]: Symptom.LATE_VELOCITY}
EXCITES = {
    "m11": "steps of the throttle and coasting to a stop",
    "X_u": "steady runs at several speeds, slow ones among them, and coasting to a stop",
    "X_uu": "steady runs at several speeds up to full throttle",
    "m22": "weaving at speed: turns that begin and end quickly",
    "Y_v": "turns at several speeds, so that the boat slides sideways",
    "Y_vv": "hard turns at full speed, so that the boat slides sideways fast",
    "m33": "quick changes of helm: zigzag, or steering swings from slow to fast",
    "N_r": "steady turns at several rates, either way",
    "N_rr": "spinning on the spot as fast as it goes",
    "ahead": "a known mass or a bollard pull: motion alone tells thrust per mass",
    "astern": "going astern, and a known mass",
    "area": "turns at several speeds with different helm",
}


@dataclass(frozen=True)
class Estimate:
    """One number: before, now, and its 95 % interval; `doubt` is empty where there is none."""

    name: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]
    identifiable: bool
    trial: str | None = None
    doubt: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For JSON: without what does not apply."""
        out: dict[str, Any] = {
            "value": self.value, "ci95": list(self.ci95), "unit": self.unit,
            "before": self.before, "identifiable": self.identifiable,
        }  # fmt: skip
        return out | ({"doubt": self.doubt} if self.doubt else {})


def estimates_of(
    unknowns: Unknowns, z: Floats, spread: Uncertainty, trials: Sequence[str]
) -> tuple[Estimate, ...]:
    """All numbers by their names, nuisances too."""
    value, before = unknowns.named(z), unknowns.named(unknowns.start)
    half = spread.factor * np.sqrt(np.diag(_named_covariance(unknowns, z, spread)))
    vague = spread.factor * np.sqrt(np.diag(spread.covariance)) > TOLD_LITTLE * _sizes(unknowns, z)
    scaled = {n for names in _traded(unknowns, z, spread) if _scaled(names) for n in names}
    out = []
    for i, u in enumerate(unknowns.each):
        nuisance = u.name in NUISANCE
        out.append(
            Estimate(
                u.name, u.unit, float(before[i]), float(value[i]),
                (float(value[i] - half[i]), float(value[i] + half[i])),
                bool(nuisance or not vague[i]),
                None if u.trial is None else trials[u.trial],
                _doubt(unknowns, i, z, bool(vague[i]) and not nuisance, u.name in scaled),
            )
        )  # fmt: skip
    return tuple(out)


def undetermined(unknowns: Unknowns, z: Floats, spread: Uncertainty) -> NDArray[np.bool_]:
    """Which numbers the data do not tell even if all others were known: (n,)."""
    alone = spread.factor / np.sqrt(np.maximum(np.diag(spread.information), 1e-300))
    nuisance = np.array([u.name in NUISANCE for u in unknowns.each])
    return np.asarray((alone > TOLD_LITTLE * _sizes(unknowns, z)) & ~nuisance)


def _sizes(unknowns: Unknowns, z: Floats) -> Floats:
    """What counts as a large change of each (n,): its size, or what was known before."""
    assumed = np.array([u.assumed for u in unknowns.each])
    size = np.array([u.size for u in unknowns.each])
    return np.where(assumed, np.maximum(size, np.abs(z)), [u.prior for u in unknowns.each])


def _named_covariance(unknowns: Unknowns, z: Floats, spread: Uncertainty) -> Floats:
    """Covariance of the numbers by their names, where z holds north and east parts."""
    step = 1e-5 * np.array([u.scale for u in unknowns.each])
    moved = unknowns.named(z + np.diag(step)) - unknowns.named(z - np.diag(step))
    J = (np.remainder(moved + np.pi, 2.0 * np.pi) - np.pi).T / (2.0 * step)
    return np.asarray(J @ spread.covariance @ J.T)


def _doubt(unknowns: Unknowns, i: int, z: Floats, vague: bool, scaled: bool) -> str:
    """Limits that were hit, and what would tell a number that these data do not.

    `scaled`: it is known but for the scale that thrust and masses share.
    """
    u = unknowns.each[i]
    lower, upper = unknowns.bounds
    said = []
    for limit, name in ((lower[i], "lower"), (upper[i], "upper")):
        if abs(z[i] - limit) < AT_LIMIT * u.scale:
            said.append(f"stands at its {name} limit, {limit:g} {u.unit}{_too_late(u.name)}")
    if vague and scaled:
        said.append("not identifiable: known only as a share of thrust; fix the thrust, or a mass")
    elif vague:
        manoeuvre = EXCITES.get(u.name.rpartition(".")[2])
        said.append(
            "not identifiable from these data"
            + (f"; would be told by {manoeuvre}" if manoeuvre else "")
        )
    return "; ".join(said)


def _too_late(name: str) -> str:
    """What an offset in time at its limit means; empty for other numbers."""
    symptom = TOO_LATE.get(name)
    return f": {symptom.value} ({explaining(symptom)})" if symptom else ""


def trade_offs(unknowns: Unknowns, z: Floats, spread: Uncertainty) -> tuple[str, ...]:
    """Directions that the data hardly tell: the parameters that trade against each other."""
    return tuple(_says(names) for names in _traded(unknowns, z, spread))


def _traded(unknowns: Unknowns, z: Floats, spread: Uncertainty) -> list[list[str]]:
    """Names of the parameters in each of these directions, two or more."""
    size = _sizes(unknowns, z)
    value, vector = np.linalg.eigh(spread.information * np.outer(size, size))
    out = []
    for k in np.flatnonzero(value < (spread.factor / TOLD_LITTLE) ** 2):
        part = np.abs(vector[:, k])
        names = [unknowns.each[i].name for i in np.argsort(-part) if part[i] > SHARES * part.max()]
        out.append([n for n in names if n not in NUISANCE])
    return [names for names in out if len(names) > 1]


def _scaled(names: Sequence[str]) -> bool:
    """Whether it is the scale that thrust and masses share."""
    keys = {n.rpartition(".")[2] for n in names}
    return bool(keys & {"ahead", "astern"} and keys & {*MASSES, "X_u", "X_uu", "N_r"})


def _says(names: Sequence[str]) -> str:
    listed = ", ".join(names)
    if _scaled(names):
        return (
            f"thrust and mass cannot be told apart by motion alone ({listed}): "
            "fix the thrust, or a mass"
        )
    return f"these trade against each other in these data: {listed}"
