"""Where the records of an MCAP file stand: of one that is whole, unfinished or damaged.

A record is an opcode (1 byte), a length (8 bytes) and that many bytes. Most kinds say inside once
more how long they are, and that tells damage at once: where the two disagree, the walk goes on at
the next place where a record of a known kind begins. What does not fit into the file any more was
being written when the writer died, and ends the recording. Records of a kind that is not known are
passed over, as the format asks (0x80 and above belong to applications).
"""

import re
import struct
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

PREFIX = struct.Struct("<BQ")
PREFIX_BYTES = 9
MESSAGE_HEAD_BYTES = 22  # channel, sequence, two times
COMPRESSIONS = (b"", b"lz4", b"zstd")
CHUNK_HEAD_BYTES = 28  # before the name of its compression
WINDOW_BYTES = 1 << 20  # searched at once
MAX_LENGTH = 1 << 40  # of a record; a length beyond is damage
MAX_TRIES = 500_000  # places that only look like a record; more has no file that is worth it

# What a record consists of: a number is so many bytes, "I" and "Q" are a length of four or eight
# bytes and as many bytes as it says. Messages have no length of their own.
LAYOUTS: dict[int, tuple[int | str, ...]] = {
    Opcode.HEADER: ("I", "I"),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, "I", "I", "I"),
    Opcode.CHANNEL: (4, "I", "I", "I"),
    Opcode.CHUNK: (CHUNK_HEAD_BYTES, "I", "Q"),
    Opcode.MESSAGE_INDEX: (2, "I"),
    Opcode.CHUNK_INDEX: (32, "I", 8, "I", 16),
    Opcode.ATTACHMENT: (16, "I", "I", "Q", 4),
    Opcode.ATTACHMENT_INDEX: (40, "I", "I"),
    Opcode.STATISTICS: (42, "I"),
    Opcode.METADATA: ("I", "I"),
    Opcode.METADATA_INDEX: (16, "I"),
    Opcode.SUMMARY_OFFSET: (17,),
    Opcode.DATA_END: (4,),
}
KNOWN = frozenset({*LAYOUTS, int(Opcode.MESSAGE)})


class Span(NamedTuple):
    """Where the content of a record stands in the file."""

    opcode: int
    start: int
    length: int

    @property
    def end(self) -> int:
        """Where the next record begins."""
        return self.start + self.length


class Gap(NamedTuple):
    """Bytes in which no record could be found; `before` is the number of records before it."""

    before: int
    start: int
    end: int


class Spans(NamedTuple):
    """All records that were found, and in what state the file is."""

    records: tuple[Span, ...]
    finished: bool  # its writer wrote the footer
    gaps: tuple[Gap, ...] = ()  # damage with records behind it
    mended: int = 0  # chunks whose opcode or length is damaged, and which are read all the same
    tail_bytes: int = 0  # behind the last record of an unfinished file; bytes of zero not counted


def read_spans(stream: IO[bytes], size: int) -> Spans:
    """Walk over all records up to the footer or to what a killed writer left undone."""
    return _Walk(stream, size).spans()


class _Walk:
    """The walk over one file."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream, self._size, self._tries = stream, size, 0

    def spans(self) -> Spans:
        """All records from the first on."""
        found: list[Span] = []
        gaps: list[Gap] = []
        mended, at = 0, len(MCAP0_MAGIC)
        while at + PREFIX_BYTES <= self._size:
            span = self._declared(at)
            if span is None and (span := self._chunk(at)) is not None:
                mended += 1
            if span is None:
                if (behind := self._search(at + 1)) is None:
                    break
                gaps.append(Gap(len(found), at, behind))
                at = behind
                continue
            found.append(span)
            at = span.end
            if span.opcode == Opcode.FOOTER:
                finished = self._at(at, len(MCAP0_MAGIC)) == MCAP0_MAGIC
                return Spans(tuple(found), finished, tuple(gaps), mended)
        return Spans(tuple(found), False, tuple(gaps), mended, self._written(at))

    def _at(self, place: int, count: int) -> bytes:
        self._stream.seek(place)
        return self._stream.read(count)

    def _declared(self, at: int) -> Span | None:
        """The record at a place as its opcode and length say; None where these are damaged."""
        opcode, length = PREFIX.unpack(self._at(at, PREFIX_BYTES))
        span = Span(opcode, at + PREFIX_BYTES, length)
        if opcode == 0 or span.end > self._size:
            return None
        if opcode in LAYOUTS:
            told = self._told(LAYOUTS[opcode], span)
            return span if told == length or (told < length and self._goes_on(span.end)) else None
        if (chunk := self._chunk(at)) is not None and chunk.length == length:
            return None  # a chunk under another opcode
        if opcode == Opcode.MESSAGE and length < MESSAGE_HEAD_BYTES:
            return None
        return span if self._goes_on(span.end) else None

    def _told(self, layout: tuple[int | str, ...], span: Span) -> int:
        """How long a record is by the lengths inside it [bytes]; beyond the record: damaged."""
        at = span.start
        for part in layout:
            if isinstance(part, int):
                at += part
                continue
            size = struct.calcsize("<" + part)
            if at + size > span.end:
                return span.length + 1
            at += size + int.from_bytes(self._at(at, size), "little")
        return at - span.start

    def _chunk(self, at: int) -> Span | None:
        """The chunk at a place by what it says inside, where a record follows it."""
        head = self._at(at + PREFIX_BYTES + CHUNK_HEAD_BYTES, 16)
        for name in COMPRESSIONS:
            before = len(name).to_bytes(4, "little") + name
            if head.startswith(before) and len(head) >= len(before) + 8:
                packed = int.from_bytes(head[len(before) : len(before) + 8], "little")
                length = CHUNK_HEAD_BYTES + len(before) + 8 + packed
                span = Span(int(Opcode.CHUNK), at + PREFIX_BYTES, length)
                follows = packed and span.end + PREFIX_BYTES <= self._size
                return span if follows and self._begins(span.end) else None
        return None

    def _begins(self, at: int) -> bool:
        """Does a record of a known kind begin here?"""
        opcode, length = PREFIX.unpack(self._at(at, PREFIX_BYTES))
        span = Span(opcode, at + PREFIX_BYTES, length)
        if span.end > self._size:
            return False
        if opcode == Opcode.MESSAGE:
            return length >= MESSAGE_HEAD_BYTES and self._goes_on(span.end)
        return opcode in LAYOUTS and self._told(LAYOUTS[opcode], span) == length

    def _goes_on(self, at: int) -> bool:
        """Could a record begin here, the last one that a killed writer began, or the empty end?"""
        if at + PREFIX_BYTES > self._size:
            return True
        opcode, length = PREFIX.unpack(self._at(at, PREFIX_BYTES))
        return length < MAX_LENGTH and (opcode in KNOWN or opcode >= 0x80 or not opcode | length)

    def _search(self, at: int) -> int | None:
        """The next place where a record of a known kind begins and what follows is one too."""
        zeros = 8 - (self._size.bit_length() + 7) // 8  # of a length, at its end
        begins = re.compile(rb"[\x01-\x0f](?=.{%d}\0{%d})" % (8 - zeros, zeros), re.DOTALL)
        while at + PREFIX_BYTES <= self._size:
            window = self._at(at, WINDOW_BYTES + PREFIX_BYTES - 1)
            for match in begins.finditer(window):
                if self._begins(place := at + match.start()) and self._is_followed(place):
                    return place
                self._tries += 1
                if self._tries > MAX_TRIES:
                    return None
            at += WINDOW_BYTES
        return None

    def _is_followed(self, at: int) -> bool:
        """A record that begins here: does another one follow, or the end of a whole file?"""
        opcode, length = PREFIX.unpack(self._at(at, PREFIX_BYTES))
        end = at + PREFIX_BYTES + length
        if opcode == Opcode.FOOTER:
            return self._at(end, len(MCAP0_MAGIC)) == MCAP0_MAGIC
        return self._goes_on(end)

    def _written(self, at: int) -> int:
        """How many bytes from here to the end are not zero."""
        count = 0
        for place in range(at, self._size, WINDOW_BYTES):
            window = self._at(place, min(WINDOW_BYTES, self._size - place))
            count += len(window) - window.count(0)
        return count
