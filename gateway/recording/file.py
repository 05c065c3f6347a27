"""One MCAP file being written: its channels, and nothing about when to flush, rotate or stop."""

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import IO, NamedTuple

import orjson
from mcap.writer import CompressionType, Writer

from gateway.recording import foxglove
from gateway.topics import TOPICS

RAW = "mavlink/raw"
RAW_ENCODING = "mavlink"
LINK = "link"
JSON = "json"
JSON_SCHEMA = "jsonschema"


class Compression(Enum):
    """How chunks are compressed: lz4 costs least time, zstd least room."""

    LZ4 = "lz4"
    ZSTD = "zstd"
    NONE = "none"


class Attachment(NamedTuple):
    """A file that travels inside a recording."""

    name: str
    media_type: str
    data: bytes


class RecordingFile:
    """An MCAP file with the gateway's channels, registered as they are first used."""

    def __init__(self, stream: IO[bytes], compression: Compression, chunk_bytes: int) -> None:
        self._stream = stream
        self._writer = Writer(
            stream, chunk_size=chunk_bytes, compression=CompressionType[compression.name]
        )
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._sequence: dict[int, int] = {}

    def start(
        self, attachments: Iterable[Attachment], metadata: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Write what a reader wants to know before the first message."""
        self._writer.start(profile="")
        for name, entries in metadata.items():
            self._writer.add_metadata(name, dict(entries))
        for item in attachments:
            self._writer.add_attachment(0, 0, item.name, item.media_type, item.data)
        self._writer.flush()

    def write(
        self,
        channel: int,
        log_times: Iterable[int],
        publish_times: Iterable[int],
        payloads: Iterable[bytes],
    ) -> None:
        """Append messages to one channel."""
        sequence = self._sequence[channel]
        add = self._writer.add_message
        for log_time, publish_time, payload in zip(log_times, publish_times, payloads, strict=True):
            add(channel, log_time, payload, publish_time, sequence)
            sequence = (sequence + 1) & 0xFFFFFFFF
        self._sequence[channel] = sequence

    def topic(self, name: str) -> int:
        """The channel of a topic of the table."""
        entry = TOPICS[name]
        return self._json(name, entry.schema, orjson.dumps(entry.json_schema()))

    def well_known(self, channel: foxglove.Channel) -> int:
        """The channel of a message that players know."""
        return self._json(channel.topic, channel.schema, foxglove.schema_text(channel.schema))

    def raw(self, link: str) -> int:
        """The channel of the frames of one link."""
        found = self._channels.get((RAW, link))
        if found is None:
            number = self._writer.register_channel(RAW, RAW_ENCODING, 0, {LINK: link})
            found = self._remember(RAW, link, number)
        return found

    def _json(self, topic: str, schema: str, text: bytes) -> int:
        found = self._channels.get((topic, ""))
        if found is None:
            if schema not in self._schemas:
                number = self._writer.register_schema(schema, JSON_SCHEMA, text)
                self._schemas[schema] = number
            number = self._writer.register_channel(topic, JSON, self._schemas[schema])
            found = self._remember(topic, "", number)
        return found

    def _remember(self, topic: str, link: str, channel: int) -> int:
        self._channels[topic, link] = channel
        self._sequence[channel] = 0
        return channel

    def size(self) -> int:
        """Bytes written so far, those of the open chunk left out."""
        return self._stream.tell()

    def flush(self) -> None:
        """Close the open chunk and hand everything to the operating system."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the index that makes the file whole, and close it."""
        self._writer.finish()
        self._stream.close()
