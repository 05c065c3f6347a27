"""Writes ULog files, and a decoded voyage as PX4 would have logged it.

Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gateway.ingest.log import choose_boat
from gateway.ingest.open import open_log
from gateway.samples import Quantity

MAGIC = b"ULog\x01\x12\x35"
SYNC, SYNC_US = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12", 500_000  # a reader finds its way back by it
CODES = {
    "uint64_t": "Q", "float": "f", "double": "d", "uint8_t": "B", "int32_t": "i", "bool": "?",
    "uint16_t": "H", "uint32_t": "I",
}  # fmt: skip
TOPICS = {  # fields behind the timestamp, as PX4 v1.14 has them
    "vehicle_attitude": "float[4] q",
    "vehicle_angular_velocity": "float[3] xyz",
    "vehicle_acceleration": "float[3] xyz",
    "vehicle_local_position": (
        "float x;float y;float vx;float vy;float heading;double ref_lat;double ref_lon;"
        "bool xy_valid;bool v_xy_valid;bool xy_global"
    ),
    "vehicle_global_position": "double lat;double lon",
    "vehicle_gps_position": (
        "uint64_t time_utc_usec;double latitude_deg;double longitude_deg;float vel_n_m_s;"
        "float vel_e_m_s;uint8_t fix_type;bool vel_ned_valid"
    ),
    "actuator_outputs": "float[16] output",
    "actuator_motors": "float[12] control",
    "actuator_servos": "float[8] control",
    "estimator_selector_status": "uint8_t primary_instance",
    "estimator_status": (
        "uint32_t filter_fault_flags;float mag_test_ratio;float vel_test_ratio;"
        "float pos_test_ratio;uint16_t innovation_check_flags;uint16_t solution_status_flags"
    ),
    "sensor_gps": (
        "uint64_t time_utc_usec;double latitude_deg;double longitude_deg;float vel_n_m_s;"
        "float vel_e_m_s;uint8_t fix_type;bool vel_ned_valid"
    ),
    "vehicle_status": "uint8_t arming_state;uint8_t system_type;uint8_t nav_state",
    "battery_status": "float voltage_v",
    "wind": "float windspeed_north;float windspeed_east",
}


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def named(kind: str, key: str, value: bytes) -> bytes:
    """An information or parameter: type and name, value."""
    return message(kind, bytes([len(key)]) + key.encode() + value)


class UlogWriter:
    """Collects rows of topics and puts them out in order of their time."""

    def __init__(self, start_us: int = 1_000_000, topics: Mapping[str, str] = TOPICS) -> None:
        self.start_us, self.topics = start_us, topics
        self.rows: list[tuple[int, bytes]] = []
        self.ids: dict[tuple[str, int], int] = {}
        self.head: list[bytes] = []

    def info(self, key: str, value: str) -> None:
        self.head.append(named("I", f"char[{len(value)}] {key}", value.encode()))

    def release(self, packed: int) -> None:
        self.head.append(named("I", "uint32_t ver_sw_release", struct.pack("<I", packed)))

    def parameter(self, name: str, value: float) -> None:
        self.head.append(named("P", f"float {name}", struct.pack("<f", value)))

    def changed_parameter(self, time_us: int, name: str, value: int) -> None:
        body = named("P", f"int32_t {name}", struct.pack("<i", value))
        self.rows.append((time_us, body))

    def said(self, time_us: int, level: int, text: str, tag: int | None = None) -> None:
        """A text of the autopilot; 0 is the worst level, 7 the least."""
        stamp = struct.pack("<Q", time_us) + text.encode()
        head = bytes([ord("0") + level]) + (b"" if tag is None else struct.pack("<H", tag))
        self.rows.append((time_us, message("L" if tag is None else "C", head + stamp)))

    def dropout(self, time_us: int, milliseconds: int) -> None:
        self.rows.append((time_us, message("O", struct.pack("<H", milliseconds))))

    def add(self, topic: str, time_us: int, *values: float, instance: int = 0) -> None:
        """One row: the values of all fields in order, arrays spread out."""
        number = self.ids.setdefault((topic, instance), len(self.ids))
        codes = "".join(
            CODES[kind.partition("[")[0]] * int((kind.partition("[")[2] or "1]")[:-1])
            for kind in (one.split(" ")[0] for one in self.topics[topic].split(";"))
        )
        packed = struct.pack(
            f"<HQ{codes}",
            number,
            time_us,
            *(float(v) if c in "fd" else int(v) for c, v in zip(codes, values, strict=True)),
        )
        self.rows.append((time_us, message("D", packed)))

    def bytes(self, *, sync: bool = True, sort: bool = True, appended_from: int = 0) -> bytes:
        """The file: rows by time or, for a clock that restarts, as they were added.

        appended_from  rows from this time [µs] on stand behind what the flags call appended, and a
                       message that was cut stands before them
        """
        used = dict.fromkeys(topic for topic, _ in self.ids)
        formats = [
            message("F", f"{topic}:uint64_t timestamp;{self.topics[topic]};".encode())
            for topic in used
        ]
        added = [
            message("A", struct.pack("<BH", instance, number) + topic.encode())
            for (topic, instance), number in self.ids.items()
        ]
        syncs = range(self.start_us, max((t for t, _ in self.rows), default=0), SYNC_US)
        timed = [*((t, message("S", SYNC)) for t in syncs if sync), *self.rows]
        rows = sorted(timed, key=lambda pair: pair[0]) if sort else timed
        late = [row for t, row in rows if appended_from and t >= appended_from]
        head = b"".join([*formats, *self.head, *added])
        body = b"".join(row for t, row in rows if not appended_from or t < appended_from)
        body += late[0][:-3] if late else b""
        header = MAGIC + b"\x01" + struct.pack("<Q", self.start_us)
        offset = len(header) + 43 + len(head) + len(body)
        flags = struct.pack("<8x8B3Q", bool(late), *bytes(7), offset if late else 0, 0, 0)
        return b"".join([header, message("B", flags), head, body, *late])


def quaternion(yaw: float, roll: float, pitch: float) -> tuple[float, float, float, float]:
    """Body -> NED, by roll, then pitch, then yaw."""
    half = np.array([roll, pitch, yaw]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


FIX_AGE_US = 500_000  # between a fix and its message


def as_ulog(log_path: Path, boot_us: int = 5_000_000) -> UlogWriter:
    """A voyage of another format, topic by topic at the same moments of the boat's clock."""
    log = open_log(log_path)
    boat = choose_boat(log)
    decoded = log.decode(boat)
    start_ns = min(int(samples.vehicle_time_ns.min()) for samples in decoded.samples)
    out = UlogWriter(boot_us)
    out.info("sys_name", "PX4")
    out.info("ver_sw", "1dacb4cd0fe9fbc4b9a8df81d8ea4d1e4f2d1e5a")
    out.release(0x010E03FF)
    for name, value in log.parameters(boat).items():
        out.parameter(name, value)

    def rows(quantity: Quantity, source: str):
        for samples in decoded.of(quantity):
            if samples.source == source:
                times = boot_us + np.round((samples.vehicle_time_ns - start_ns) / 1000)
                yield from zip(times.astype(np.int64).tolist(), samples.values, strict=True)

    tilt = dict(rows(Quantity.TILT, "ATTITUDE"))
    for t, (yaw,) in rows(Quantity.YAW, "ATTITUDE"):
        out.add("vehicle_attitude", t, *quaternion(yaw, *tilt[t]))
    for t, (rate,) in rows(Quantity.YAW_RATE, "ATTITUDE"):
        out.add("vehicle_angular_velocity", t, 0.0, 0.0, rate)
    velocity = dict(rows(Quantity.VELOCITY, "LOCAL_POSITION_NED"))
    (*_, (_, origin)) = rows(Quantity.ORIGIN, "GPS_GLOBAL_ORIGIN")
    for t, place in rows(Quantity.POSITION, "LOCAL_POSITION_NED"):
        out.add("vehicle_local_position", t, *place, *velocity[t], 0.0, *origin, 1, 1, 1)
    for t, place in rows(Quantity.GLOBAL_POSITION, "GLOBAL_POSITION_INT"):
        out.add("vehicle_global_position", t, *place)
    place, velocity = (
        dict(rows(quantity, "GPS_RAW_INT"))
        for quantity in (Quantity.GLOBAL_POSITION, Quantity.VELOCITY)
    )
    sampled = sorted(place)
    for heard, (fix,) in rows(Quantity.FIX, "GPS_RAW_INT fix"):
        before = [t for t in sampled[: bisect_right(sampled, heard)][-1:] if heard - t < FIX_AGE_US]
        known, t = bool(before), (before or [heard])[0]
        unix_us = (start_ns // 1000) + t - boot_us
        where, moving = (place[t], velocity[t]) if known else (np.zeros(2), np.zeros(2))
        out.add("vehicle_gps_position", t, unix_us, *where, *moving, fix, known)
    for t, pulses in rows(Quantity.ACTUATORS, "SERVO_OUTPUT_RAW"):
        out.add("actuator_outputs", t, *np.nan_to_num(pulses[:16]))
    for t, (armed,) in rows(Quantity.ARMED, "HEARTBEAT"):
        out.add("vehicle_status", t, 2 if armed else 1, 11, 3 if armed else 0)
    for t, (volts,) in rows(Quantity.VOLTAGE, "SYS_STATUS"):
        out.add("battery_status", t, volts)
    for t, wind in rows(Quantity.WIND, "WIND"):
        out.add("wind", t, *wind)
    return out
