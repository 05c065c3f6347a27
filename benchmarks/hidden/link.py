"""What arrives: frames with the receiver's time before each, as ground stations record them."""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.random import Generator as Dice
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.hidden.talk import STATION, Said
from benchmarks.hidden.telemetry import Clock

OFFSET, DRIFT = 0.137, 2e-5  # s, s/s: the receiver's clock against the boat's
SHORTEST, USUAL, RARELY, LONG = 0.004, 0.003, 0.01, 0.06  # s on the way; a share of long waits
STAMP = struct.Struct(">Q")


def recorded(said: Sequence[Said], clock: Clock, dice: Dice) -> bytes:
    """Messages in the order they were sent -> a .tlog: 64-bit µs, big-endian, frame, and so on."""
    speakers = {s.system: mavlink.MAVLink(None, s.system, 1) for s in said}
    speakers[STATION].srcComponent = 190
    sent = np.array([s.time for s in said])
    way = SHORTEST + dice.exponential(USUAL, len(said))
    way += LONG * dice.random(len(said)) * (dice.random(len(said)) < RARELY)
    arrival = np.maximum.accumulate(sent + way)  # one link: nobody overtakes
    unix_us = np.round((clock.unix + OFFSET + arrival * (1.0 + DRIFT)) * 1e6).astype(np.int64)
    return b"".join(
        STAMP.pack(stamp) + _frame(speakers[s.system], s)
        for stamp, s in zip(unix_us.tolist(), said, strict=True)
    )


def _frame(speaker: mavlink.MAVLink, said: Said) -> bytes:
    frame = said.message.pack(speaker)
    speaker.seq = (speaker.seq + 1) % 256
    return bytes(frame)
