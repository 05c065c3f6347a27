"""What a user or a test may choose about a simulated boat."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.errors import BadInput
from gateway.simulated_boat.faults import Faults
from gateway.simulated_boat.telemetry import MESSAGES

Rates = Mapping[str, float]  # message -> Hz; what is not there is not sent unless requested

THIN: Rates = {  # what a telemetry radio leaves room for
    "HEARTBEAT": 1.0, "ATTITUDE": 4.0, "LOCAL_POSITION_NED": 3.0, "GLOBAL_POSITION_INT": 3.0,
    "GPS_RAW_INT": 2.0, "SERVO_OUTPUT_RAW": 2.0, "RAW_IMU": 2.0, "VFR_HUD": 4.0,
    "SYS_STATUS": 2.0, "BATTERY_STATUS": 0.5, "SYSTEM_TIME": 1.0, "GPS_GLOBAL_ORIGIN": 0.1,
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
