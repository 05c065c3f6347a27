"""Reads the messages of an MCAP file, chunk by chunk; a chunk that is damaged is left out.

Messages inside a chunk are found by a compiled walk: the library's own takes ten times as long.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.recording.spans import PREFIX_BYTES, Span, Spans
from sim.kernel.compiled import compiled

Integers = NDArray[np.int64]

CHANNEL_ID, SEQUENCE, LOG_TIME, PUBLISH_TIME, DATA = (
    0,
    2,
    6,
    14,
    22,
)  # offsets inside a message record
MESSAGE, SCHEMA, CHANNEL = int(Opcode.MESSAGE), int(Opcode.SCHEMA), int(Opcode.CHANNEL)


# A chunk of a few kilobytes can unpack to gigabytes. A recording of the gateway unpacks to ten
# times its size, one of a boat at rest to forty.
MAX_EXPANSION = 200  # times the size of the file …
ALWAYS_UNPACKED = 64 * 1024 * 1024  # … and this many bytes of any file


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


def _unpacked(stream: IO[bytes], span: Span, room: int, indexed: int | None) -> bytes | None:
    """The records inside a chunk, or None where it is damaged; BadInput beyond `room` bytes.

    indexed  how much it unpacks to by the index of the file [bytes]; None where it has none
    """
    try:
        chunk = Chunk.read(read_content(stream, span))
        size = chunk.uncompressed_size
        if indexed not in (None, size):
            return None
        if chunk.compression == "zstd":  # what the packed data themselves ask for goes first
            asked = zstandard.get_frame_parameters(chunk.data).content_size
            if asked != zstandard.CONTENTSIZE_UNKNOWN:  # of a stream, which gets `size` at most
                size = asked
        if size > room:
            raise BadInput(
                f"it unpacks to more than {MAX_EXPANSION} times its size (MAX_EXPANSION): "
                "no recording does"
            )
        if size != chunk.uncompressed_size:
            return None
        if chunk.compression == "lz4":
            unpacked = LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            whole = chunk.uncompressed_crc in (0, zlib.crc32(unpacked)) and len(unpacked) == size
            return unpacked if whole else None
        data, length = get_chunk_data_stream(chunk, validate_crc=True)
        return data.read(length)
    except DAMAGE:
        return None


DAMAGE = (  # what readers of a damaged record raise
    McapError, CRCValidationError, RuntimeError, struct.error, zstandard.ZstdError, MemoryError,
    UnicodeDecodeError,
)  # fmt: skip


class Damaged(NamedTuple):
    """Messages that cannot be read: a chunk or record, a gap, or so many whose channel is lost."""

    is_chunk: bool = False
    is_record: bool = False  # outside of chunks
    messages: int = 0


def read_blocks(path: Path, spans: Spans) -> Iterator[Block | Damaged]:
    """All messages in file order, and where some are missing because the file is damaged."""
    room = ALWAYS_UNPACKED + MAX_EXPANSION * path.stat().st_size
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    gaps = {gap.before for gap in spans.gaps}
    with path.open("rb") as stream:
        sizes, summary = _indexed_sizes(stream, spans), _summary(stream, spans)
        for number, span in enumerate(spans.records):
            if number in gaps:
                yield Damaged()
            if span.opcode == Opcode.CHUNK:
                try:
                    data = _unpacked(stream, span, room, sizes.get(span.start - PREFIX_BYTES))
                except BadInput as error:
                    raise BadInput(f"{path}: {error}") from None
                room -= 0 if data is None else len(data)
            elif span.opcode in (MESSAGE, SCHEMA, CHANNEL):
                stream.seek(span.start - PREFIX_BYTES)
                data = stream.read(PREFIX_BYTES + span.length)
            elif span.opcode == Opcode.DATA_END:
                return
            else:
                continue
            block = None if data is None else _block_of(data, channels, schemas)
            if block is None:
                is_chunk = span.opcode == Opcode.CHUNK
                yield Damaged(is_chunk, is_record=not is_chunk)
            else:
                yield from _with_channels(block, summary)


def _indexed_sizes(stream: IO[bytes], spans: Spans) -> dict[int, int]:
    """Where a chunk begins in the file -> its size unpacked [bytes], as the file's index says."""
    sizes = {}
    for span in spans.records:
        if span.opcode == Opcode.CHUNK_INDEX:
            with suppress(*DAMAGE):
                entry = ChunkIndex.read(read_content(stream, span))
                sizes[entry.chunk_start_offset] = entry.uncompressed_size
    return sizes


class _Definitions(NamedTuple):
    """Channels and schemas by number."""

    channels: dict[int, Channel]
    schemas: dict[int, Schema]


def _summary(stream: IO[bytes], spans: Spans) -> _Definitions:
    """What stands once more at the end of a finished file."""
    found = _Definitions({}, {})
    opcodes = [span.opcode for span in spans.records]
    begins = opcodes.index(Opcode.DATA_END) if Opcode.DATA_END in opcodes else len(opcodes)
    for span in spans.records[begins:]:
        with suppress(*DAMAGE):
            if span.opcode == SCHEMA:
                schema = Schema.read(read_content(stream, span))
                found.schemas[schema.id] = schema
            elif span.opcode == CHANNEL:
                channel = Channel.read(read_content(stream, span))
                found.channels[channel.id] = channel
    return found


def _with_channels(block: Block, summary: _Definitions) -> Iterator[Block | Damaged]:
    """A block without messages of unknown channels; those of lost chunks are in the summary."""
    missing = set(np.unique(block.channel).tolist()) - block.channels.keys()
    for number in sorted(missing & summary.channels.keys()):
        block.channels[number] = channel = summary.channels[number]
        if channel.schema_id in summary.schemas:
            block.schemas.setdefault(channel.schema_id, summary.schemas[channel.schema_id])
    if not missing - summary.channels.keys():
        yield block
        return
    known = np.isin(block.channel, list(block.channels))
    columns = ("channel", "sequence", "log_time_ns", "publish_time_ns", "start", "end")
    yield block._replace(**{name: getattr(block, name)[known] for name in columns})
    yield Damaged(messages=int((~known).sum()))
