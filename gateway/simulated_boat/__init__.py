"""A vessel as a MAVLink boat without a boat: for `shadow simulate --live`, tests and benchmarks.

Here: what a user or a test may choose about it, and the faults of its link. Times are seconds since
the start. Between boat and listener frames are lost, doubled, late or held back. Pure.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

from numpy.random import Generator

from gateway.errors import BadInput
from gateway.simulated_boat.telemetry import MESSAGES, SensorFaults

LATE_FROM_S, LATE_TO_S = 0.02, 0.25  # delay of a frame that others overtake
DUPLICATE_WITHIN_S = 0.1


@dataclass(frozen=True)
class Reboot:
    """The autopilot restarts: clock to zero, rates forgotten, a new local origin."""

    at_s: float
    down_s: float = 2.0  # nothing is sent for so long


@dataclass(frozen=True)
class Silence:
    """The link is down: what is sent is lost."""

    from_s: float
    to_s: float


@dataclass(frozen=True)
class Burst:
    """The link stalls, then delivers what has waited at `factor` times the usual rate.

    At `to_s` it is up to date again: everything of from_s … to_s arrives in the last
    1 / factor of that span.
    """

    from_s: float
    to_s: float
    factor: float = 10.0

    def __post_init__(self) -> None:
        if not self.factor >= 1.0:
            raise BadInput(f"factor of a burst = {self.factor}: expected 1 or more")

    def arrival(self, time_s: float) -> float:
        """When a frame sent at that moment arrives [s]."""
        if not self.from_s <= time_s < self.to_s:
            return time_s
        return self.to_s - (self.to_s - time_s) / self.factor


@dataclass(frozen=True)
class Faults:
    """All faults; none by default. Shares are of all frames, 0 … 1."""

    reboots: tuple[Reboot, ...] = ()
    silences: tuple[Silence, ...] = ()
    bursts: tuple[Burst, ...] = ()
    loss: float = 0.0
    duplicates: float = 0.0
    reordered: float = 0.0
    nonsense: float = 0.0  # NaN or absurd values in one field

    def __post_init__(self) -> None:
        for entry in fields(self):
            share = getattr(self, entry.name)
            if isinstance(share, float | int) and not 0.0 <= share <= 1.0:
                raise BadInput(f"share of {entry.name} = {share}: expected 0 … 1")
        moments = [reboot.at_s for reboot in self.reboots]
        if moments != sorted(moments):
            raise BadInput("reboots are listed in the order in which they happen")


class TimedFrame(NamedTuple):
    """One MAVLink frame: its arrival [s since the start], the boat's clock, its sender."""

    time_s: float
    boot_s: float
    system: int
    data: bytes


@dataclass(frozen=True)
class FaultyLink:
    """A link with faults. Its state: the frames on their way, by time of arrival."""

    faults: Faults

    def deliver(
        self,
        waiting: tuple[TimedFrame, ...],
        sent: Iterable[TimedFrame],
        until_s: float,
        rng: Generator,
    ) -> tuple[tuple[TimedFrame, ...], list[TimedFrame]]:
        """Frames on their way and new ones -> those still on their way, those that arrive."""
        delayed = [copy for frame in sent for copy in self._arrivals(frame, rng)]
        frames = sorted([*waiting, *delayed], key=lambda frame: frame.time_s)
        arrived = sum(frame.time_s <= until_s for frame in frames)
        return tuple(frames[arrived:]), frames[:arrived]

    def _arrivals(self, frame: TimedFrame, rng: Generator) -> Iterator[TimedFrame]:
        """None, one or two copies of a frame, with their times of arrival."""
        f, time = self.faults, frame.time_s
        lost, doubled, late = (
            (rng.random(3) < (f.loss, f.duplicates, f.reordered)).tolist()
            if f.loss or f.duplicates or f.reordered
            else (False, False, False)
        )
        if lost or any(gap.from_s <= time < gap.to_s for gap in f.silences):
            return
        for burst in f.bursts:
            time = burst.arrival(time)
        time += rng.uniform(LATE_FROM_S, LATE_TO_S) if late else 0.0
        yield frame._replace(time_s=time)
        if doubled:
            yield frame._replace(time_s=time + rng.uniform(0.0, DUPLICATE_WITHIN_S))


Rates = Mapping[str, float]  # message -> Hz; what is not there is not sent unless requested

THIN: Rates = {  # what a telemetry radio leaves room for
    "HEARTBEAT": 1.0, "ATTITUDE": 4.0, "LOCAL_POSITION_NED": 3.0, "GLOBAL_POSITION_INT": 3.0,
    "GPS_RAW_INT": 2.0, "SERVO_OUTPUT_RAW": 2.0, "RAW_IMU": 2.0, "VFR_HUD": 4.0,
    "SYS_STATUS": 2.0, "BATTERY_STATUS": 0.5, "SYSTEM_TIME": 1.0, "GPS_GLOBAL_ORIGIN": 0.1,
    "EKF_STATUS_REPORT": 1.0,
}  # fmt: skip
FAST: Rates = {  # of a companion computer that requested more
    **THIN, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 25.0, "SERVO_OUTPUT_RAW": 25.0,
    "RAW_IMU": 25.0, "GLOBAL_POSITION_INT": 10.0, "GPS_RAW_INT": 5.0,
}  # fmt: skip


@dataclass(frozen=True)
class SimulatedBoatSettings:
    """Address, clocks, place, sensors and link of a boat. Times are seconds since the start."""

    system_id: int = 1
    rates: Rates = field(default_factory=lambda: THIN)
    noise: float = 1.0  # factor on every sensor error; 0: perfect sensors
    gyro_filter_hz: float = 4.0  # INS_GYRO_FILTER; 0: none
    loop_hz: float = 50.0  # of the autopilot: no message comes more often
    boot_s: float = 30.0  # the boat's clock at the start
    unix_s: float = 1_700_000_000.0  # Unix time at the start
    origin_deg: tuple[float, float] = (63.44, 10.40)  # of the local frame at the start
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # north, east [m], yaw [rad]
    battery_v: float = 14.8  # nominal
    armed: tuple[float, float] = (0.0, math.inf)  # from, to
    parameters: bool = True  # all parameters are sent after each boot, as if requested
    station: bool = False  # a ground station sends on the same link
    signing_key: bytes | None = None  # 32 bytes: every frame is signed with it
    faults: Faults = field(default_factory=Faults)
    sensor_faults: SensorFaults = field(default_factory=SensorFaults)

    def __post_init__(self) -> None:
        if not 1 <= self.system_id <= 254:
            raise BadInput(f"system id {self.system_id} of a played boat: expected 1 … 254")
        if not 1.0 <= self.loop_hz <= 1000.0:
            raise BadInput(f"loop_hz = {self.loop_hz}: expected 1 … 1000")
        for name, rate in self.rates.items():
            if name not in MESSAGES:
                raise BadInput(f"a played boat has no {name}: it has {', '.join(MESSAGES)}")
            if not 0.0 < rate < math.inf:
                raise BadInput(f"rate of {name} = {rate} Hz: expected a positive number")
        if self.signing_key is not None and len(self.signing_key) != 32:
            raise BadInput(f"a signing key has 32 bytes, this one {len(self.signing_key)}")
