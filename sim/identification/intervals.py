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
    """From the residuals block by block."""
    weighted = shot.slope * shot.weight[:, None]
    number = _blocks(shot, block)
    count = int(number.max()) + 1
    each = np.stack([weighted[number == g].T @ shot.slope[number == g] for g in range(count)])
    score = np.stack([weighted[number == g].T @ shot.residual[number == g] for g in range(count)])
    told = each.sum(axis=0) + unknowns.evidence
    model = np.linalg.inv(told + DOUBTED * unknowns.assumptions)
    if count < 3:
        return Spread(told, model, float(student.ppf(0.975, 2)))
    H = told + unknowns.assumptions
    moved = np.linalg.solve(H - each, score[..., None])[..., 0]
    moved -= moved.mean(axis=0)
    robust = (count - 1) / count * moved.T @ moved
    widen = np.sqrt(np.maximum(np.diag(robust) / np.diag(model), 1.0))
    return Spread(told, model * np.outer(widen, widen), float(student.ppf(0.975, count - 1)))


def _blocks(shot: Shot, length: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Number of the block of time of each residual: (N,)."""
    total = sum(float(np.ptp(shot.moment[shot.voyage == v])) for v in np.unique(shot.voyage))
    width = max(min(length, total / FEWEST), SHORTEST)
    label = shot.voyage * 1e6 + np.floor(shot.moment / width)
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64)
