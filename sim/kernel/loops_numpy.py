"""Free runs of a batch in numpy, for kernels that numba cannot compile: a loop over time alone."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.body import HeldInputs
from sim.state import Floats


def rollout(
    kernel: ModuleType, theta: Floats, x0: Floats, table: NDArray[np.int64],
    start: NDArray[np.int64], steps: NDArray[np.int64], delay: Floats, total: Floats,
    voltage: Floats, wind: Floats, time: Floats, dt: float, substeps: int, states: Floats,
    reports: Floats,
) -> None:  # fmt: skip
    """`rollout` of sim.kernel.loops on arrays over the batch: same arguments, same results."""
    p = kernel.unpack(np.resize(theta, (len(x0), theta.shape[1])).T)
    late = (delay + kernel.delay_of(p)) / dt
    x: Any = kernel.state_from(x0.T)
    h = dt / substeps
    undelayed = np.empty_like(reports)
    alive = np.ones(len(x0), bool)
    with np.errstate(all="ignore"):  # a run that diverges is cut off, as in the compiled loop
        for k in range(int(steps.max()) + 1):
            j = np.minimum(start + k, time.shape[1] - 1)
            t = time[table, start] + k * dt
            row = _mean_commands(total, table, start + k - late)
            air = wind[table, j]
            known = np.isfinite(air.sum(axis=1))
            actuation = kernel.static_actuation(row.T, p)
            north, east = np.nan_to_num(air).T
            inputs = HeldInputs(actuation, voltage[table, j], north, east, known * 1.0)
            if k == 0 and kernel.NX > 6:
                settled = kernel.settle_memory(x, t, inputs, p)
                unset = ~np.isfinite(x0[:, -1])
                x = tuple(np.where(unset, m, v) for m, v in zip(settled, x, strict=True))
            alive &= k <= steps
            states[alive, k] = np.stack(np.broadcast_arrays(*x), axis=-1)[alive]
            k1 = kernel.state_rates(x, t, inputs, p)
            motion = kernel.motion_of_state(x, k1)
            observed = ((reports, kernel.observe), (undelayed, kernel.observe_undelayed))
            for rows, sensors in observed:
                rows[alive, k] = np.stack(np.broadcast_arrays(*sensors(motion, p)), axis=-1)[alive]
            for i in range(substeps):
                k1 = kernel.state_rates(x, t + i * h, inputs, p) if i else k1
                x = kernel.rk4_step(x, k1, t + i * h, inputs, h, p)
            alive &= np.isfinite(np.sum(x[:6], axis=0)) & (np.abs(x[3]) <= 1e3)
    latency = np.broadcast_to(kernel.latency_of(p) / dt, len(x0))
    for b in np.flatnonzero(latency):
        run = slice(np.isfinite(reports[b, :, 0]).sum())
        kernel.apply_latency(reports[b, run], undelayed[b], latency[b], dt)


def _mean_commands(total: Floats, table: NDArray[np.int64], position: Floats) -> Floats:
    """Mean commands (B, na) over one step from each position (B,) [steps]."""

    def integral(at: Floats) -> Floats:
        k = np.clip(np.floor(at).astype(int), 0, total.shape[1] - 2)
        low = total[table, k]
        return low + (at - k)[:, None] * (total[table, k + 1] - low)

    return np.asarray(integral(position + 1.0) - integral(position))
