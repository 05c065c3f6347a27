"""Do the model's errors follow its inputs? Whiteness, and correlation with the commanded forces.

    ε_k = M (ν − ν̂)_k / h,     ν̂_k predicted over one step h from the estimate one step before
    R_ετ(j) = mean of ε_k τ_{k−j},     |ρ(j)| < 2.58 / √N for 99 % of independent series

Steps do not overlap. τ is made white by an autoregressive filter A(q) first, and ε goes through
the same one: ρ is then the shape of the impulse response from commanded to missing force, and
under independence its variance is 1/N whatever the colour of ε. Thrust that comes d late gives
τ(t − d) − τ(t): a trough at lag 0 and a peak at d. Thrust of another size, g times the model's,
gives g τ(t − d) − τ(t): how late it comes is counted in units of g τ. A smoother that blurs fast
motion gives peaks on both sides of 0: what counts is a lag's excess over its mirror image.
Correlation at negative lags alone is feedback, an autopilot that answers what the model lacks: no
fault of the model.
Valid for: commands that come faster than the lateness in question. Source: Ljung, System
Identification, 2nd ed. 1999, §16.6 (residual analysis) and §6.1 (prewhitening).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.special import ndtri

from sim.effects.catalogue import explaining
from sim.effects.effect import Symptom
from sim.model import Model
from sim.prediction import commands_around, forces_along
from sim.prediction.free_runs import free_reports
from sim.prediction.segments import usable_stretches
from sim.state import Floats, Ints
from sim.trial import Trial

# All chosen, not measured; the tests hold delays of 0.2 to 1 s found and none in twenty noises.
MAX_LAG = 25  # L, steps to either side of 0
STEP_S = 0.1  # h, or the trial's own step if that is longer
FILTER_ORDER = 8  # of the whitening filter
CONFIDENCE = 0.99  # of the band, and that a delay is no chance
MIN_DELAY_S = STEP_S  # streams may be apart by half a step without anything being late
TIMED = ("yaw", "yaw rate", "velocity", "commands")  # of `Trial.rates_hz`
MIN_GAIN = 0.25  # of the boat's thrust over the model's: of less it cannot be told when it comes
MIN_STEPS = 20 * MAX_LAG
FORCES = ("thrust ahead", "thrust to starboard", "turning moment")
ERRORS = ("u", "v", "r")


@dataclass(frozen=True)
class CrossCorrelation:
    """Correlation (2 L + 1,) of one error with one input, at lags −L … L; delay [s], 0: none."""

    error: str
    input: str
    correlation: Floats
    delay: float


@dataclass(frozen=True)
class Independence:
    """step [s], count of steps; autocorrelation (3, L) of the errors at lags 1 … L."""

    step: float
    count: int
    autocorrelation: Floats
    pairs: tuple[CrossCorrelation, ...]

    @property
    def band(self) -> float:
        """Largest correlation (absolute) of 99 % of independent series."""
        return self.band_at(CONFIDENCE)

    def band_at(self, confidence: float) -> float:
        """Largest correlation (absolute) of that share of independent series."""
        return float(ndtri(0.5 + 0.5 * confidence)) / max(self.count, 1) ** 0.5

    @property
    def description(self) -> str:
        """Which errors follow an input, in words; empty where none does."""
        late = [pair for pair in self.pairs if pair.delay > 0.0]
        if not late:
            return ""
        by = ", ".join(f"{p.delay:.2g} s ({p.error} after {p.input})" for p in late)
        told = (
            f"errors follow the commands by {by}: a delay or lag is missing, or a time constant of "
            "the hull (inertia over damping) is off"
        )
        if any(pair.error == "r" for pair in late):
            return told
        # thrust that is late would turn the boat late; a gyro is in time where a receiver is not
        return f"{told}, or reported velocities come late ({explaining(Symptom.LATE_VELOCITY)})"

    def to_dict(self) -> dict[str, Any]:
        """For JSON: no nulls, no NaN."""
        outside = (np.abs(self.autocorrelation) > self.band).mean(axis=1)
        return {
            "step_s": self.step,
            "steps": self.count,
            "band": self.band,
            "says": self.description,
            "not_white": dict(zip(ERRORS, outside.tolist(), strict=True)),
            "correlations": [
                {"error": p.error, "input": p.input, "late_s": p.delay,
                 "correlation": p.correlation.tolist()}
                for p in self.pairs
            ],
        }  # fmt: skip


def independence(trial: Trial, model: Model) -> Independence | None:
    """Errors over one step against the commanded forces.

    None where there is too little time, or where the model gives no finite number over a step.
    """
    stride = max(round(STEP_S / trial.dt), 1)
    parts = [
        np.arange(s.start, s.stop - stride, stride)
        for s in usable_stretches(trial.usable)
        if len(s) > 4 * MAX_LAG * stride
    ]
    if sum(map(len, parts)) < MIN_STEPS:
        return None
    rows = np.concatenate(parts)
    errors, forces = _errors(trial, model, rows, stride), _forces(trial, model, rows, stride)
    if not (np.isfinite(errors).all() and np.isfinite(forces).all()):
        return None
    ends = np.cumsum([len(part) for part in parts])[:-1]
    step, rates = stride * trial.dt, [trial.rates_hz.get(name, 0.0) for name in TIMED]
    apart = max((1.0 / rate for rate in rates if rate > 0.0), default=step)
    return independence_of(np.split(errors, ends), np.split(forces, ends), step, apart)


def independence_of(
    errors: list[Floats], forces: list[Floats], step: float, apart: float = 0.0
) -> Independence:
    """Stretches of errors (n, 3) and forces (n, 3) [N, N, N m], one row a step of `step` [s].

    `apart` [s]: between reports of the boat; what comes within that may be how they were joined.
    """
    count = sum(map(len, errors))
    each = [[e[:, i] for e in errors] for i in range(3)]
    autocorrelation = np.stack([_correlation(e, e)[MAX_LAG + 1 :] for e in each])
    pairs = [
        _pair(i, each[i], [f[:, i] for f in forces], step, count, apart)
        for i in range(3)
        if max(float(np.ptp(f[:, i])) for f in forces) > 1e-9
    ]
    return Independence(step, count, autocorrelation, tuple(pairs))


def _pair(
    i: int, errors: list[Floats], forces: list[Floats], step: float, count: int, apart: float
) -> CrossCorrelation:
    a = whitening_filter(forces)
    x, e = (  # the filter's start is left out
        [np.convolve(part, a, "valid") for part in series] for series in (forces, errors)
    )
    rho = _correlation(e, x)
    gain = rho * _std(e) / max(_std(x), 1e-300)
    return CrossCorrelation(ERRORS[i], FORCES[i], rho, _delay(rho, gain, step, count, apart))


def _delay(rho: Floats, gain: Floats, step: float, count: int, apart: float) -> float:
    """Correlation, impulse response (2 L + 1,) -> how late the thrust comes [s], 0: it does not.

    Lags 1 … J less their mirror images, J where their sum stands out most; it must be beyond the
    99 % band of the largest of L such sums. Late by h Σ j (g_j − g_−j) / g, the first moment, taken
    on to where the response first ends: that of a lag has a tail. g = 1 + Σ g_j, j = −J … J, is the
    boat's own thrust over the model's: what the model has and what the boat lacks of it.
    """
    lags = np.arange(1, MAX_LAG + 1)
    excess = rho[MAX_LAG + 1 :] - rho[:MAX_LAG][::-1]
    total = np.cumsum(excess) / np.sqrt(2.0 * lags / count)
    J = int(np.argmax(total)) + 1
    largest = float(ndtri(0.5 + 0.5 * CONFIDENCE ** (1.0 / MAX_LAG)))
    if total[J - 1] < largest or rho[MAX_LAG] >= 0.0:  # thrust that is late is missed at first
        return 0.0
    if J * step < apart:
        return 0.0
    J += int(np.argmin(np.append(excess[J:], 0.0) > 0.0))
    response = gain[MAX_LAG + 1 :] - gain[:MAX_LAG][::-1]
    thrust = 1.0 + float(gain[MAX_LAG - J : MAX_LAG + J + 1].sum())
    if thrust < MIN_GAIN:  # hardly any, or reversed
        return 0.0
    delay = step * float(lags[:J] @ response[:J]) / thrust
    return delay if delay > max(MIN_DELAY_S, apart) else 0.0


def whitening_filter(series: list[Floats]) -> Floats:
    """A(q) = 1 − a₁ q⁻¹ − … (order + 1,) of stretches, by Yule and Walker's equations."""
    R = _covariance(series, series)[MAX_LAG:]
    R[0] = R[0] * (1.0 + 1e-9) + 1e-300
    return np.append(1.0, -solve_toeplitz(R[:FILTER_ORDER], R[1 : FILTER_ORDER + 1]))


def _correlation(e: list[Floats], x: list[Floats]) -> Floats:
    """Lags −L … L of e after x: (2 L + 1,)."""
    return _covariance(e, x) / max(_std(e) * _std(x), 1e-300)


def _covariance(e: list[Floats], x: list[Floats]) -> Floats:
    """Mean of e_k x_{k−j}, j = −L … L, within stretches: (2 L + 1,); mean values taken off."""
    means = [float(np.concatenate(series).mean()) for series in (e, x)]
    total, count = np.zeros(2 * MAX_LAG + 1), sum(map(len, e))
    for one, other in zip(e, x, strict=True):
        full = np.correlate(one - means[0], other - means[1], "full")
        middle = len(other) - 1
        total += full[middle - MAX_LAG : middle + MAX_LAG + 1]
    return total / count


def _std(series: list[Floats]) -> float:
    return float(np.concatenate(series).std())


def _errors(trial: Trial, model: Model, rows: Ints, stride: int) -> Floats:
    """Missing force over one step from rows (K,): M (ν − ν̂) / h, (K, 3)."""
    reports = free_reports(trial, model, rows, np.full(len(rows), stride))
    d = model.vessel.dynamics
    mass = np.array([d.m11, d.m22, d.m33])
    return (trial.nu[rows + stride] - reports[:, stride, 3:6]) * mass / (stride * trial.dt)


def _forces(trial: Trial, model: Model, rows: Ints, stride: int) -> Floats:
    """τ(commands) of the model, means over the steps from rows (K,): (K, 3)."""
    _, acting = forces_along(trial, model, *commands_around(model, trial))
    return np.mean([acting[rows + j] for j in range(stride)], axis=0)
