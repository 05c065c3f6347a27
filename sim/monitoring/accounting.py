"""Whether the error for which a model is called wrong falls with a cause that would be told.

An explanation may predict the missing force a little better than nothing, clearly so after some
minutes, and yet have nothing to do with an error of metres per second: beside a vessel file that
was only guessed a compass was blamed that was "3° too far to port". What a cause of its present
size adds to the error e of a prediction over one second is

    d = Γ M⁻¹ h(o),     Γ = ∫₀¹ exp(A t) dt

Over one second a hull that is unstable on course makes no spin of a small error, as it does over
five. Summed over five seconds e is what the model lacks in that time: what the estimate errs by at
the end of one prediction it errs by at the start of the next, so noise and chop fall out. The error
falls where |Σ (e − d)| is clearly less than |Σ e|, of all velocities, weighed by the variance of
their estimate, and of the one that is told to be wrong. The boat's own small errors b take no part:
they are not what is told.
"""

from collections.abc import Sequence

import numpy as np

from sim.monitoring import SecondMeans
from sim.monitoring.consistency import NEGLIGIBLE, step_response
from sim.monitoring.disturbances import DisturbanceEstimate, DisturbanceEstimator
from sim.state import Floats

# All but one of 241 right names on five sets of benchmarks/live_naming.py leave less of the error,
# half of them a quarter of it or less; beside guessed vessel files every third name leaves more.
MAX_LEFT = 0.8
SUMMED_S = 5


def error_falls(
    estimator: DisturbanceEstimator, estimate: DisturbanceEstimate, f: int,
    seconds: Sequence[SecondMeans], channel: int,
) -> bool:  # fmt: skip
    """Whether the errors of the last seconds, oldest first, fall with explanation f and what is
    known beside it, and that of the channel (of u, v, r) that is told; too few seconds since the
    trouble began tell nothing against it.
    """
    judged = [
        second for second in seconds
        if second.time > estimate.opened and np.isfinite(second.short_error).all()
    ]  # fmt: skip
    if len(judged) < SUMMED_S:
        return True
    errors = np.array([second.short_error for second in judged])
    added = np.array([_added(estimator, estimate, f, second) for second in judged])
    spread = np.array([np.sqrt(2.0 * second.variance + NEGLIGIBLE**2) for second in judged])
    before = np.sum((_sums(errors) / spread[SUMMED_S - 1 :]) ** 2, axis=0)
    after = np.sum((_sums(errors - added) / spread[SUMMED_S - 1 :]) ** 2, axis=0)
    pairs = ((after.sum(), before.sum()), (after[channel], before[channel]))
    return all(left < MAX_LEFT**2 * whole for left, whole in pairs)


def _added(
    estimator: DisturbanceEstimator, estimate: DisturbanceEstimate, f: int, second: SecondMeans
) -> Floats:
    """d (3,): what the cause adds to the error of a prediction over that second."""
    force, balance = estimator.explained(estimate, second, f)
    gamma = step_response(balance.system_matrix)[:3, :3]
    return np.asarray(gamma @ np.linalg.solve(balance.slope_nu_dot, force))


def _sums(each: Floats) -> Floats:
    """(K, 3) -> sums of `SUMMED_S` that follow one another (K − 4, 3)."""
    total = np.cumsum(np.vstack([np.zeros(3), each]), axis=0)
    return np.asarray(total[SUMMED_S:] - total[:-SUMMED_S])
