"""Do the model's errors follow its inputs? Whiteness, and correlation with the commanded forces.

    ε_k = M (ν − ν̂)_k / h,     ν̂_k predicted over one step h from the estimate one step before
    R_ετ(j) = mean of ε_k τ_{k−j},     |ρ(j)| < 2.58 / √N for 99 % of independent series

Steps do not overlap. τ is made white by an autoregressive filter A(q) first, and ε goes through
the same one: ρ is then the shape of the impulse response from commanded to missing force, and
under independence its variance is 1/N whatever the colour of ε. Thrust that comes d late gives
τ(t − d) − τ(t): a trough at lag 0 and a peak at d. A smoother that blurs fast motion gives peaks on
both sides of 0: what counts is a lag's excess over its mirror image. Correlation at negative lags
alone is feedback, an autopilot that answers what the model does not know: no fault of the model.
Valid for: commands that come faster than the lateness in question. Source: Ljung, System
Identification, 2nd ed. 1999, §16.6 (residual analysis) and §6.1 (prewhitening).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter
from scipy.stats import norm

from sim.model import Model
from sim.prediction.free_runs import memory_at
from sim.prediction.inputs import commands_of, delayed, inputs_of, motion_of, runs_from
from sim.prediction.segments import stretches
from sim.state import Floats, Ints
from sim.trial import Trial

LAGS = 25
STEP_S = 0.1  # or the trial's own, if that is longer
ORDER = 8  # of the whitening filter
LEVEL = 0.99
LATE_S = STEP_S  # less than a step cannot be told, and streams may be apart by half of it
FEWEST = 20 * LAGS  # steps
NAMES = ("thrust ahead", "thrust to starboard", "turning moment")
ERRORS = ("u", "v", "r")


@dataclass(frozen=True)
class Pair:
    """Correlation (2 L + 1,) of one error with one input, at lags −L … L; late [s], 0: not."""

    error: str
    input: str
    correlation: Floats
    late: float


@dataclass(frozen=True)
class Independence:
    """step [s], count of steps; white (3, L) autocorrelation of the errors at lags 1 … L."""

    step: float
    count: int
    white: Floats
    pairs: tuple[Pair, ...]

    @property
    def band(self) -> float:
        """Of a correlation, where 99 % of independent series lie."""
        return float(norm.ppf(0.5 + 0.5 * LEVEL)) / max(self.count, 1) ** 0.5

    @property
    def says(self) -> str:
        """In words where errors follow an input; empty where none does."""
        late = [pair for pair in self.pairs if pair.late > 0.0]
        if not late:
            return ""
        by = ", ".join(f"{p.late:.2g} s ({p.error} after {p.input})" for p in late)
        return f"errors follow the commands by {by}: a delay or lag is missing"

    def as_dict(self) -> dict[str, Any]:
        """For JSON: no nulls, no NaN."""
        outside = (np.abs(self.white) > self.band).mean(axis=1)
        return {
            "step_s": self.step,
            "steps": self.count,
            "band": self.band,
            "says": self.says,
            "not_white": dict(zip(ERRORS, outside.tolist(), strict=True)),
            "correlations": [
                {"error": p.error, "input": p.input, "late_s": p.late,
                 "correlation": p.correlation.tolist()}
                for p in self.pairs
            ],
        }  # fmt: skip


def independence(trial: Trial, model: Model) -> Independence | None:
    """Errors over one step against the commanded forces; None where there is too little."""
    stride = max(round(STEP_S / trial.dt), 1)
    parts = [
        np.arange(s.start, s.stop - stride, stride)
        for s in stretches(trial.usable)
        if len(s) > 4 * LAGS * stride
    ]
    if sum(map(len, parts)) < FEWEST:
        return None
    rows = np.concatenate(parts)
    errors, forces = _errors(trial, model, rows, stride), _forces(trial, model, rows, stride)
    ends = np.cumsum([len(part) for part in parts])[:-1]
    return of_series(np.split(errors, ends), np.split(forces, ends), stride * trial.dt)


def of_series(errors: list[Floats], forces: list[Floats], step: float) -> Independence:
    """Stretches of errors (n, 3) and forces (n, 3) [N, N, N m], one row a step of `step` [s]."""
    count = sum(map(len, errors))
    white = np.stack([
        _correlation([e[:, i] for e in errors], [e[:, i] for e in errors])[LAGS + 1 :]
        for i in range(3)
    ])  # fmt: skip
    pairs = [
        _pair(i, [e[:, i] for e in errors], [f[:, i] for f in forces], step, count)
        for i in range(3)
        if max(float(np.ptp(f[:, i])) for f in forces) > 1e-9
    ]
    return Independence(step, count, white, tuple(pairs))


def _pair(i: int, errors: list[Floats], forces: list[Floats], step: float, count: int) -> Pair:
    a = whitening(forces)
    x, e = ([_filtered(a, part) for part in series] for series in (forces, errors))
    rho = _correlation(e, x)
    gain = rho * _size(e) / max(_size(x), 1e-300)
    return Pair(ERRORS[i], NAMES[i], rho, lateness(rho, gain, step, count))


def lateness(rho: Floats, gain: Floats, step: float, count: int) -> float:
    """Correlation and impulse response (2 L + 1,) -> how late the thrust comes [s], 0: it does not.

    Lags 1 … J less their mirror images, J where their sum stands out most; it must be beyond the
    99 % band of the largest of L such sums. Late by the first moment h Σ j (g_j − g_−j), taken on
    to where the response first ends: that of a lag has a tail.
    """
    lags = np.arange(1, LAGS + 1)
    stands_out = rho[LAGS + 1 :] - rho[:LAGS][::-1]
    total = np.cumsum(stands_out) / np.sqrt(2.0 * lags / count)
    J = int(np.argmax(total)) + 1
    largest = float(norm.ppf(0.5 + 0.5 * LEVEL ** (1.0 / LAGS)))
    if total[J - 1] < largest or rho[LAGS] >= 0.0:  # thrust that is late is missed at first
        return 0.0
    J += int(np.argmin(np.append(stands_out[J:], 0.0) > 0.0))
    excess = gain[LAGS + 1 :] - gain[:LAGS][::-1]
    late = step * float(lags[:J] @ excess[:J])
    return late if late > LATE_S else 0.0


def whitening(series: list[Floats]) -> Floats:
    """A(q) = 1 − a₁ q⁻¹ − … (ORDER + 1,) of stretches, by Yule and Walker's equations."""
    R = _covariance(series, series)[LAGS:]
    R[0] = R[0] * (1.0 + 1e-9) + 1e-300
    return np.append(1.0, -solve_toeplitz(R[:ORDER], R[1 : ORDER + 1]))


def _filtered(a: Floats, part: Floats) -> Floats:
    """A(q) applied to one stretch, its start left out."""
    return np.asarray(lfilter(a, [1.0], part)[ORDER:])


def _correlation(e: list[Floats], x: list[Floats]) -> Floats:
    """Lags −L … L of e after x: (2 L + 1,)."""
    return _covariance(e, x) / max(_size(e) * _size(x), 1e-300)


def _covariance(e: list[Floats], x: list[Floats]) -> Floats:
    """Mean of e_k x_{k−j}, j = −L … L, within stretches: (2 L + 1,); mean values taken off."""
    means = [float(np.concatenate(series).mean()) for series in (e, x)]
    total, count = np.zeros(2 * LAGS + 1), sum(map(len, e))
    for one, other in zip(e, x, strict=True):
        full = np.correlate(one - means[0], other - means[1], "full")
        middle = len(other) - 1
        total += full[middle - LAGS : middle + LAGS + 1]
    return total / count


def _size(series: list[Floats]) -> float:
    return float(np.concatenate(series).std())


def _errors(trial: Trial, model: Model, rows: Ints, stride: int) -> Floats:
    """Missing force over one step from rows (K,): M (ν − ν̂) / h, (K, 3)."""
    motion = motion_of(trial)
    x0 = np.hstack([model.true_states(motion[rows]), memory_at(model, trial, rows)])
    runs = runs_from(rows, np.full(len(rows), stride))
    _, reports = model.run(x0, runs, inputs_of(model, trial))
    d = model.vessel.dynamics
    mass = np.array([d.m11, d.m22, d.m33])
    return (trial.nu[rows + stride] - reports[:, stride, 3:6]) * mass / (stride * trial.dt)


def _forces(trial: Trial, model: Model, rows: Ints, stride: int) -> Floats:
    """τ(commands) as the model has it, meaned over the steps from rows (K,): (K, 3)."""
    after = delayed(commands_of(model, trial), trial.dt, model.delay)
    before = np.vstack([after[:1], after[:-1]])
    _, acting = model.missing_force(
        motion_of(trial), trial.time, before, after, voltage=trial.voltage, wind=trial.wind
    )
    return np.mean([acting[rows + j] for j in range(stride)], axis=0)
