"""Faults of a simulated boat's sensors: what an autopilot then reports. Times: seconds since start.

Without GPS the autopilot's filter reckons on: its velocity drifts away, and after some seconds it
says that it has no position. Without position it holds its place: velocity zero. A compass that is
off turns the heading; the gyro knows nothing of it. What is frozen is sent on with new time stamps.
"""

from dataclasses import dataclass
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.simulated_boat.hull import SensedValues

DRIFT_MPS2, MAX_DRIFT_MPS = 0.04, 1.0  # of the velocity that is reckoned without GPS
RECKONS_S = 10.0  # so long the autopilot's filter trusts that
WELL = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_POS_VERT_ABS
)  # fmt: skip
HOLDS = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_CONST_POS_MODE
FROZEN = {
    "heading": ("yaw",),
    "turn": ("yaw_rate",),
    "velocity": ("north_mps", "east_mps"),
    "position": ("north", "east"),
}


class Span(NamedTuple):
    """A stretch of time, from one moment to another [s]."""

    from_s: float
    to_s: float

    def has(self, time_s: float) -> bool:
        """Is that moment inside?"""
        return self.from_s <= time_s < self.to_s


class CompassError(NamedTuple):
    """The heading is off by `angle` [rad] for a span."""

    span: Span
    angle: float


class Frozen(NamedTuple):
    """One of `FROZEN` keeps its value for a span."""

    what: str
    span: Span


@dataclass(frozen=True)
class SensorFaults:
    """All faults of one voyage; none by default."""

    gps_lost: tuple[Span, ...] = ()
    ekf_holds: tuple[Span, ...] = ()
    compass: tuple[CompassError, ...] = ()
    frozen: tuple[Frozen, ...] = ()

    def __post_init__(self) -> None:
        for one in self.frozen:
            if one.what not in FROZEN:
                raise BadInput(f"frozen = {one.what!r}: expected one of {', '.join(FROZEN)}")

    def fix(self, time_s: float) -> int:
        """GNSS fix type."""
        lost = any(span.has(time_s) for span in self.gps_lost)
        return int(mavlink.GPS_FIX_TYPE_NO_FIX if lost else mavlink.GPS_FIX_TYPE_3D_FIX)

    def ekf_flags(self, time_s: float) -> int:
        """What the autopilot's filter says that it has."""
        reckoned = (Span(s.from_s + RECKONS_S, s.to_s) for s in self.gps_lost)
        lost = any(span.has(time_s) for span in (*self.ekf_holds, *reckoned))
        return int(HOLDS if lost else WELL)

    def reported(
        self, sensed: SensedValues, held: dict[str, SensedValues], time_s: float
    ) -> tuple[SensedValues, dict[str, SensedValues]]:
        """What is sensed -> what is reported, and what is held of it while it is frozen."""
        for span in self.gps_lost:
            if span.has(time_s):
                seconds = time_s - span.from_s
                drift = min(DRIFT_MPS2 * seconds, MAX_DRIFT_MPS)
                north = sensed.north + 0.5 * drift * seconds
                sensed = sensed._replace(north=north, north_mps=sensed.north_mps + drift)
        if any(span.has(time_s) for span in self.ekf_holds):
            sensed = sensed._replace(north_mps=0.0, east_mps=0.0)
        for error in self.compass:
            if error.span.has(time_s):
                sensed = sensed._replace(yaw=sensed.yaw + error.angle)
        kept = {}
        for one in self.frozen:
            if one.span.has(time_s):
                kept[one.what] = held.get(one.what, sensed)
                names = FROZEN[one.what]
                sensed = sensed._replace(**{n: getattr(kept[one.what], n) for n in names})
        return sensed, kept
