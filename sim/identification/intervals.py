"""How uncertain the parameters are: from blocks of time, never from the count of samples.

    cov = (G − 1)/G Σ_g (δ_g − δ̄)(δ_g − δ̄)ᵀ,     δ_g = −(H − H_g)⁻¹ s_g

δ_g is how far the solution moves when block g is left out (the jackknife form of the
cluster-robust covariance, CR3: Bell and McCaffrey, Survey Methodology 28, 2002). It holds whatever
the residuals' correlation within a block. Few blocks make it uncertain itself: no standard
deviation goes below that of the noise model, and Student's t with G − 1 degrees serves for 1.96.

Where H or H − H_g is singular, a direction that no residual and no prior determines gets a very
large standard deviation: the parameters in it are reported as not identifiable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from sim.effects.catalogue import explaining
from sim.effects.effect import Symptom
from sim.identification import BASE, MASSES
from sim.identification.parameters import (
    ASSUMED_STD,
    DAMPING,
    DIRECTION,
    MAGNITUDE,
    OFFSETS,
    ROUNDING,
    Unknown,
    Unknowns,
)
from sim.identification.shooting import FitResult
from sim.state import Floats, Ints

# Chosen, not measured:
LENGTHS = (1.0, 2.0, 3.0)  # blocks: errors that wander slowly show in the longer ones alone
MIN_BLOCKS = 6  # on short recordings blocks shrink towards so many
SHORTEST_BLOCK_S = 5.0
ASSUMED_SHARE = 0.1  # of the assumed information that counts in a standard deviation
UNDETERMINED_SHARE = 0.75  # of a large change in half an interval: the data do not determine it
AT_LIMIT = 1e-3  # scales from a bound that a parameter stands at
TRADE_SHARE = 0.35  # of the largest component: a parameter takes part in a trade-off
MIN_EIGENVALUE = 1e-12  # of the largest, of a scaled information matrix that is singular
UNKNOWN_STD = 1e6  # scales: standard deviation of a parameter that nothing determines
DIFFERENCE_STEP = 1e-5  # scales, of the derivatives of named parameters by z
NORMAL_95 = 1.96  # standard deviations in half a 95 % interval
NUISANCE = (*OFFSETS, ROUNDING)


class Uncertainty(NamedTuple):
    """Uncertainty of the fitted vector z.

    information  (n, n) of the data and of the priors that were given
    covariance   (n, n), with what is only assumed taken for almost nothing
    factor       standard deviations in half a 95 % interval
    """

    information: Floats
    covariance: Floats
    factor: float


def uncertainty_of(unknowns: Unknowns, fit: FitResult, block: float) -> Uncertainty:
    """From the residuals block by block, the larger of those of short and longer blocks [s]."""
    scale = np.array([u.scale for u in unknowns.each])
    weighted = fit.jacobian * fit.weight[:, None]
    information = weighted.T @ fit.jacobian + unknowns.prior_information
    model = _inverse(information + ASSUMED_SHARE * unknowns.assumed_information, scale)
    H = information + unknowns.assumed_information
    widen, factor = np.ones(len(H)), float(stdtrit(2, 0.975))
    for length in block * np.array(LENGTHS):
        number = _blocks(fit, length)
        count = int(number.max()) + 1
        if count < 3:
            break
        t = float(stdtrit(count - 1, 0.975))
        factor = t if length == block else factor
        robust = np.diag(_jackknifed(H, weighted, fit, number, scale)) / np.diag(model)
        widen = np.maximum(widen, np.sqrt(robust) * t / factor)
    return _untold(unknowns, Uncertainty(information, model * np.outer(widen, widen), factor))


def _untold(unknowns: Unknowns, found: Uncertainty) -> Uncertainty:
    """Of numbers along an axis at rest nothing is known but what was before: noise alone spoke."""
    held = unknowns.at_rest
    std = np.array([min(u.prior, ASSUMED_STD * u.scale) for u in unknowns.each])
    told = np.outer(~held, ~held)
    covariance = np.where(told, found.covariance, 0.0) + np.diag(np.where(held, std**2, 0.0))
    return found._replace(information=np.where(told, found.information, 0.0), covariance=covariance)


def _jackknifed(H: Floats, weighted: Floats, fit: FitResult, number: Ints, scale: Floats) -> Floats:
    """Covariance (n, n) from leaving out each block in turn."""
    blocks = [number == g for g in range(int(number.max()) + 1)]
    each = np.stack([weighted[g].T @ fit.jacobian[g] for g in blocks])
    score = np.stack([weighted[g].T @ fit.residual[g] for g in blocks])
    try:
        moved = np.linalg.solve(H - each, score[..., None])[..., 0]
    except np.linalg.LinAlgError:
        left = zip(H - each, score, strict=True)
        moved = np.stack([_regular_inverse(own, scale) @ s for own, s in left])
    moved -= moved.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * moved.T @ moved)


def _inverse(information: Floats, scale: Floats) -> Floats:
    """Covariance (n, n) of an information matrix; that of `_regular_inverse` where singular."""
    try:
        covariance = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        return _regular_inverse(information, scale)
    if np.isfinite(covariance).all() and np.all(np.diag(covariance) > 0.0):
        return np.asarray(covariance)
    return _regular_inverse(information, scale)


def _regular_inverse(information: Floats, scale: Floats) -> Floats:
    """Inverse (n, n) whose undetermined directions have very large, finite variances."""
    regular = information + np.diag((UNKNOWN_STD * scale) ** -2.0)
    size = 1.0 / np.sqrt(np.maximum(np.diag(regular), (UNKNOWN_STD * scale) ** -2.0))
    value, vector = np.linalg.eigh(regular * np.outer(size, size))
    value = np.maximum(value, MIN_EIGENVALUE * max(value[-1], 1.0))
    return np.asarray((vector / value) @ vector.T * np.outer(size, size))


def _blocks(fit: FitResult, length: float) -> Ints:
    """Number of the block of time of each residual: (N,)."""
    trials = np.unique(fit.trial_number)
    total = sum(float(np.ptp(fit.time[fit.trial_number == k])) for k in trials)
    width = max(min(length, total / MIN_BLOCKS), SHORTEST_BLOCK_S)
    label = fit.trial_number * 1e6 + np.floor(fit.time / width)
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)


OFFSET_SYMPTOMS = {OFFSETS[0]: Symptom.LATE_COMMANDS, OFFSETS[1]: Symptom.LATE_VELOCITY}
EARLY = {  # what an offset at its lower limit says: no effect of the catalogue does that
    OFFSETS[0]: "the boat answers sooner than telemetry can explain",
    OFFSETS[1]: "velocities are sooner than telemetry can explain",
}
EXCITATIONS = {
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
    """One parameter: before, now, and its 95 % interval; `doubt`: empty where there is none."""

    name: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]
    identifiable: bool
    trial: str | None = None
    doubt: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For JSON; `doubt` only where there is one."""
        out: dict[str, Any] = {
            "value": self.value, "ci95": list(self.ci95), "unit": self.unit,
            "before": self.before, "identifiable": self.identifiable,
        }  # fmt: skip
        return out | ({"doubt": self.doubt} if self.doubt else {})


def estimates_of(
    unknowns: Unknowns, z: Floats, uncertainty: Uncertainty, trials: Sequence[str],
    filtered: float = 0.0,
) -> tuple[Estimate, ...]:  # fmt: skip
    """All parameters by their names, nuisances too; `filtered`: `IdentifySettings.filtered`."""
    value, before = unknowns.to_named(z), unknowns.to_named(unknowns.start)
    covariance = named_covariance(unknowns, z, uncertainty.covariance)
    half = uncertainty.factor * np.sqrt(np.diag(covariance))
    of_hull = np.array([u.name in BASE for u in unknowns.each])
    half = np.hypot(half, of_hull * NORMAL_95 * filtered * np.abs(value))
    large = UNDETERMINED_SHARE * _large_changes(unknowns, z)
    vague = uncertainty.factor * np.sqrt(np.diag(uncertainty.covariance)) > large
    traded = _traded(unknowns, z, uncertainty)
    scaled = {n for names in traded if _is_thrust_per_mass(names) for n in names}
    out = []
    for i, u in enumerate(unknowns.each):
        known = u.name in NUISANCE or not vague[i]
        out.append(
            Estimate(
                u.name, u.unit, float(before[i]), float(value[i]),
                _within_sign(u, float(value[i] - half[i]), float(value[i] + half[i])),
                bool(known),
                None if u.trial is None else trials[u.trial],
                _doubt(unknowns, i, z, not known, u.name in scaled),
            )
        )  # fmt: skip
    return tuple(out)


def _within_sign(u: Unknown, low: float, high: float) -> tuple[float, float]:
    """An interval without the numbers that nothing has: a hull that the water drives, no mass, a
    magnitude or what else an effect declares to begin at zero (more drag, a delay) below that.
    """
    key = u.name.rpartition(".")[2]
    if key in DAMPING or key == "astern":
        return low, min(high, 0.0)
    if u.polar is None:
        positive = key in MASSES or key == "ahead" or u.lower == 0.0
    else:
        positive = u.polar == MAGNITUDE  # not its direction, whose bounds are of an east part
    return (max(low, 0.0), high) if positive else (low, high)


def undetermined(unknowns: Unknowns, z: Floats, uncertainty: Uncertainty) -> NDArray[np.bool_]:
    """Parameters that the data do not determine even if all others were known: (n,)."""
    information = np.maximum(np.diag(uncertainty.information), 1e-300)
    alone = uncertainty.factor / np.sqrt(information)
    nuisance = np.array([u.name in NUISANCE for u in unknowns.each])
    large = UNDETERMINED_SHARE * _large_changes(unknowns, z)
    return np.asarray((alone > large) & ~nuisance)


def _large_changes(unknowns: Unknowns, z: Floats) -> Floats:
    """Uncertainties (n,) so large that nothing is known: a parameter's size, or its prior."""
    assumed = np.array([u.assumed for u in unknowns.each])
    large = np.array([u.large_change for u in unknowns.each])
    large = np.where(assumed, np.maximum(large, np.abs(z)), large)
    scale = np.array([u.scale for u in unknowns.each])
    return np.where(np.isfinite(large), large, np.maximum(scale, np.abs(z)))


def named_covariance(unknowns: Unknowns, z: Floats, covariance: Floats) -> Floats:
    """Covariance (n, n) of the named parameters from that of z, which holds parts and shares."""
    step = DIFFERENCE_STEP * np.array([u.scale for u in unknowns.each])
    moved = unknowns.to_named(z + np.diag(step)) - unknowns.to_named(z - np.diag(step))
    turned = np.array([u.polar == DIRECTION for u in unknowns.each])
    moved[:, turned] = np.remainder(moved[:, turned] + np.pi, 2.0 * np.pi) - np.pi
    J = moved.T / (2.0 * step)
    return np.asarray(J @ covariance @ J.T)


def _doubt(unknowns: Unknowns, i: int, z: Floats, vague: bool, scaled: bool) -> str:
    """Bounds that were hit, and what would determine a parameter that these data do not.

    `scaled`: it is known but for the scale that thrust and masses share.
    """
    u = unknowns.each[i]
    lower, upper = unknowns.bounds
    doubts = []
    for limit, name in ((lower[i], "lower"), (upper[i], "upper")):
        if abs(z[i] - limit) < AT_LIMIT * u.scale:
            cause = _offset_text(u.name, early=name == "lower")
            doubts.append(f"stands at its {name} limit, {limit:g} {u.unit}{cause}")
    if u.name in unknowns.faster_than_rows(z):
        doubts.append(
            "held at the strongest that these rows can tell: any stronger would look the same"
        )
    elif vague and scaled:
        doubts.append(
            "not identifiable: known only as a share of thrust; fix the thrust, or a mass"
        )
    elif vague:
        doubts.append(not_identifiable(u.name, u.at_rest))
    return "; ".join(doubts)


def _offset_text(name: str, early: bool) -> str:
    """What it means that an offset of that name stands at its lower (early) or upper limit."""
    symptom = OFFSET_SYMPTOMS.get(name)
    if symptom is None:
        return ""
    return f": {EARLY[name]}" if early else f": {symptom.value} ({explaining(symptom)})"


def not_identifiable(name: str, why: str = "") -> str:
    """The doubt of a parameter that the data do not determine, why, and what would."""
    manoeuvre = EXCITATIONS.get(name.rpartition(".")[2])
    because = f": {why}" if why else ""
    more = f"; would be told by {manoeuvre}" if manoeuvre else ""
    return f"not identifiable from these data{because}{more}"


def trade_offs(unknowns: Unknowns, z: Floats, uncertainty: Uncertainty) -> tuple[str, ...]:
    """A sentence for each direction that the data hardly determine: parameters that trade."""
    out = []
    for names in _traded(unknowns, z, uncertainty):
        listed = ", ".join(names)
        out.append(
            f"thrust and mass cannot be told apart by motion alone ({listed}): "
            "fix the thrust, or a mass"
            if _is_thrust_per_mass(names)
            else f"these trade against each other in these data: {listed}"
        )
    return tuple(out)


def _traded(unknowns: Unknowns, z: Floats, uncertainty: Uncertainty) -> list[list[str]]:
    """Names of the parameters in each of these directions, two or more."""
    size = _large_changes(unknowns, z)
    value, vector = np.linalg.eigh(uncertainty.information * np.outer(size, size))
    out = []
    for k in np.flatnonzero(value < (uncertainty.factor / UNDETERMINED_SHARE) ** 2):
        part = np.abs(vector[:, k])
        least = TRADE_SHARE * part.max()
        told = [unknowns.each[i] for i in np.argsort(-part) if part[i] > least]
        out.append([u.name for u in told if u.name not in NUISANCE and not u.at_rest])
    return [names for names in out if len(names) > 1]


def _is_thrust_per_mass(names: Sequence[str]) -> bool:
    """Whether a parameter is the scale that thrust and masses share."""
    keys = {n.rpartition(".")[2] for n in names}
    return bool(keys & {"ahead", "astern"} and keys & {*MASSES, "X_u", "X_uu", "N_r"})
