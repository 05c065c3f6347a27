"""The compiled equations of motion of one vessel: text, compilation, and the loops around them.

Here: arrays as the compiled loops take them, which are contiguous, writable, of one type (numba
compiles anew for every other kind of array); free runs of a batch in numpy, for kernels that numba
cannot compile, a loop over time alone; and types of the functions that `sim.kernel.generator`
writes for one vessel, for the type checker.

A state is a tuple of floats, or of arrays over a batch: north, east, yaw, u, v, r, then the memory
of actuators and effects. Commands are a row, thrusters first, then rudders.
"""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.body import Flow, HeldInputs, Report
from sim.state import Floats, Inertia, Pose, Water, Wrench

State = tuple[Any, ...]
Numbers = Any  # all parameters of the vessel by name
Rates = Callable[[State, float, HeldInputs, Numbers], State]
Balance = Callable[[State, float, float, float, float, HeldInputs, Numbers], Wrench]

NX: int  # length of a state
unpack: Callable[[Floats], Numbers]  # parameters (P,) or (P, B) by name
delay_of: Callable[[Numbers], float]  # how much later all commands act [s]
latency_of: Callable[[Numbers], float]  # age of reported position and velocity over ground [s]
state_from: Callable[[Floats], State]  # of a row (nx,) or (nx, B)
axpy: Callable[[State, float, State], State]  # x + h k
# commands (na,) -> static thrusts [N], then rudder angles [rad]: once per interval of held inputs
static_actuation: Callable[[Floats, Numbers], tuple[Any, ...]]
settle_memory: Rates  # the state with the memory that constant inputs lead to
state_rates: Rates  # ẋ under the commands at a time [s]
# ẋ under the commands and a force beside them
state_rates_with_force: Callable[[State, float, HeldInputs, Wrench, Numbers], State]
# ẋ under a force instead of the commands: actuators keep their memory
state_rates_under_force: Callable[[State, float, HeldInputs, Wrench, Numbers], State]
water_at: Callable[[float, Pose, Numbers], Water]  # motion of the water at a time [s] and place
flow_at: Callable[[State, float, HeldInputs, Water, Numbers], Flow]
# M and balance(ν̇, ν) of an actuators' wrench: (x, u̇, v̇, ṙ, water, flow, τ, numbers)
balance: Callable[
    [State, float, float, float, Water, Flow, Wrench, Numbers], tuple[Inertia, Wrench]
]
commanded_wrench: Callable[[State, float, HeldInputs, Numbers], Wrench]  # τ(commands)
missing_wrench: Balance  # at this ν̇ and time: what the vessel needs beside its commanded forces
required_wrench: Balance  # the same with no commanded forces: what this ν̇ takes
observe: Callable[[Report, Numbers], Report]  # true motion -> what the sensors report
observe_undelayed: Callable[[Report, Numbers], Report]  # … if none of them were late


def rollout_numpy(
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
        kernel.apply_latency(reports[b, run], undelayed[b], latency[b])


def _mean_commands(total: Floats, table: NDArray[np.int64], position: Floats) -> Floats:
    """Mean commands (B, na) over one step from each position (B,) [steps]."""

    def integral(at: Floats) -> Floats:
        k = np.clip(np.floor(at).astype(int), 0, total.shape[1] - 2)
        low = total[table, k]
        return low + (at - k)[:, None] * (total[table, k + 1] - low)

    return np.asarray(integral(position + 1.0) - integral(position))


def floats(values: ArrayLike) -> Floats:
    """Anything -> float64, contiguous, writable."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.flags.carray:
        return values  # `require` takes 3 µs to find that out, and a live row has a dozen arrays
    return np.require(values, np.float64, ["C", "W"])


def flags(values: ArrayLike | None, count: int) -> NDArray[np.bool_]:
    """Flags (K,), or None -> none of them set."""
    if values is None:
        return np.zeros(count, np.bool_)
    if isinstance(values, np.ndarray) and values.dtype == np.bool_ and values.flags.carray:
        return values
    return np.require(values, np.bool_, ["C", "W"])


def air(voltage: ArrayLike | None, wind: ArrayLike | None, count: int) -> tuple[Floats, Floats]:
    """Voltage (K,) [V] and wind (K, 2) [m/s]; NaN, not measured, where left out."""
    volts = np.full(count, np.nan) if voltage is None else floats(voltage)
    return volts, np.full((count, 2), np.nan) if wind is None else floats(wind)


def frozen(carry: Floats) -> Floats:
    """The same array, read-only: part of a frozen state."""
    carry.flags.writeable = False
    return carry
