"""DataFlash logs (.BIN): what an ArduPilot autopilot wrote on board."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.columns import frozen
from gateway.ingest.dataflash_clock import clocks, unix_minus_boot_ns
from gateway.ingest.dataflash_formats import HEADER, Format, decoded, fmt_itself, formats, sizes
from gateway.ingest.dataflash_walk import Tally, walk_messages
from gateway.ingest.files import looks_like, read_bytes
from gateway.ingest.frame_headers import group
from gateway.ingest.log import Statistics, Table
from sim.state import Ints

REORDERED_US = 1_000_000  # the logger itself mixes messages by some ms: that is no step back


@dataclass
class DataflashLog:
    """An opened DataFlash log: where its accepted messages lie."""

    path: str
    data: NDArray[np.uint8] = field(repr=False)
    offset: Ints = field(repr=False)  # (K,) start of each message
    type: Ints = field(repr=False)  # (K,)
    tally: Ints = field(repr=False)
    kind: str = "dataflash"
    _tables: dict[str, Table] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def open(cls, path: str | Path) -> "DataflashLog":
        """Reads a file to its end."""
        return cls.from_bytes(read_bytes(path), str(path))

    @classmethod
    def from_bytes(cls, raw: bytes, path: str = "dataflash") -> "DataflashLog":
        """The same from bytes in memory; `path` names them in messages."""
        data = np.frombuffer(raw, np.uint8)
        log = cls(path, data, *walk_messages(data, sizes()))
        if not set(log.counts()) - {"FMT"}:
            raise BadInput(f"{path} holds no DataFlash message: it looks like {looks_like(raw)}")
        return log

    @cached_property
    def formats(self) -> Mapping[int, Format]:
        """Type -> format, from the log's own FMT records."""
        return formats(self._records(fmt_itself()))

    @cached_property
    def time_us(self) -> Ints:
        """Time since boot of each message; where it tells none, that of the one before: (K,)."""
        width, scale = np.zeros(256, np.int64), np.ones(256, np.int64)
        for number, layout in self.formats.items():
            if layout.clock:
                width[number] = layout.dtype["f0"].itemsize
                scale[number] = 1 if layout.clock == "TimeUS" else 1000
        return frozen(clocks(self.data, self.offset, self.type, width, scale))

    @cached_property
    def unix_minus_boot_ns(self) -> int:
        """Unix time minus boat time [ns]; 0 where the GPS never told the time."""
        layout = self._by_name.get("GPS")
        return unix_minus_boot_ns(self._columns(layout)) if layout else 0

    @cached_property
    def statistics(self) -> Statistics:
        """What was found while reading."""
        garbled = int(self.tally[Tally.GARBLED])
        notes = []
        if garbled:
            notes.append(f"{garbled} message(s) refused: bytes are missing inside")
        if not self.unix_minus_boot_ns:
            notes.append("no GPS time: times count from the boot of the autopilot")
        return Statistics(
            size_bytes=len(self.data),
            accepted=len(self.offset),
            junk_bytes=int(self.tally[Tally.JUNK_BYTES]),
            unknown_messages=int(self.tally[Tally.UNKNOWN]),
            truncated_tail=bool(self.tally[Tally.TRUNCATED_TAIL]),
            lost=self._dropped(),
            time_backwards=int(np.count_nonzero(np.diff(self.time_us) < -REORDERED_US)),
            notes=tuple(notes),
        )

    def counts(self) -> Mapping[str, int]:
        """Message name -> number of accepted messages, by name."""
        numbers = np.bincount(self.type, minlength=256)
        found = {f.name: int(numbers[t]) for t, f in self.formats.items() if numbers[t]}
        return dict(sorted(found.items()))

    def table(self, name: str) -> Table:
        """All messages of that name (an empty table where there is none)."""
        if name not in self._tables:
            self._tables[name] = self._decoded(name)
        return self._tables[name]

    def _decoded(self, name: str) -> Table:
        layout = self._by_name.get(name)
        rows = self._rows(layout) if layout else self.offset[:0]
        time_us = frozen(self.time_us[rows])
        nobody = frozen(np.zeros(len(rows), np.uint8))
        return Table(
            name=name,
            order=frozen(rows),
            receive_time_ns=frozen(time_us * 1000 + self.unix_minus_boot_ns),
            system=nobody,
            component=nobody,
            columns={**self._columns(layout), "time_us": time_us} if layout else {},
        )

    def _columns(self, layout: Format) -> dict[str, NDArray[np.generic]]:
        return decoded(self._records(layout), layout)

    def _records(self, layout: Format) -> NDArray[np.void]:
        """All messages of one format, packed as they lie in the log: (K,)."""
        size = layout.dtype.itemsize
        # every stretch of that size is one element: taking some of them copies each at once
        shape = (max(len(self.data) - size + 1, 0),)
        stretches = np.ndarray(shape, f"V{size}", self.data, strides=(1,))
        return stretches[self.offset[self._rows(layout)] + HEADER].view(layout.dtype)

    def _rows(self, layout: Format) -> Ints:
        order, starts = self._groups
        return order[starts[layout.type] : starts[layout.type + 1]]

    def _dropped(self) -> int:
        """What the logger itself could not write, by its own count."""
        layout = self._by_name.get("DSF")
        dropped = self._columns(layout).get("Dp") if layout else None
        return int(dropped.max()) if dropped is not None and len(dropped) else 0

    @cached_property
    def _by_name(self) -> Mapping[str, Format]:
        return {layout.name: layout for layout in self.formats.values()}

    @cached_property
    def _groups(self) -> tuple[Ints, Ints]:
        return group(self.type, 255)
