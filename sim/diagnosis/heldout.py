"""What a fit is worth on blocks of time that it did not see.

Each fourth block is held out in turn, 5 s to either side of it with it. The fit without them is
one damped Gauss–Newton step from the fit with them; the model then really runs over the blocks. A
gain is a ratio of squared errors per block: thousands of samples make everything significant, so
what counts is how large it is, and how alike from block to block.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.fit import Fit
from sim.diagnosis.weights import RELIEF
from sim.state import Floats

CLIP = 6.0  # standard deviations: no single row decides a block
FEWEST = 4  # blocks that a t value means anything over


class Gain(NamedTuple):
    """Of one fit over another, on held-out time.

    ratio   of the squared errors, before / after
    log     mean over the blocks of the log of that ratio
    t       of that mean
    nats    of log likelihood, as if `RELIEF` rows were one
    lost    of the nats, per nat won in other blocks
    """

    ratio: float
    log: float
    t: float
    nats: float
    lost: float


def unseen(fit: Fit) -> Floats:
    """Residuals (N,) of each block as a fit without it leaves them."""
    out = fit.residual.copy()
    for k, (_, judge) in enumerate(fit.ground.folds()):
        out[judge] = fit.refits.residual[k, judge]
    return out


def per_block(residual: Floats, block: NDArray[np.int64]) -> Floats:
    """Sum of squares of each block (G,), no row beyond its clip."""
    return np.asarray(np.bincount(block, np.clip(residual, -CLIP, CLIP) ** 2), np.float64)


def gain(before: Floats, after: Floats, block: NDArray[np.int64]) -> Gain:
    """Residuals (N,) of two fits -> what the second is worth."""
    a, b = per_block(before, block), per_block(after, block)
    log = np.log(np.maximum(a, 1e-9) / np.maximum(b, 1e-9))
    spread = float(log.std(ddof=1)) if len(log) >= FEWEST else np.inf
    t = float(log.mean() / max(spread / np.sqrt(len(log)), 1e-9))
    won = 0.5 * (a - b) / RELIEF
    up, down = float(np.maximum(won, 0.0).sum()), float(np.maximum(-won, 0.0).sum())
    return Gain(float(a.sum() / b.sum()), float(log.mean()), t, up - down, down / max(up, 1e-9))
