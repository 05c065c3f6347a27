"""A boat that says what a test wants, when the test wants: as a log and as live messages."""

import struct
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.log import MavlinkLog, tlog_from_bytes

START_NS = 1_700_000_000_000_000_000
BOAT, ARDUPILOT = dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED


@dataclass
class Script:
    """Messages in order of receipt; times in seconds, boot time and receipt apart."""

    sent: list[tuple[int, Any]] = field(default_factory=list)
    raw: bytearray = field(default_factory=bytearray)

    def send(self, receipt_s: float, message: Any, system: int = 1, component: int = 1) -> None:
        """One message as it reaches the recorder, through the wire's own rounding."""
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        frame = message.pack(mav)
        time_us = START_NS // 1000 + round(receipt_s * 1e6)
        self.raw += struct.pack(">Q", time_us) + frame
        self.sent.append((time_us * 1000, dialect.MAVLink(None).parse_buffer(frame)[0]))

    def log(self) -> MavlinkLog:
        """All of it as a telemetry log."""
        return tlog_from_bytes(bytes(self.raw), "scripted.tlog")


def heartbeat(armed: bool = True, autopilot: int = ARDUPILOT, type_: int = BOAT) -> Any:
    return dialect.MAVLink_heartbeat_message(type_, autopilot, ARMED if armed else 0, 0, 4, 3)


def attitude(boot_s: float, yaw: float = 0.0, yaw_rate: float = 0.0) -> Any:
    return dialect.MAVLink_attitude_message(ms(boot_s), 0.01, -0.02, yaw, 0.0, 0.0, yaw_rate)


def local_position(
    boot_s: float, north: float = 0.0, east: float = 0.0, vn: float = 0.0, ve: float = 0.0
) -> Any:
    return dialect.MAVLink_local_position_ned_message(ms(boot_s), north, east, 0.0, vn, ve, 0.0)


def servo(boot_s: float, *pulses: int, port: int = 0) -> Any:
    widths = [*pulses, *[0] * (16 - len(pulses))]
    return dialect.MAVLink_servo_output_raw_message(
        round(boot_s * 1e6) % 2**32, port, *widths[:8], *widths[8:]
    )


def gps(boot_s: float, fix: int) -> Any:
    return dialect.MAVLink_gps_raw_int_message(
        round(boot_s * 1e6), fix, 634470000, 104000000, 0, 1, 1, 65535, 65535, 9
    )


def gps2(boot_s: float, fix: int) -> Any:
    """The second receiver."""
    return dialect.MAVLink_gps2_raw_message(
        round(boot_s * 1e6), fix, 634470000, 104000000, 0, 1, 1, 65535, 65535, 9, 0, 0
    )


def ekf_status(ill: bool = False) -> Any:
    """All of attitude, velocity and place; ill: no velocity."""
    return dialect.MAVLink_ekf_status_report_message(
        831 & ~2 if ill else 831, 0.1, 0.1, 0.1, 0.1, 0.0
    )


def vfr_hud(speed: float = 1.0, heading_deg: int = 90) -> Any:
    return dialect.MAVLink_vfr_hud_message(0.0, speed, heading_deg, 0, 0.0, 0.0)


def ms(boot_s: float) -> int:
    """Boot time as the wire has it: uint32 ms."""
    return round(boot_s * 1e3) % 2**32
