"""One source per quantity: the choice, with its reason.

LOCAL_POSITION_NED, GLOBAL_POSITION_INT, VFR_HUD and XKF1 are one and the same filter of the
autopilot, already fed by its GNSS receiver: using two of them counts one piece of knowledge twice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.samples import Quantity, Samples

# Chosen, not measured.
GAP_S = 2.0  # s: a longer silence is a gap
COVERAGE = 0.9  # share of the best candidate's time: below, a source is left out
ENOUGH_HZ = 0.9  # a source this fast is never left out for being slow
SLOWER = 0.5  # share of the fastest candidate's rate: below, a source is left out

Candidates = tuple[tuple[Quantity, str], ...]


def _candidates(quantity: Quantity, *sources: str) -> Candidates:
    return tuple((quantity, source) for source in sources)


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
    "fix": _candidates(Quantity.FIX, "GPS_RAW_INT", "GPS"),
    "estimator": _candidates(Quantity.ESTIMATOR, "EKF_STATUS_REPORT", "ESTIMATOR_STATUS"),
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
    return chosen


def rate_hz(samples: Samples) -> float:
    """Samples per second while they come: gaps do not count; 0 for fewer than two."""
    steps = intervals(samples)
    return 1.0 / float(np.median(steps)) if len(steps) else 0.0


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
