"""Measurements that scatter more than their source is assumed to: the filter weighs them less.

Of each kind of measurement z the variance of the white errors is estimated, in units of the assumed
variance R₀, from how far each lies from the line through the two before it:

    d_k = z_k − z_k−1 − (z_k−1 − z_k−2) Δt_k / Δt_k−1
    s = mean of (−d_k d_k−1 − q) / 4 R₀,    R = s R₀ where s > `LEAST`, else R₀

White errors of variance σ² give E[d_k d_k−1] = −4 σ² at an even pace; of a motion that is smooth
from one measurement to the next the product is positive, and of one that is not, a random walk,
minus its variance over a step, q: what the process noise adds in it, and at most H P Hᵀ. The
innovations would not do: of noise that the gate mostly refuses they follow each other, for the
state drifts meanwhile, as they do of a sensor that jumped.

Source: second differences as in the method of J. von Neumann, The mean square successive
difference, Annals of Mathematical Statistics 12, 1941; noise estimated while filtering: R. K.
Mehra, Approaches to adaptive filtering, IEEE Transactions on Automatic Control 17(5), 1972.
Valid for: errors that are independent from one measurement to the next. What lasts for seconds is
in the coloured errors of the state and is not estimated.
"""

import numpy as np

from gateway.estimation import FilterModel, GateRecord, MeasurementKind
from gateway.estimation.model import Event, Workspace
from sim.kernel.compiled import compiled
from sim.state import Floats, wrap

# Chosen; what they give on logs of the firmware and on noisy ones: docs/live.md.
MEMORY = 60.0  # measurements
FEWEST = 10.0  # … before anything is estimated
LEAST = 4.0  # times R₀: noise of twice the assumed standard deviation
MOST = 1e4
MAX_PACE = 2.0  # between one step of time and the next: at a more uneven one nothing is estimated
MAX_STEPS = 6.0  # of σ: a single outlier is no noise
UNKNOWN = 1e5  # times R₀: a state so uncertain is not known yet, or no more
MAX_STEP_S = 0.4  # between measurements from whose bends alone scatter is told
ORDINARY = 0.998  # of them: the others may be outliers


@compiled
def noise_factor(gate: Floats) -> float:
    """Records of one kind -> s: R over R₀, 1 where the noise is about as assumed."""
    s = gate[GateRecord.SCATTER]
    return min(s, MOST) if gate[GateRecord.COUNT] >= FEWEST and s > LEAST else 1.0


@compiled
def process_noise(kind: int, step: float, model: FilterModel) -> float:
    """Variance that the process noise adds to a quantity in a step [s] shorter than its time."""
    turn = 2.0 * model.yaw_acceleration_radps2**2 / model.yaw_tau_s
    run = 2.0 * model.surge_acceleration_mps2**2 / model.surge_tau_s
    slide = 2.0 * model.sway_acceleration_mps2**2 / model.sway_tau_s
    density = turn if kind in (MeasurementKind.YAW, MeasurementKind.YAW_RATE) else max(run, slide)
    if kind in (MeasurementKind.YAW, MeasurementKind.POSITION):
        return float(density * step**5 / 20.0)
    return float(density * step**3 / 3.0)


@compiled
def observe_noise(gate: Floats, event: Event, m: int, model: FilterModel, work: Workspace) -> None:
    """Takes a measurement of m components into the records of its kind.

    `work` holds H and P Hᵀ of its prediction.
    """
    kind, time, z, std = event.kind, event.time, event.z, event.std
    step = time - gate[GateRecord.TIME] if gate[GateRecord.SEEN] > 0.0 else 0.0
    before = gate[GateRecord.STEP]
    even = before > 0.0 and before / MAX_PACE < step < before * MAX_PACE
    product, known, most_own = 0.0, even, process_noise(kind, step, model)
    for a in range(m):
        at, d = GateRecord.MEASURED + a, 0.0
        change = z[a] - gate[at]
        if kind == MeasurementKind.YAW:
            change = wrap(change)
        if even:
            d = change - gate[GateRecord.CHANGE + a] * step / before
        last = gate[GateRecord.BEND + a]
        known = known and d != 0.0 and last != 0.0
        own = 0.0
        for j in range(len(work.H[a])):
            own += work.H[a, j] * work.PH[j, a]
        known = known and own < UNKNOWN * std[a] ** 2
        product += (-d * last - min(own, most_own)) / (4.0 * std[a] ** 2) / m
        gate[at], gate[GateRecord.CHANGE + a], gate[GateRecord.BEND + a] = z[a], change, d
    gate[GateRecord.TIME], gate[GateRecord.STEP] = time, step
    if known:
        count = min(gate[GateRecord.COUNT] + 1.0, MEMORY)
        mean = gate[GateRecord.SCATTER]
        most = MAX_STEPS**2 * max(mean, LEAST)
        gate[GateRecord.COUNT] = count
        gate[GateRecord.SCATTER] += (min(product, most) - mean) / count


def white_std(time: Floats, z: Floats) -> float:
    """Measurements (K, n) at their times (K,) [s] -> standard deviation of their white errors.

    NaN where they come too seldom or too unevenly to tell scatter from motion.
    """
    step, change = np.diff(time), np.diff(z, axis=0)
    with np.errstate(all="ignore"):
        pace = step[1:] / step[:-1]
        bend = change[1:] - change[:-1] * pace[:, np.newaxis]
        even = (pace > 1.0 / MAX_PACE) & (pace < MAX_PACE) & (step[1:] < MAX_STEP_S)
    product = -(bend[1:] * bend[:-1])[even[1:] & even[:-1]] / 4.0
    product = product[np.isfinite(product).all(axis=1)]
    if len(product) < MEMORY:
        return np.nan
    product = product[(product <= np.quantile(product, ORDINARY, axis=0)).all(axis=1)]
    return float(np.sqrt(max(product.mean(), 0.0)))
