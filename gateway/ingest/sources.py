"""One source per quantity: which, and why.

LOCAL_POSITION_NED, GLOBAL_POSITION_INT, VFR_HUD and XKF1 are one and the same filter of the
autopilot, already fed by its GNSS receiver: using two of them counts one piece of knowledge twice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.samples import Quantity, Samples

GAP_S = 2.0  # a longer silence is a gap
COVERAGE = 0.9  # of the best candidate's: below, a source is left out
ENOUGH_HZ = 0.9  # a source this fast is never left out for being slow
SLOWER = 0.5  # of the fastest candidate's rate: below, a source is left out

Q = Quantity
Candidates = tuple[tuple[Quantity, str], ...]

PRIORITY: Mapping[str, Candidates] = {
    "yaw": (
        (Q.YAW, "ATTITUDE"),
        (Q.YAW, "ATTITUDE_QUATERNION"),
        (Q.YAW, "ODOMETRY"),
        (Q.YAW, "ATT"),
        (Q.YAW, "XKF1"),
        (Q.YAW, "NKF1"),
        (Q.YAW, "GLOBAL_POSITION_INT"),
        (Q.YAW, "VFR_HUD"),
        (Q.YAW, "CSV"),
    ),
    "yaw rate": (
        (Q.YAW_RATE, "ATTITUDE"),
        (Q.YAW_RATE, "ATTITUDE_QUATERNION"),
        (Q.YAW_RATE, "ODOMETRY"),
        (Q.YAW_RATE, "IMU"),
        (Q.YAW_RATE, "HIGHRES_IMU"),
        (Q.YAW_RATE, "SCALED_IMU"),
        (Q.YAW_RATE, "RAW_IMU"),
        (Q.YAW_RATE, "SCALED_IMU2"),
        (Q.YAW_RATE, "SCALED_IMU3"),
        (Q.YAW_RATE, "CSV"),
    ),
    "velocity": (
        (Q.VELOCITY, "LOCAL_POSITION_NED"),
        (Q.VELOCITY, "XKF1"),
        (Q.VELOCITY, "NKF1"),
        (Q.VELOCITY, "GLOBAL_POSITION_INT"),
        (Q.BODY_VELOCITY, "ODOMETRY"),
        (Q.VELOCITY, "ODOMETRY"),
        (Q.VELOCITY, "GPS_RAW_INT"),
        (Q.VELOCITY, "GPS"),
        (Q.VELOCITY, "VFR_HUD"),
        (Q.BODY_VELOCITY, "CSV"),
        (Q.VELOCITY, "CSV"),
    ),
    "position": (
        (Q.POSITION, "LOCAL_POSITION_NED"),
        (Q.POSITION, "XKF1"),
        (Q.POSITION, "NKF1"),
        (Q.GLOBAL_POSITION, "GLOBAL_POSITION_INT"),
        (Q.POSITION, "ODOMETRY"),
        (Q.GLOBAL_POSITION, "GPS_RAW_INT"),
        (Q.GLOBAL_POSITION, "GPS"),
        (Q.GLOBAL_POSITION, "CSV"),
        (Q.POSITION, "CSV"),
    ),
    "commands": (
        (Q.ACTUATORS, "SERVO_OUTPUT_RAW"),
        (Q.ACTUATORS, "ACTUATOR_OUTPUT_STATUS"),
        (Q.ACTUATORS, "RCOU"),
        (Q.ACTUATORS, "CSV"),
    ),
    "armed": ((Q.ARMED, "HEARTBEAT"), (Q.ARMED, "ARM"), (Q.ARMED, "EV"), (Q.ARMED, "CSV")),
    "fix": ((Q.FIX, "GPS_RAW_INT"), (Q.FIX, "GPS")),
    "voltage": (
        (Q.VOLTAGE, "SYS_STATUS"),
        (Q.VOLTAGE, "BATTERY_STATUS"),
        (Q.VOLTAGE, "BAT"),
        (Q.VOLTAGE, "CURR"),
        (Q.VOLTAGE, "CSV"),
    ),
    "wind": ((Q.WIND, "WIND"), (Q.WIND, "WIND_COV"), (Q.WIND, "CSV")),
    "origin": ((Q.ORIGIN, "GPS_GLOBAL_ORIGIN"), (Q.ORIGIN, "ORGN")),
}
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
    refused: list[str] = []
    for part, covered, rate in zip(present, cover, rates, strict=True):
        because = _refusal(name, covered, max(cover), rate, max(rates))
        if because is None:
            return _explained(name, part, refused)
        refused.append(f"{part.source} {because}")
    return _explained(name, present[int(np.argmax(cover))], refused)


def _refusal(name: str, covered: float, best: float, rate: float, fastest: float) -> str | None:
    if name in ON_CHANGE:
        return None
    if covered < COVERAGE * best:
        return f"covers {covered:.0f} s of {best:.0f} s"
    if rate < min(ENOUGH_HZ, SLOWER * fastest):
        return f"comes at {rate:.1f} Hz only"
    return None


def _explained(name: str, samples: Samples, refused: Sequence[str]) -> Choice:
    steps = intervals(samples)
    why = "; ".join(refused) if refused else "preferred"
    longest = float(steps.max()) if len(steps) else 0.0
    return Choice(name, samples, rate_hz(samples), longest, why)
