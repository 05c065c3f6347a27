"""What stands in the headers of accepted frames, and the payloads behind them: compiled."""

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.frame_walk import MAGIC_2, SIGNED, Bytes, U
from gateway.jit import compiled
from sim.state import Ints

N = TypeVar("N", bound=np.generic)


class Headers(NamedTuple):
    """Headers of accepted frames, all (K,)."""

    offset: Ints  # of the frame in the data [bytes]
    length: NDArray[np.int32]  # of the frame [bytes]
    payload_offset: Ints
    payload_length: NDArray[np.uint8]
    message_id: NDArray[np.int32]
    sequence: NDArray[np.uint8]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    signed: NDArray[np.bool_]
    version: NDArray[np.uint8]  # of MAVLink: 1 or 2


def read_headers(data: Bytes, offset: Ints) -> Headers:
    """Headers of the frames at `offset` (K,)."""

    def of(kind: type[N]) -> NDArray[N]:
        return np.empty(len(offset), kind)

    headers = Headers(
        offset=offset,
        length=of(np.int32),
        payload_offset=of(np.int64),
        payload_length=of(np.uint8),
        message_id=of(np.int32),
        sequence=of(np.uint8),
        system=of(np.uint8),
        component=of(np.uint8),
        signed=of(np.bool_),
        version=of(np.uint8),
    )
    fill_headers(data, headers)
    return headers


@compiled
def fill_headers(data: Bytes, headers: Headers) -> None:
    """Writes what stands in the data at `headers.offset` into the other arrays."""
    for i in range(len(headers.offset)):
        at = headers.offset[i]
        second = data[at] == MAGIC_2
        begin = at + (4 if second else 2)  # magic, length and in version 2 two bytes of flags
        number = np.int64(data[begin + 3])
        if second:
            number += (np.int64(data[at + 8]) << 8) + (np.int64(data[at + 9]) << 16)
        signed = second and (data[at + 2] & SIGNED) != 0
        payload = begin + (6 if second else 4)
        headers.payload_offset[i] = payload
        headers.payload_length[i] = data[at + 1]
        headers.length[i] = payload - at + np.int64(data[at + 1]) + 2 + (13 if signed else 0)
        headers.message_id[i] = number
        headers.sequence[i] = data[begin]
        headers.system[i] = data[begin + 1]
        headers.component[i] = data[begin + 2]
        headers.signed[i] = signed
        headers.version[i] = 2 if second else 1


@compiled
def read_stamps(data: Bytes, offset: Ints) -> Ints:
    """The time stamp in front of each frame: (K,) [Unix ns]."""
    stamps = np.empty(len(offset), np.int64)
    for i in range(len(offset)):
        stamp, start = U(0), U(offset[i] - 8)
        for k in range(8):
            stamp = (stamp << U(8)) | U(data[start + U(k)])
        stamps[i] = np.int64(stamp * U(1000))
    return stamps


@compiled
def group(key: NDArray[np.int32] | Ints, largest: int) -> tuple[Ints, Ints]:
    """Keys (K,) -> their stable sorting order (K,), where each key starts in it (largest + 2,)."""
    starts = np.zeros(largest + 2, np.int64)
    for number in key:
        starts[number + 1] += 1
    starts = np.cumsum(starts)
    place = starts.copy()
    order = np.empty(len(key), np.int64)
    for i in range(len(key)):
        order[place[key[i]]] = i
        place[key[i]] += 1
    return order, starts


@compiled
def gather(data: Bytes, start: Ints, length: NDArray[np.uint8], rows: Ints, size: int) -> Bytes:
    """The stretch of each of `rows` (K,), cut or filled with zeros to `size`: (K × size,)."""
    payloads = np.empty(len(rows) * size, np.uint8)
    for i in range(len(rows)):
        row = rows[i]
        source, target = start[row], i * size
        given = min(int(length[row]), size)
        # unsigned indices: numba then leaves out the branch for negative ones
        for k in range(given):
            payloads[U(target + k)] = data[U(source + k)]
        for k in range(given, size):
            payloads[U(target + k)] = 0
    return payloads
