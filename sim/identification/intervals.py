"""How sure the parameters are: from blocks of time, never from the count of samples.

    cov = (G − 1)/G Σ_g (δ_g − δ̄)(δ_g − δ̄)ᵀ,     δ_g = −(H − H_g)⁻¹ s_g

δ_g is how far the solution moves when block g is left out (the jackknife form of the
cluster-robust covariance, CR3: Bell and McCaffrey, Survey Methodology 28, 2002). It holds whatever
the residuals' correlation within a block. Few blocks make it uncertain itself: no standard
deviation goes below that of the noise model, and Student's t with G − 1 degrees serves for 1.96.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from sim.identification.shooting import Shot
from sim.identification.unknowns import Unknowns
from sim.state import Floats

LENGTHS = (1.0, 2.0, 3.0)  # of a block: what wanders slowly shows in the longer ones alone
FEWEST = 6  # blocks: on short recordings they shrink towards so many
SHORTEST = 5.0  # s
DOUBTED = 0.1  # of the information of what is only assumed


class Spread(NamedTuple):
    """How far off z may be.

    information  (n, n) of the data and of what is known beforehand
    covariance   (n, n), with what is assumed taken for almost nothing
    factor       standard deviations in half a 95 % interval
    """

    information: Floats
    covariance: Floats
    factor: float


def spread_of(unknowns: Unknowns, shot: Shot, block: float) -> Spread:
    """From the residuals block by block; of short and longer blocks those that doubt more."""
    weighted = shot.slope * shot.weight[:, None]
    told = weighted.T @ shot.slope + unknowns.evidence
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
    return Spread(told, model * np.outer(widen, widen), factor)


def _jackknifed(
    H: Floats, weighted: Floats, shot: Shot, number: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> Floats:
    """Covariance (n, n) from leaving out each block in turn."""
    blocks = [number == g for g in range(int(number.max()) + 1)]
    each = np.stack([weighted[g].T @ shot.slope[g] for g in blocks])
    score = np.stack([weighted[g].T @ shot.residual[g] for g in blocks])
    moved = np.linalg.solve(H - each, score[..., None])[..., 0]
    moved -= moved.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * moved.T @ moved)


def _blocks(shot: Shot, length: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Number of the block of time of each residual: (N,)."""
    total = sum(float(np.ptp(shot.moment[shot.voyage == v])) for v in np.unique(shot.voyage))
    width = max(min(length, total / FEWEST), SHORTEST)
    label = shot.voyage * 1e6 + np.floor(shot.moment / width)
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)
