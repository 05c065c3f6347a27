"""Reading whole logs: every field of every message, beside pymavlink in the same run.

    python -m benchmarks.fast_logs

CPU time (`process_time`), file reading included on both sides. The target is 100× for a .tlog of
at least 500 000 messages against a loop of `recv_match`, and 50× for a DataFlash .BIN against a
loop of DFReader's `recv_msg`, neither of which is asked for a single field. Our compiled code is
warm: the first run ever compiles for some seconds and keeps the result on disk.

The logs are those of the shared folder (SHADOW_SHARED) where it is there, otherwise made here.
"""

import contextlib
import io
import os
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink import DFReader, mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.log import Log
from gateway.ingest.open import open_log

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("SHADOW_SHARED", ROOT.parent / "shared")) / "data" / "sitl"
MESSAGES = 510_000
REPEATS = 5  # of our own reading: the best counts, as disturbances only add


def long_tlog(folder: Path) -> Path:
    """A .tlog of at least half a million messages."""
    path, real = folder / "long.tlog", SHARED / "boat_calm.tlog"
    path.write_bytes(real.read_bytes() * 3 if real.exists() else made_tlog())
    return path


def made_tlog() -> bytes:
    """Attitude, position, servo outputs and heartbeats in turn."""
    mav, records = dialect.MAVLink(None, srcSystem=1, srcComponent=1), []
    for k in range(MESSAGES):
        t = 20 * k
        message = (
            dialect.MAVLink_attitude_message(t, 0.01, 0.02, k * 1e-3, 0.1, 0.2, 0.3),
            dialect.MAVLink_local_position_ned_message(t, k * 0.1, 2.0, 0.1, 1.5, 0.2, 0.01),
            dialect.MAVLink_servo_output_raw_message(t, 0, 1500, 1500, 1600, 0, 0, 0, 0, 0),
            dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3),
        )[k % 4]
        records.append(struct.pack(">Q", 1_700_000_000_000_000 + 1000 * t) + message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
    return b"".join(records)


def long_bin(folder: Path) -> Path:
    """A DataFlash log."""
    real, path = SHARED / "boat_calm.BIN", folder / "long.bin"
    if real.exists():
        return real
    path.write_bytes(made_bin())
    return path


def made_bin() -> bytes:
    """Two formats in turn."""
    head = b"\xa3\x95"
    records = [
        head + struct.pack("<BBB4s16s64s", 0x80, n, length, name, characters, columns)
        for n, length, name, characters, columns in (
            (0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
            (1, 36, b"IMU", b"QBffffff", b"TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
            (2, 23, b"ATT", b"QccCCcc", b"TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
        )
    ]
    for k in range(150_000):
        records.append(head + struct.pack("<BQB6f", 1, 2500 * k, 0, 0.1, 0.2, 0.3, 1, 2, 3))
        records.append(head + struct.pack("<BQhhHHhh", 2, 2500 * k, 1, 2, 3, 4, 5, 6))
    return b"".join(records)


def read_all(path: Path) -> int:
    """Every column of every message -> number of messages."""
    log: Log = open_log(path)
    return sum(len(log.table(name)) for name in log.counts())


def read_with_mavutil(path: Path) -> int:
    """The same number by `recv_match`."""
    return count(mavutil.mavlink_connection(str(path), dialect="ardupilotmega").recv_match)


def read_with_dfreader(path: Path) -> int:
    """The same number by DFReader."""
    with contextlib.redirect_stderr(io.StringIO()):  # it complains of bytes at the end
        return count(DFReader.DFReader_binary(str(path)).recv_msg)


def count(receive: Callable[[], Any]) -> int:
    """Messages until there is none."""
    messages = 0
    while receive() is not None:
        messages += 1
    return messages


def cpu_seconds(read: Callable[[Path], int], path: Path, repeats: int = 1) -> tuple[float, int]:
    """Least CPU time of some runs, and the messages that were read."""
    times, messages = [], 0
    for _ in range(repeats):
        start = time.process_time()
        messages = read(path)
        times.append(time.process_time() - start)
    return min(times), messages


def compare(what: str, path: Path, peer: Callable[[Path], int], target: float) -> None:
    """Prints how many times faster than the peer we read."""
    read_all(path)  # warm-up: compiles, or loads what was compiled
    ours, messages = cpu_seconds(read_all, path, REPEATS)
    theirs, peer_messages = cpu_seconds(peer, path)
    print(
        f"{what}: {messages} messages ({peer_messages} by the peer), {1e3 * ours:.0f} ms against "
        f"{1e3 * theirs:.0f} ms: {theirs / ours:.0f}× (target {target:.0f}×)"
    )


def main() -> None:
    """Both kinds of log."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compare(".tlog against recv_match", long_tlog(folder), read_with_mavutil, 100)
        compare(".BIN against DFReader", long_bin(folder), read_with_dfreader, 50)


if __name__ == "__main__":
    main()
