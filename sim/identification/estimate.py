"""What is told of a parameter: value, interval, and every doubt in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.identification.intervals import Spread
from sim.identification.unknowns import MASSES, OFFSETS, ROUNDING, Unknowns
from sim.state import Floats

TOLD_LITTLE = 0.75  # of the parameter's size in half an interval: the data say little
AT_LIMIT = 1e-3  # of the scale
SHARES = 0.35  # of the largest part: a parameter takes part in a combination
NUISANCE = (*OFFSETS, ROUNDING)

TOO_LATE = {
    OFFSETS[0]: ": the boat answers later than telemetry can explain (thruster_lag, command_delay)",
    OFFSETS[1]: ": velocities are later than telemetry can explain (velocity_latency)",
}
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

    def as_dict(self) -> dict[str, Any]:
        """For JSON: without what does not apply."""
        out: dict[str, Any] = {
            "value": self.value, "ci95": list(self.ci95), "unit": self.unit,
            "before": self.before, "identifiable": self.identifiable,
        }  # fmt: skip
        return out | ({"doubt": self.doubt} if self.doubt else {})


def estimates_of(
    unknowns: Unknowns, z: Floats, spread: Spread, trials: Sequence[str]
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


def untold(unknowns: Unknowns, z: Floats, spread: Spread) -> NDArray[np.bool_]:
    """Which numbers the data do not tell even if all others were known: (n,)."""
    alone = spread.factor / np.sqrt(np.maximum(np.diag(spread.information), 1e-300))
    nuisance = np.array([u.name in NUISANCE for u in unknowns.each])
    return np.asarray((alone > TOLD_LITTLE * _sizes(unknowns, z)) & ~nuisance)


def _sizes(unknowns: Unknowns, z: Floats) -> Floats:
    """What counts as a large change of each (n,): its size, or what was known before."""
    assumed = np.array([u.assumed for u in unknowns.each])
    size = np.array([u.size for u in unknowns.each])
    return np.where(assumed, np.maximum(size, np.abs(z)), [u.prior for u in unknowns.each])


def _named_covariance(unknowns: Unknowns, z: Floats, spread: Spread) -> Floats:
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
            said.append(f"stands at its {name} limit, {limit:g} {u.unit}{TOO_LATE.get(u.name, '')}")
    if vague and scaled:
        said.append("not identifiable: known only as a share of thrust; fix the thrust, or a mass")
    elif vague:
        manoeuvre = EXCITES.get(u.name.rpartition(".")[2])
        said.append(
            "not identifiable from these data"
            + (f"; would be told by {manoeuvre}" if manoeuvre else "")
        )
    return "; ".join(said)


def combinations(unknowns: Unknowns, z: Floats, spread: Spread) -> tuple[str, ...]:
    """Directions that the data hardly tell: the parameters that trade against each other."""
    return tuple(_says(names) for names in _traded(unknowns, z, spread))


def _traded(unknowns: Unknowns, z: Floats, spread: Spread) -> list[list[str]]:
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
