"""Where a horizon must end: the spread of the start state, carried along the track.

    spread_j = √( mean over u, v, r of (Φ_j P₀ Φ_jᵀ)_ii / scale_i² )

Above its critical speed a hull is unstable on course: a free run of the *true* model leaves the
track there, because its start is not known exactly. What comes after says nothing of the model.
"""

import numpy as np

from sim.diagnosis.segments import Segments
from sim.diagnosis.settings import CompareSettings
from sim.diagnosis.transition import STATE
from sim.state import Floats, Ints
from sim.trial import Trial


def start_variance(trial: Trial, segments: Segments, phi: Floats) -> Floats:
    """Φ (S, J+1, 6, 6) -> variance (S, J+1, 6) that the start state's covariance leaves there."""
    P = trial.covariance[segments.rows, :STATE, :STATE]
    return np.einsum("sjik,skl,sjil->sji", phi, P, phi, optimize=True)


def limited(
    variance: Floats, segments: Segments, scales: Floats, dt: float, settings: CompareSettings
) -> Ints:
    """Variance (S, J+1, 6), scales (3,) -> length in nodes (S,) that each segment may run."""
    spread = np.sqrt(np.mean(variance[..., 3:] / scales**2, axis=-1))
    limit = np.maximum(settings.spread_limit, settings.spread_growth * spread[:, :1])
    nodes = np.arange(spread.shape[1])
    past = ~(spread <= limit) & (nodes <= segments.nodes[:, None])
    first = np.where(past.any(axis=1), np.argmax(past, axis=1), segments.nodes)
    shortest = int(np.ceil(settings.shortest / (segments.stride * dt) - 1e-9))
    return np.minimum(np.maximum(first, shortest), segments.nodes).astype(np.int64)
