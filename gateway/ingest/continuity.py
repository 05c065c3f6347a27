"""How the frames of each source follow each other: lost, late and doubled ones."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.frame_headers import Bytes, Headers
from gateway.jit import compiled

SOURCES = 65536  # systems × components
LATE = 32  # a sequence number that steps back less than this is a late frame, not a loss


class Continuity(IntEnum):
    """Columns of the counts that `follow` returns."""

    LOST = 0
    LATE = 1
    DUPLICATES = 2


@compiled
def same_frame(data: Bytes, h: Headers, one: int, other: int) -> bool:
    """Do two frames carry the same number, message and payload?"""
    if (
        h.sequence[one] != h.sequence[other]
        or h.message_id[one] != h.message_id[other]
        or h.payload_length[one] != h.payload_length[other]
    ):
        return False
    for k in range(h.payload_length[one]):
        if data[h.payload_offset[one] + k] != data[h.payload_offset[other] + k]:
            return False
    return True


@compiled
def follow(data: Bytes, h: Headers) -> NDArray[np.int64]:
    """Headers (K,) -> counts of `Continuity`, each source (system, component) by itself."""
    counts = np.zeros(3, np.int64)
    last = np.full(SOURCES, -1, np.int64)  # frame before this one
    expected = np.zeros(SOURCES, np.int64)
    restart = np.full(SOURCES, -1, np.int64)  # follows if a step back was a reboot
    for i in range(len(h.offset)):
        source = np.int64(h.system[i]) * 256 + h.component[i]
        number, after = np.int64(h.sequence[i]), (np.int64(h.sequence[i]) + 1) & 0xFF
        before, last[source] = last[source], i
        gap = (number - expected[source]) & 0xFF
        if before >= 0 and same_frame(data, h, before, i):
            counts[2] += 1
        elif before >= 0 and gap > 256 - LATE and number != restart[source]:
            counts[1] += 1
            restart[source] = after
        else:
            if before >= 0 and number != restart[source]:
                counts[0] += gap
            restart[source], expected[source] = -1, after
    counts[0] = max(counts[0] - counts[1], 0)  # a late frame's empty place was counted as a loss
    return counts
