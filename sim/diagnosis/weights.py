"""How probable each explanation is: stacking of held-out blocks, drawn again and again.

    w = E over π of softmax( ln p + G Σ_b π_b s_b ),     π ~ Dirichlet(1, …, 1),     s_b = −½ Σ e²

s_b is the held-out log score of block b. Drawing blocks anew (pseudo-BMA+: Yao, Vehtari, Simpson
and Gelman, Bayesian Analysis 13, 2018) keeps one lucky block from deciding. Errors within a block
hang together more than the whitening says: `RELIEF` is how many rows count as one.

p is what was believed before. The best of thirty effects, each from several starts, wins a little
where nothing is missing (up to 5 nats on the tuning set's complete models, where effects that are
there win 16 and more): an effect has to win `DOUBT` to be as probable as that nothing is missing.
"""

import numpy as np

from sim.state import Floats

DRAWS = 1000
RELIEF = 3.0
DOUBT = 8.0  # nats


def probabilities(blocks: Floats, seed: int = 1) -> Floats:
    """Held-out squared errors (M, G) by block, nothing added first -> probabilities (M,)."""
    score = -0.5 * blocks / RELIEF
    count = blocks.shape[1]
    draw = np.random.default_rng(seed).dirichlet(np.ones(count), DRAWS)
    total = count * draw @ score.T
    total[:, 1:] -= DOUBT
    total -= total.max(axis=1, keepdims=True)
    weight = np.exp(total)
    return np.asarray((weight / weight.sum(axis=1, keepdims=True)).mean(axis=0))
