"""What is damaged in a recording: how much of it cannot be read, and how that is told."""

from collections.abc import Iterable
from typing import NamedTuple

from mcap.opcode import Opcode

from gateway.errors import counted
from gateway.recording.blocks import Block, Damaged
from gateway.recording.spans import KNOWN, Spans


class Damage(NamedTuple):
    """What of a recording cannot be read, or can be read here and by no other program."""

    chunks: int  # that are left out …
    of_chunks: int  # … of so many
    seconds: float  # between the messages before and behind what is left out
    messages: int  # whose channel stood in a chunk that is left out
    places: int  # where no record is found, or the head of a chunk is damaged
    others: tuple[str, ...]  # attachments, metadata
    tail_bytes: int  # of a record that a killed writer did not write to its end
    not_copied: int  # records of kinds that only their writer knows, or of a name that comes again

    def __bool__(self) -> bool:
        """Is anything damaged? A file that is merely unfinished is not."""
        return bool(self.chunks or self.messages or self.places or self.others)

    @property
    def drops_bytes(self) -> bool:
        """Does it hold anything that a repaired file does not?"""
        return bool(self) or self.tail_bytes > 0 or self.not_copied > 0

    def text(self) -> str:
        """One sentence without its full stop; empty where nothing is damaged."""
        parts = []
        if self.chunks:
            many = "is" if self.chunks == 1 else "are"
            parts.append(
                f"{self.chunks} of {counted(self.of_chunks, 'chunk')} {many} damaged and left out"
            )
        elif self.places:
            parts.append(f"it is damaged in {counted(self.places, 'place')}")
        if self.messages:
            parts.append(f"{counted(self.messages, 'message')} of unknown channels left out")
        for kind in dict.fromkeys(self.others):
            parts.append(f"damaged {kind} left out")
        lost = f": about {self.seconds:.1f} s" if self.seconds > 0.0 else ""
        return ", ".join(parts) + (lost if parts else "")


def damage_of(
    spans: Spans, blocks: Iterable[Block | Damaged], others: tuple[str, ...], repeated: int
) -> Damage:
    """What is missing of a recording; chunks that were not met are in the index of the file.

    others    attachments and metadata that are damaged
    repeated  how many others have a name that comes again
    """
    chunks = messages = places = 0
    for block in (timeline := _Timeline()).through(blocks):
        chunks += block.is_chunk
        places += block.is_record
        messages += block.messages
    opcodes = [span.opcode for span in spans.records]
    met, indexed = opcodes.count(Opcode.CHUNK), opcodes.count(Opcode.CHUNK_INDEX)
    unknown = sum(opcode not in KNOWN for opcode in opcodes)
    return Damage(
        chunks + max(0, indexed - met), max(met, indexed), timeline.lost_ns * 1e-9, messages,
        places + len(spans.gaps) + spans.mended, others, spans.tail_bytes, unknown + repeated,
    )  # fmt: skip


class _Timeline:
    """How much time passes where blocks are missing, by the messages before and behind."""

    def __init__(self) -> None:
        self.lost_ns = 0
        self._until: int | None = None
        self._is_torn = False

    def through(self, blocks: Iterable[Block | Damaged]) -> Iterable[Damaged]:
        """What is damaged among blocks."""
        for block in blocks:
            if isinstance(block, Damaged):
                self._is_torn = self._is_torn or not block.messages
                yield block
            elif len(block.log_time_ns):
                self._goes_on(int(block.log_time_ns.min()), int(block.log_time_ns.max()))

    def _goes_on(self, begin_ns: int, end_ns: int) -> None:
        if self._is_torn and self._until is not None:
            self.lost_ns += max(0, begin_ns - self._until)
        self._until = end_ns if self._until is None else max(self._until, end_ns)
        self._is_torn = False
