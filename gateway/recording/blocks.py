"""Reads MCAP record by record, so that a file whose writer was killed opens all the same.

A record is an opcode (1 byte), a length (8 bytes) and that many bytes. What does not fit into the
file any more was being written when the writer died, and ends the recording. Records of a kind that
is not known are passed over, as the format asks (0x80 and above belong to applications). Messages
inside a chunk are found by a compiled walk: the library's own takes ten times as long.
"""

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from gateway.errors import BadInput
from sim.kernel.compiled import compiled

Integers = NDArray[np.int64]

PREFIX = struct.Struct("<BQ")
NO_OPCODE = 0  # of a file that was made longer than what was written
CHANNEL_ID, SEQUENCE, LOG_TIME, PUBLISH_TIME, DATA = (
    0,
    2,
    6,
    14,
    22,
)  # offsets inside a message record
PREFIX_BYTES = 9
MESSAGE, SCHEMA, CHANNEL = int(Opcode.MESSAGE), int(Opcode.SCHEMA), int(Opcode.CHANNEL)


# A chunk of a few kilobytes can unpack to gigabytes. A recording of the gateway unpacks to ten
# times its size, one of a boat at rest to forty.
MAX_EXPANSION = 200  # times the size of the file …
ALWAYS_UNPACKED = 64 * 1024 * 1024  # … and this many bytes of any file


class Span(NamedTuple):
    """Where the content of a record stands in the file."""

    opcode: int
    start: int
    length: int


class Spans(NamedTuple):
    """All whole records of a file, and whether its writer finished it."""

    records: tuple[Span, ...]
    finished: bool


class Block(NamedTuple):
    """Messages that stand together: message k is data[start[k]:end[k]]; all columns are (K,)."""

    data: bytes
    channel: Integers
    sequence: Integers
    log_time_ns: Integers
    publish_time_ns: Integers
    start: Integers
    end: Integers
    channels: dict[int, Channel]
    schemas: dict[int, Schema]


def read_spans(stream: IO[bytes], size: int) -> Spans:
    """Walk over all records up to the footer or to what a killed writer left undone."""
    records = []
    at = len(MCAP0_MAGIC)
    while at + PREFIX_BYTES <= size:
        stream.seek(at)
        opcode, length = PREFIX.unpack(stream.read(PREFIX_BYTES))
        at += PREFIX_BYTES
        if opcode == NO_OPCODE or at + length > size:
            break
        records.append(Span(opcode, at, length))
        at += length
        if opcode == Opcode.FOOTER:
            stream.seek(at)
            return Spans(tuple(records), stream.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC)
    return Spans(tuple(records), False)


@compiled
def _little(data: NDArray[np.uint8], at: int, size: int) -> np.int64:
    """An unsigned little-endian number of `size` bytes."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(data[at + i]) << (8 * i)
    return value


@compiled
def _walk(data: NDArray[np.uint8], found: Integers) -> int:
    """Fill `found` (R, 3) with opcode, start and end of each whole record -> how many."""
    at, count = 0, 0
    while at + PREFIX_BYTES <= len(data) and count < len(found):
        length = _little(data, at + 1, 8)
        if length < 0 or at + PREFIX_BYTES + length > len(data):
            break
        found[count, 0] = data[at]
        found[count, 1] = at + PREFIX_BYTES
        at += PREFIX_BYTES + int(length)
        found[count, 2] = at
        count += 1
    return count


@compiled
def _heads(data: NDArray[np.uint8], start: Integers) -> Integers:
    """Where messages start (K,) -> channel, sequence, log time, publish time (K, 4)."""
    heads = np.empty((len(start), 4), np.int64)
    for k in range(len(start)):
        heads[k, 0] = _little(data, start[k] + CHANNEL_ID, 2)
        heads[k, 1] = _little(data, start[k] + SEQUENCE, 4)
        heads[k, 2] = _little(data, start[k] + LOG_TIME, 8)
        heads[k, 3] = _little(data, start[k] + PUBLISH_TIME, 8)
    return heads


def _block(data: bytes, channels: dict[int, Channel], schemas: dict[int, Schema]) -> Block:
    """The messages in a run of records; channels and schemas among them are remembered."""
    view = np.frombuffer(data, np.uint8)
    found = np.empty((len(data) // PREFIX_BYTES + 1, 3), np.int64)
    found = found[: _walk(view, found)]
    for opcode, start, end in found[found[:, 0] != MESSAGE].tolist():
        content = ReadDataStream(BytesIO(data[start:end]))
        if opcode == SCHEMA:
            schema = Schema.read(content)
            schemas[schema.id] = schema
        elif opcode == CHANNEL:
            channel = Channel.read(content)
            channels[channel.id] = channel
    messages = found[(found[:, 0] == MESSAGE) & (found[:, 2] - found[:, 1] >= DATA)]
    channel, sequence, log_time, publish_time = _heads(view, messages[:, 1]).T
    start, end = messages[:, 1] + DATA, messages[:, 2]
    return Block(data, channel, sequence, log_time, publish_time, start, end, channels, schemas)


def _block_of(
    data: bytes, channels: dict[int, Channel], schemas: dict[int, Schema]
) -> Block | None:
    """The messages in a run of records; None where a schema or channel among them is damaged."""
    try:
        return _block(data, channels, schemas)
    except DAMAGE:
        return None


def read_content(stream: IO[bytes], span: Span) -> ReadDataStream:
    """The content of a record, for the library's `read` of its kind."""
    stream.seek(span.start)
    return ReadDataStream(BytesIO(stream.read(span.length)))


def _unpacked(stream: IO[bytes], span: Span, room: int) -> bytes | None:
    """The records inside a chunk, or None where it is damaged; BadInput beyond `room` bytes."""
    try:
        chunk = Chunk.read(read_content(stream, span))
        size = chunk.uncompressed_size
        if chunk.compression == "zstd":  # what the packed data themselves ask for goes first
            asked = zstandard.get_frame_parameters(chunk.data).content_size
            if asked != zstandard.CONTENTSIZE_UNKNOWN:  # of a stream, which gets `size` at most
                size = max(size, asked)
        if size > room:
            raise BadInput(
                f"it unpacks to more than {MAX_EXPANSION} times its size (MAX_EXPANSION): "
                "no recording does"
            )
        if chunk.compression == "lz4":
            unpacked = LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            return unpacked if len(unpacked) == size else None
        data, length = get_chunk_data_stream(chunk, validate_crc=True)
        return data.read(length)
    except DAMAGE:
        return None


DAMAGE = (  # what readers of a damaged record raise
    McapError, CRCValidationError, RuntimeError, struct.error, zstandard.ZstdError, MemoryError,
    UnicodeDecodeError,
)  # fmt: skip


def read_blocks(path: Path, spans: Spans) -> Iterator[Block | None]:
    """All messages in file order; None stands for a chunk that is damaged."""
    room = ALWAYS_UNPACKED + MAX_EXPANSION * path.stat().st_size
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    with path.open("rb") as stream:
        for span in spans.records:
            if span.opcode == Opcode.CHUNK:
                try:
                    data = _unpacked(stream, span, room)
                except BadInput as error:
                    raise BadInput(f"{path}: {error}") from None
                room -= 0 if data is None else len(data)
                yield None if data is None else _block_of(data, channels, schemas)
            elif span.opcode in (MESSAGE, SCHEMA, CHANNEL):
                stream.seek(span.start - PREFIX_BYTES)
                data = stream.read(PREFIX_BYTES + span.length)
                yield _block_of(data, channels, schemas)
            elif span.opcode == Opcode.DATA_END:
                return
