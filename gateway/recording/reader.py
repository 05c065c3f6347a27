"""A recording opened for reading: finished or not, as the gateway or another program wrote it."""

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import orjson
from mcap import records
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC, Writer
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.json_rows import TopicRows
from gateway.recording.blocks import DAMAGE, Block, read_blocks, read_content
from gateway.recording.damage import Damage, damage_of
from gateway.recording.recorder import LINK, RAW, Attachment
from gateway.recording.spans import Span, Spans, read_spans

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class RawFrames:
    """Frames as they were received: frame k is data[start[k]:end[k]], of links[link[k]]."""

    data: bytes
    start: Integers
    end: Integers
    receive_time_ns: Integers
    vehicle_time_ns: Integers
    link: Integers
    links: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.start)

    def frames(self) -> list[bytes]:
        """The frames one by one."""
        pairs = zip(self.start.tolist(), self.end.tolist(), strict=True)
        return [self.data[start:end] for start, end in pairs]


@dataclass(frozen=True)
class Recording:
    """What an MCAP file holds. Messages come in file order: as they were handled."""

    path: Path
    finished: bool
    metadata: Mapping[str, Mapping[str, str]]
    attachments: Mapping[str, Attachment]
    _spans: Spans
    _lost: tuple[str, ...] = ()  # attachments and metadata that are damaged

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read what stands around the messages; raises BadInput where that is no MCAP file."""
        with _readable(path), path.open("rb") as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise BadInput(f"{path}: not an MCAP file: give a recording that ends in .mcap")
            spans = read_spans(stream, path.stat().st_size)
            metadata, attachments, lost = {}, {}, []
            for span in spans.records:
                try:
                    if span.opcode == Opcode.METADATA:
                        entry = records.Metadata.read(read_content(stream, span))
                        metadata[entry.name] = entry.metadata
                    elif span.opcode == Opcode.ATTACHMENT:
                        item = _attachment(stream, span)
                        attachments[item.name] = item
                except DAMAGE:
                    lost.append("metadata" if span.opcode == Opcode.METADATA else "attachment")
        return cls(path, spans.finished, metadata, attachments, spans, tuple(lost))

    def blocks(self) -> Iterator[Block]:
        """All messages that can be read, a chunk at a time; `damage` tells what is left out."""
        for block in read_blocks(self.path, self._spans):
            if isinstance(block, Block):
                yield block

    @cached_property
    def damage(self) -> Damage:
        """What cannot be read of it; reads all of it."""
        opcodes = [span.opcode for span in self._spans.records]
        there = opcodes.count(Opcode.METADATA) + opcodes.count(Opcode.ATTACHMENT)
        repeated = there - len(self.metadata) - len(self.attachments) - len(self._lost)
        blocks = read_blocks(self.path, self._spans)
        return damage_of(self._spans, blocks, self._lost, repeated)

    def counts(self) -> dict[str, int]:
        """Channel topic -> number of messages."""
        counts: dict[str, int] = {}
        for block in self.blocks():
            numbers, found = np.unique(block.channel, return_counts=True)
            for number, count in zip(numbers.tolist(), found.tolist(), strict=True):
                topic = block.channels[number].topic
                counts[topic] = counts.get(topic, 0) + count
        return counts

    def rows(self, topic: str) -> Iterator[TopicRows]:
        """Messages of one topic as they were recorded, block by block."""
        for block in self.blocks():
            chosen = _chosen(block, topic)
            if len(chosen):
                pairs = zip(block.start[chosen].tolist(), block.end[chosen].tolist(), strict=True)
                payloads = [block.data[start:end] for start, end in pairs]
                times = block.publish_time_ns[chosen], block.log_time_ns[chosen]
                yield TopicRows(topic, *times, payloads)

    def columns(self, topic: str) -> dict[str, NDArray[Any]]:
        """All messages of one topic, field by field: name -> (K,); empty where there are none."""
        messages: list[dict[str, Any]] = []
        for rows in self.rows(topic):
            messages += orjson.loads(b"[" + b",".join(rows.payloads) + b"]")
        names = messages[0] if messages else {}
        return {name: np.array([message[name] for message in messages]) for name in names}

    def raw(self) -> RawFrames:
        """All MAVLink frames, byte for byte."""
        pieces: list[bytes] = []
        parts: list[Integers] = [np.empty((0, 4), np.int64)]
        links: dict[str, int] = {}
        for block in self.blocks():
            chosen = _chosen(block, RAW)
            start, end = block.start[chosen], block.end[chosen]
            pairs = zip(start.tolist(), end.tolist(), strict=True)
            pieces.append(b"".join([block.data[a:b] for a, b in pairs]))
            times = block.log_time_ns[chosen], block.publish_time_ns[chosen]
            parts.append(np.column_stack([end - start, *times, _links(block, chosen, links)]))
        length, receive, vehicle, link = np.concatenate(parts).T.copy()
        edges = np.concatenate([[0], np.cumsum(length)])
        return RawFrames(
            b"".join(pieces), edges[:-1], edges[1:], receive, vehicle, link, tuple(links)
        )


def rewrite(
    recording: Recording,
    writer: Writer,
    chosen: Callable[[Block], NDArray[np.bool_]] | None = None,
) -> int:
    """Copy everything that can be read, or of the messages those chosen -> how many messages."""
    writer.start(profile="")
    for name, entries in recording.metadata.items():
        writer.add_metadata(name, dict(entries))
    for item in recording.attachments.values():
        writer.add_attachment(0, 0, item.name, item.media_type, item.data)
    return copy_messages(recording, writer, chosen)


def copy_messages(
    recording: Recording,
    writer: Writer,
    chosen: Callable[[Block], NDArray[np.bool_]] | None = None,
) -> int:
    """Copy messages with their schemas and channels -> how many.

    chosen  a block -> (K,) bool: which of its messages; None: all of them
    """
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count = 0
    for block in recording.blocks():
        for old, schema in block.schemas.items():
            if old not in schemas:
                schemas[old] = writer.register_schema(schema.name, schema.encoding, schema.data)
        for old, channel in block.channels.items():
            if old not in channels:
                channels[old] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    schemas.get(channel.schema_id, 0),  # its schema may be damaged
                    channel.metadata,
                )
        messages = _messages(block)
        if chosen is not None:
            messages = messages[chosen(block)]
        for number, sequence, log_time, publish_time, start, end in messages.tolist():
            data = block.data[start:end]
            writer.add_message(channels[number], log_time, data, publish_time, sequence)
        count += len(messages)
    writer.finish()
    return count


def _attachment(stream: IO[bytes], span: Span) -> Attachment:
    """A file inside the file; raises one of `DAMAGE` where it is not as it was written."""
    content = read_content(stream, span)
    item = records.Attachment.read(content)
    stream.seek(span.start)
    *_, told = struct.unpack("<I", (whole := stream.read(span.length))[-4:])
    if told not in (0, zlib.crc32(whole[:-4])):
        raise McapError("its checksum differs")
    return Attachment(item.name, item.media_type, item.data)


def _messages(block: Block) -> Integers:
    """Channel, sequence, log time, publish time, start and end of each message: (K, 6)."""
    columns = (block.channel, block.sequence, block.log_time_ns, block.publish_time_ns)
    return np.column_stack([*columns, block.start, block.end])


def _chosen(block: Block, topic: str) -> NDArray[np.intp]:
    """Messages of a block that belong to a topic."""
    numbers = [number for number, channel in block.channels.items() if channel.topic == topic]
    return np.flatnonzero(np.isin(block.channel, numbers))


def _links(block: Block, chosen: NDArray[np.intp], links: dict[str, int]) -> Integers:
    """Number of the link that each chosen frame came by; new links are added to `links`."""
    names = {number: block.channels[number].metadata.get(LINK, "") for number in block.channels}
    number_of = {
        number: links.setdefault(names[number], len(links))
        for number in dict.fromkeys(block.channel[chosen].tolist())
    }
    return np.array([number_of[n] for n in block.channel[chosen].tolist()], np.int64)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise BadInput(f"{path}: cannot be read: {reason}: give a recording (.mcap)") from error
