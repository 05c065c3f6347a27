"""The time of DataFlash messages: the autopilot's microseconds, and Unix time from its GPS."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.jit import compiled
from sim.state import Ints

Bytes = NDArray[np.uint8]
U = np.uint64
PAYLOAD = 3  # behind the magic bytes and the type
CREDIBLE_US = 1 << 52
GPS_EPOCH_S = 315_964_800  # 1980-01-06 in Unix time
WEEK_S = 604_800
LEAP_S = 18  # GPS − UTC since 2017, as in pymavlink


@compiled
def clocks(data: Bytes, offset: Ints, kind: Ints, width: Ints, scale: Ints) -> Ints:
    """Time of each message, or of the one before where it tells none: (K,) [µs since boot].

    width, scale  (256,)  by type: bytes of the clock at the front (8, 4 or 0: none), µs per count
    """
    times = np.empty(len(offset), np.int64)
    now = np.int64(-1)
    for i in range(len(offset)):
        number, start = kind[i], U(offset[i] + PAYLOAD)
        if width[number] > 0:
            count = U(0)
            if width[number] == 8:  # a loop of constant length becomes one load
                for k in range(8):
                    count |= U(data[start + U(k)]) << U(8 * k)
            else:
                for k in range(4):
                    count |= U(data[start + U(k)]) << U(8 * k)
            if count < U(CREDIBLE_US):
                first = now < 0
                now = np.int64(count) * scale[number]
                if first:  # what stands before the first clock (FMT records) is as old
                    times[:i] = now
        times[i] = now
    return times


def unix_minus_boot_ns(gps: Mapping[str, NDArray[Any]]) -> int:
    """Columns of GPS -> Unix time minus boat time by the first that knows the time, or 0 [ns]."""
    if not {"GWk", "GMS", "TimeUS"} <= set(gps):
        return 0
    week, tow_ms, boot_us = gps["GWk"], gps["GMS"], gps["TimeUS"]
    known = np.flatnonzero(week > 0)
    if not len(known):
        return 0
    k = known[0]
    unix_s = GPS_EPOCH_S + WEEK_S * int(week[k]) - LEAP_S
    return unix_s * 10**9 + int(tow_ms[k]) * 10**6 - int(boot_us[k]) * 1000
