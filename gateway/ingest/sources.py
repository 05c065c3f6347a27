"""One source per quantity: the choice with its reason, and how good a source is from its values.

LOCAL_POSITION_NED, GLOBAL_POSITION_INT, VFR_HUD and XKF1 are one and the same filter of the
autopilot, already fed by its GNSS receiver: using two of them counts one piece of knowledge twice.

**White errors.** The standard deviation of the fourth difference of white errors is √70 σ. Motion
of a boat has hardly any fourth difference over a few tenths of a second; its hardest accelerations
are second differences over a little longer.

**Rates that were smoothed towards both sides** are found by the values that they are the rates of:

    B(f) = S(reported, differentiated) / S(reported, reported)

Both are means over `STEP_S`; S are their cross- and power spectrum. Without smoothing B = 1; errors
of the reported rate make B smaller, those of the values leave it. A filter that only looks back, a
first-order lag 1/(1 + j2πfτ) or a delay, leaves Re B at 1 or below: what it takes in size it takes
in phase. A window that looks both ways takes in size alone: Re B rises above 1, also if the two are
some hundredths of a second apart, B e^{j2πfs}. Such a rate shows motion before its cause: an
actuator's lag found from it is too short, or negative.

**Accelerations that hold gravity** do not agree with the change of speed:

    a = u̇ − r v + g sin θ      reported ahead      (to starboard: v̇ + r u − g sin φ)

A bow that rises by 10° under full throttle adds 1.7 m/s². Compared are means over a second or two.
Source: Fossen 2021, §14.4 (what an accelerometer measures).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.samples import Quantity, Samples
from sim.state import Floats

# Chosen, not measured.
GAP_S = 2.0  # s: a longer silence is a gap
GAP_STEPS = 3.0  # a step that is longer than so many usual ones is a gap
COVERAGE = 0.9  # share of the best candidate's time: below, a source is left out
ENOUGH_HZ = 0.9  # a source this fast is never left out for being slow
SLOWER = 0.5  # share of the fastest candidate's rate: below, a source is left out

Candidates = tuple[tuple[Quantity, str], ...]


def _candidates(quantity: Quantity, *sources: str) -> Candidates:
    return tuple((quantity, source) for source in sources)


# Velocities that an autopilot's filter made of position, acceleration and rates.
OF_A_FILTER = frozenset({"LOCAL_POSITION_NED", "XKF1", "NKF1", "GLOBAL_POSITION_INT"})


# name of what is chosen -> quantity and source, the best first. A format with other names for its
# messages declares by `Rule.equivalent` which of these each stands for.
PRIORITY: Mapping[str, Candidates] = {
    "yaw": _candidates(
        Quantity.YAW, "ATTITUDE", "ATTITUDE_QUATERNION", "ODOMETRY", "ATT", "XKF1", "NKF1",
        "GLOBAL_POSITION_INT", "VFR_HUD", "CSV",
    ),
    "yaw rate": _candidates(
        Quantity.YAW_RATE, "ATTITUDE", "ATTITUDE_QUATERNION", "ODOMETRY", "IMU", "HIGHRES_IMU",
        "SCALED_IMU", "RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "CSV",
    ),
    "velocity": (
        *_candidates(
            Quantity.VELOCITY, "LOCAL_POSITION_NED", "XKF1", "NKF1", "GLOBAL_POSITION_INT"
        ),
        *_candidates(Quantity.BODY_VELOCITY, "ODOMETRY"),
        *_candidates(Quantity.VELOCITY, "ODOMETRY", "GPS_RAW_INT", "GPS", "VFR_HUD"),
        *_candidates(Quantity.BODY_VELOCITY, "CSV"),
        *_candidates(Quantity.VELOCITY, "CSV"),
    ),
    "position": (
        *_candidates(Quantity.POSITION, "LOCAL_POSITION_NED", "XKF1", "NKF1"),
        *_candidates(Quantity.GLOBAL_POSITION, "GLOBAL_POSITION_INT"),
        *_candidates(Quantity.POSITION, "ODOMETRY"),
        *_candidates(Quantity.GLOBAL_POSITION, "GPS_RAW_INT", "GPS", "CSV"),
        *_candidates(Quantity.POSITION, "CSV"),
    ),
    "commands": _candidates(
        Quantity.ACTUATORS, "SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS", "RCOU", "CSV"
    ),
    "armed": _candidates(Quantity.ARMED, "HEARTBEAT", "ARM", "EV", "CSV"),
    "fix": _candidates(Quantity.FIX, "GPS_RAW_INT", "GPS", "GPS2_RAW"),
    "estimator": _candidates(
        Quantity.ESTIMATOR, "EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "XKF4", "NKF4"
    ),
    "voltage": _candidates(
        Quantity.VOLTAGE, "SYS_STATUS", "BATTERY_STATUS", "BAT", "CURR", "CSV"
    ),
    "wind": _candidates(Quantity.WIND, "WIND", "WIND_COV", "CSV"),
    "origin": _candidates(Quantity.ORIGIN, "GPS_GLOBAL_ORIGIN", "ORGN"),
}  # fmt: skip
ON_CHANGE = ("armed", "origin")  # sent when something happens: rate and gaps mean nothing


@dataclass(frozen=True)
class Choice:
    """The source of one quantity."""

    name: str  # "velocity", …: a key of `PRIORITY`
    samples: Samples
    rate_hz: float
    longest_gap_s: float
    why: str

    @property
    def source(self) -> str:
        """The message that was chosen."""
        return self.samples.source

    @property
    def of_a_filter(self) -> bool:
        """Whether an autopilot's filter made it, whatever the format calls the message."""
        return self.samples.equivalent in OF_A_FILTER


def choose(samples: Sequence[Samples]) -> Mapping[str, Choice]:
    """Samples of one boat -> the source of each quantity that has one."""
    by_source: dict[tuple[Quantity, str], Samples] = {}
    for part in samples:  # of several ports of one message, the first
        if len(part):
            by_source.setdefault((part.quantity, part.equivalent), part)
    chosen = {}
    for name, candidates in PRIORITY.items():
        present = [by_source[key] for key in candidates if key in by_source]
        if present:
            chosen[name] = _choice(name, present)
    if "fix" in chosen:
        receivers = [part for part in samples if part.quantity is Quantity.FIX and len(part)]
        chosen["fix"] = replace(chosen["fix"], samples=best_fix(chosen["fix"].samples, receivers))
    return chosen


def best_fix(chosen: Samples, receivers: Sequence[Samples]) -> Samples:
    """The best fix of all receivers of a boat, at each message of any, under the name of one: her
    filter takes the position from whichever has it.
    """
    if len(receivers) < 2:
        return chosen
    order = np.concatenate([part.order for part in receivers])
    rows = np.argsort(order, kind="stable")
    order = order[rows]
    best = np.full(len(order), -np.inf)
    for part in receivers:
        known = np.argsort(part.order, kind="stable")
        last = np.searchsorted(part.order[known], order, side="right") - 1
        fix = part.values[known, 0][np.maximum(last, 0)]
        best = np.maximum(best, np.where(last >= 0, fix, -np.inf))
    vehicle, receive = (
        np.concatenate([getattr(part, name) for part in receivers])[rows]
        for name in ("vehicle_time_ns", "receive_time_ns")
    )
    return replace(
        chosen, order=order, vehicle_time_ns=vehicle, receive_time_ns=receive,
        values=best[:, None],
    )  # fmt: skip


def rate_hz(samples: Samples) -> float:
    """Samples per second while they come: gaps do not count; 0 for fewer than two."""
    steps = intervals(samples)
    if not len(steps):
        return 0.0
    # The mean: an autopilot sends at 40 Hz what it samples at 50, 20, 20, 20 and 40 ms apart.
    return 1.0 / float(steps[steps <= GAP_STEPS * np.median(steps)].mean())


def intervals(samples: Samples) -> NDArray[np.float64]:
    """Times between successive samples, ordered by the boat's clock [s]: (K − 1,)."""
    nanoseconds = np.sort(samples.vehicle_time_ns)
    steps = np.asarray(nanoseconds[1:] - nanoseconds[:-1], np.float64) * 1e-9
    return np.asarray(steps[steps > 0.0])


def covered_s(samples: Samples) -> float:
    """Time without gaps [s]."""
    steps = intervals(samples)
    return float(steps[steps <= GAP_S].sum())


def _choice(name: str, present: Sequence[Samples]) -> Choice:
    """The first candidate that is neither full of gaps nor slow beside the others."""
    cover = [covered_s(part) for part in present]
    rates = [rate_hz(part) for part in present]
    refusals: list[str] = []
    for part, covered, rate in zip(present, cover, rates, strict=True):
        reason = _refusal(name, covered, max(cover), rate, max(rates))
        if reason is None:
            return _explained(name, part, refusals)
        refusals.append(f"{part.source} {reason}")
    return _explained(name, present[int(np.argmax(cover))], refusals)


def _refusal(name: str, covered: float, best: float, rate: float, fastest: float) -> str | None:
    if name in ON_CHANGE:
        return None
    if covered < COVERAGE * best:
        return f"covers {covered:.0f} s of {best:.0f} s"
    if rate < min(ENOUGH_HZ, SLOWER * fastest):
        return f"comes at {rate:.1f} Hz only"
    return None


def _explained(name: str, samples: Samples, refusals: Sequence[str]) -> Choice:
    steps = intervals(samples)
    why = "; ".join(refusals) if refusals else "preferred"
    longest = float(steps.max()) if len(steps) else 0.0
    return Choice(name, samples, rate_hz(samples), longest, why)


# Thresholds are chosen, not measured. With those of the smoothing the rates of the lake's tables
# are found, and lagged, late or noisy ones are not: tests/gateway/ingest/test_traps.py.
CLIP = 4.0  # medians of a fourth difference: a jump is no noise
SAFE = 2.0  # factor on σ: errors are not quite white
LONGEST_S = 1e6  # s, 12 days: no recording is longer
SPAN_S = 0.4  # s, of a second difference
HARD = 0.99  # share of accelerations below the hardest, which are two standard deviations


def estimated_white_std(values: Floats, smallest: float) -> float:
    """Values (K, n) -> σ, not below `smallest` nor a step of their resolution over √12."""
    if len(values) < 10:
        return smallest
    fourth = np.abs(np.diff(values, n=4, axis=0)) / np.sqrt(70.0)
    usual = np.median(fourth, axis=0)
    rough = np.sqrt(np.mean(np.minimum(fourth, CLIP * np.maximum(usual, 1e-12)) ** 2, axis=0))
    steps = np.abs(np.diff(values, axis=0))
    moved = steps[steps > 0.0]
    finest = float(np.quantile(moved, 0.01)) if len(moved) else 0.0
    return float(max(SAFE * rough.max(), finest / np.sqrt(12.0), smallest))


def uniform_grid(start: float, end: float, step: float) -> Floats:
    """Times (T,) [s] from start on, before the end; none where the span is a damaged time."""
    return np.arange(start, end if end - start < LONGEST_S else start, step, dtype=np.float64)


def acceleration_std(time: Floats, values: Floats) -> float:
    """Times (K,) [s], values (K, n) -> standard deviation of their second derivative."""
    grid = uniform_grid(float(time[0]), float(time[-1]), SPAN_S)
    if len(grid) < 10:
        return 0.0
    path = np.stack([np.interp(grid, time, values[:, i]) for i in range(values.shape[1])], axis=1)
    change = np.linalg.norm(np.diff(path, n=2, axis=0), axis=1) / SPAN_S**2
    return float(0.5 * np.quantile(change, HARD))


Complex = NDArray[np.complex128]

STEP_S = 0.2
PIECE = 50  # means in a piece of time that is transformed, half of it shared with the next
FEWEST = 5  # pieces
BANDS_HZ = (0.15, 0.35, 0.55, 0.75, 0.95, 1.25, 1.75)
ABOVE = 1.05  # of Re B
APART_S = 0.06  # s: rate and values may be apart by so much either way
SURE = 3.0  # standard deviations from piece to piece
SPREAD = 0.02  # of Re B, that all have: few pieces may agree by chance


class Smoothing(NamedTuple):
    """Whether a rate was smoothed to both sides, and the frequency [Hz] from which on it shows."""

    found: bool
    from_hz: float

    @property
    def window_s(self) -> float:
        """About the length of a window that takes that away [s]."""
        return 1.0 / self.from_hz


NOT_SMOOTHED = Smoothing(False, np.inf)


def smoothing(time: Floats, x: Floats, rate_time: Floats, rate: Floats) -> Smoothing:
    """Values (K, n) at times (K,), rates (L, n) at (L,) [s], ascending, one frame -> smoothing.

    Its frequency is that of the lowest band in which B shows it.
    """
    start, end = max(time[0], rate_time[0]), min(time[-1], rate_time[-1])
    edges = uniform_grid(float(start), float(end), STEP_S)
    columns = range(x.shape[1])
    if len(edges) <= PIECE:
        return NOT_SMOOTHED
    moved = np.stack([np.interp(edges, time, x[:, i]) for i in columns], axis=1)
    total = np.stack([_integral(rate_time, rate[:, i], edges) for i in columns], axis=1)
    true, reported = (_spectra(np.diff(path, axis=0) / STEP_S) for path in (moved, total))
    if len(true) < FEWEST:
        return NOT_SMOOTHED
    frequency = np.asarray(np.fft.rfftfreq(PIECE, STEP_S), np.float64)
    cross = (np.conj(reported) * true).sum(axis=1)
    own = (np.abs(reported) ** 2).sum(axis=1)
    for low, high in pairwise(BANDS_HZ):
        inside = (frequency >= low) & (frequency < high)
        if all(_above(cross, own, frequency, inside, apart) for apart in (-APART_S, 0.0, APART_S)):
            return Smoothing(True, low)
    return NOT_SMOOTHED


def _spectra(rows: Floats) -> Complex:
    """Means (M, n) -> transforms (pieces, n, frequencies) of what moves within each piece."""
    starts = range(0, len(rows) - PIECE + 1, PIECE // 2)
    pieces = np.stack([rows[k : k + PIECE].T for k in starts])
    return np.fft.rfft((pieces - pieces.mean(axis=-1, keepdims=True)) * np.hanning(PIECE))


def _above(
    cross: Complex, own: Floats, frequency: Floats, inside: NDArray[np.bool_], apart: float
) -> bool:
    """Spectra (pieces, frequencies), a band, s [s] -> Re B is surely above 1 there."""
    shared = np.real(cross * np.exp(2j * np.pi * frequency * apart))
    b, std = _ratio(shared[:, inside].sum(axis=1), own[:, inside].sum(axis=1))
    return b - ABOVE > SURE * std


def _ratio(above: Floats, below: Floats) -> tuple[float, float]:
    """Sums (pieces,) -> their ratio and its standard deviation (jackknife)."""
    if not below.sum() > 0.0:
        return 1.0, np.inf
    without = (above.sum() - above) / np.maximum(below.sum() - below, 1e-300)
    share = (len(above) - 1) / len(above)
    std = np.sqrt(share * np.sum((without - without.mean()) ** 2))
    return float(above.sum() / below.sum()), float(np.hypot(std, SPREAD))


def _integral(time: Floats, values: Floats, at: Floats) -> Floats:
    """Integral of values (L,) between their times, at moments (T,)."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    return np.interp(at, time, np.concatenate([[0.0], np.cumsum(steps)]))


MEAN_S = 1.0  # means over so long are compared
SLOPE = 0.25  # that the slope may be off by
BIAS = 0.15  # m/s², that the mean may be off by
MOVES = 0.05  # m/s²: smaller accelerations are not compared


class Agreement(NamedTuple):
    """How an acceleration follows the change of speed: both would be 1 and 0."""

    slope: float
    bias: float  # m/s²

    @property
    def good(self) -> bool:
        """Whether the two differ by no more than a sensor's own scale error and bias."""
        return abs(self.slope - 1.0) <= SLOPE and abs(self.bias) <= BIAS


def acceleration_agreement(time: Floats, reported: Floats, expected: Floats) -> Agreement | None:
    """Accelerations (K,) [m/s²] on a grid (K,) [s] -> agreement; None: nothing moves."""
    rows = max(round(MEAN_S / float(np.median(np.diff(time)))), 1)
    count = len(time) // rows * rows
    a, b = (x[:count].reshape(-1, rows).mean(axis=1) for x in (reported, expected))
    if len(a) < 10 or np.std(b) < MOVES:
        return None
    about = b - b.mean()
    return Agreement(float(about @ a / (about @ about)), float(np.mean(a - b)))
