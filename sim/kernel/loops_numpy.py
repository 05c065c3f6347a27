"""Free runs of a batch in numpy, for kernels that numba cannot compile: loop over time only."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.state import Floats


def rollout(
    kernel: ModuleType, theta: Floats, x0: Floats, table: NDArray[np.int64],
    start: NDArray[np.int64], steps: NDArray[np.int64], delay: Floats, total: Floats,
    voltage: Floats, wind: Floats, time: Floats, dt: float, substeps: int, states: Floats,
    reports: Floats,
) -> None:  # fmt: skip
    """`rollout` of sim.kernel.loops on arrays over the batch: same arguments, same results."""
    p = kernel.unpack(np.resize(theta, (len(x0), theta.shape[1])).T)
    shift = (delay + kernel.delay_of(p)) / dt
    x: Any = kernel.state_from(x0.T)
    h = dt / substeps
    prompt = np.empty_like(reports)
    alive = np.ones(len(x0), bool)
    with np.errstate(all="ignore"):  # a run that diverges is cut off, as in the compiled loop
        for k in range(int(steps.max()) + 1):
            j = np.minimum(start + k, time.shape[1] - 1)
            t = time[table, start] + k * dt
            row = _mean_commands(total, table, start + k - shift)
            air = wind[table, j]
            known = np.isfinite(air.sum(axis=1))
            inputs = kernel.Inputs(
                kernel.actuated(row.T, p), voltage[table, j], *np.nan_to_num(air).T, known * 1.0
            )
            if k == 0 and kernel.NX > 6:
                rest = kernel.at_rest(x, t, inputs, p)
                unset = ~np.isfinite(x0[:, -1])
                x = tuple(np.where(unset, r, v) for r, v in zip(rest, x, strict=True))
            alive &= k <= steps
            states[alive, k] = np.stack(np.broadcast_arrays(*x), axis=-1)[alive]
            k1 = kernel.rates(x, t, inputs, p)
            motion = kernel.motion_of(x, k1)
            for rows, told in ((reports, kernel.observe), (prompt, kernel.observe_now)):
                said = np.stack(np.broadcast_arrays(*told(motion, p)), axis=-1)
                rows[alive, k] = said[alive]
            for i in range(substeps):
                k1 = kernel.rates(x, t + i * h, inputs, p) if i else k1
                x = kernel.step(x, k1, t + i * h, inputs, h, p)
            alive &= np.isfinite(np.sum(x[:6], axis=0)) & (np.abs(x[3]) <= 1e3)
    ages, count = np.broadcast_to(kernel.latency_of(p) / dt, len(x0)), np.isfinite(reports[..., 0])
    for b in np.flatnonzero(ages):
        kernel.aged(reports[b, : count[b].sum()], prompt[b], ages[b], dt)


def _mean_commands(total: Floats, table: NDArray[np.int64], position: Floats) -> Floats:
    """Mean commands (B, na) over one step from each position (B,) [steps]."""

    def integral(at: Floats) -> Floats:
        k = np.clip(np.floor(at).astype(int), 0, total.shape[1] - 2)
        low = total[table, k]
        return low + (at - k)[:, None] * (total[table, k + 1] - low)

    return np.asarray(integral(position + 1.0) - integral(position))
