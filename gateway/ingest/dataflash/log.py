"""DataFlash logs (.BIN): what an ArduPilot autopilot wrote on board.

Times are the autopilot's microseconds, placed on Unix time by its GPS. Of several lanes of its
Kalman filter the one is read that is in use at each moment. The gyro is logged as it is measured:
the filter's own estimate of its bias is subtracted here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest import looks_like
from gateway.ingest.dataflash.lanes import LanesInUse, gyro_bias, lanes_in_use
from gateway.ingest.dataflash.mapping import LANE, RULES
from gateway.ingest.dataflash.records import (
    HEADER,
    Format,
    Tally,
    decoded,
    fmt_itself,
    formats,
    sizes,
    walk_messages,
)
from gateway.ingest.log import (
    Boat,
    BoatSamples,
    ListedParameter,
    Log,
    Statistics,
    Table,
    decode_tables,
    frozen,
    lanes_notice,
    numbers,
)
from gateway.ingest.mapping import CREDIBLE_US, banner
from gateway.ingest.mavlink.frames import group
from gateway.samples import Quantity, Samples
from sim.kernel.compiled import compiled
from sim.state import Ints

Bytes = NDArray[np.uint8]
U = np.uint64
PAYLOAD = 3  # behind the magic bytes and the type
GPS_EPOCH_S = 315_964_800  # 1980-01-06 in Unix time
WEEK_S = 604_800
LEAP_S = 18  # GPS − UTC since 2017, as in pymavlink
REORDERED_US = 1_000_000  # the logger itself mixes messages by some ms: that is no step back
LONE_US = 60_000_000  # one stamp that is so far from both its neighbours is none
VEHICLES = {  # how the banner begins -> what the vehicle is
    "ArduRover": "rover or boat",
    "ArduSub": "submarine",
    "ArduCopter": "multicopter",
    "ArduPlane": "plane",
    "APM:Rover": "rover or boat",  # until 2016
    "APMrover2": "rover or boat",
    "APM:Copter": "multicopter",
    "APM:Plane": "plane",
}
GPS_TIME = (("GWk", "GMS"), ("Week", "TimeMS"))  # columns of week and time of week, now and in 2014


@compiled
def clocks(
    data: Bytes, offset: Ints, kind: Ints, width: Ints, scale: Ints
) -> tuple[Ints, int]:  # fmt: skip
    """Time of each message, or of the one before where it has none or none that can be: (K,) [µs
    since boot]; and how many had one that cannot be.

    width, scale  (256,)  by type: bytes of the clock at the front (8, 4 or 0: none), µs per count
    """
    times, wild = np.empty(len(offset), np.int64), 0
    now = np.int64(-1)
    for i in range(len(offset)):
        number, start = kind[i], U(offset[i] + PAYLOAD)
        if width[number] > 0:
            count = U(0)
            if width[number] == 8:  # a loop of constant length becomes one load
                for k in range(8):
                    count |= U(data[start + U(k)]) << U(8 * k)
            else:
                for k in range(4):
                    count |= U(data[start + U(k)]) << U(8 * k)
            if count < U(CREDIBLE_US):
                first = now < 0
                now = np.int64(count) * scale[number]
                if first:  # what stands before the first clock (FMT records) is as old
                    times[:i] = now
            else:
                wild += 1
        times[i] = now
    return times, wild


def without_lone(times: Ints) -> tuple[Ints, int]:
    """Times (K,) [µs] in which one message alone is far from those around it takes the time of the
    one before; and how many do.
    """
    step = np.diff(times)
    near = np.abs(times[2:] - times[:-2]) < LONE_US
    lone = np.flatnonzero((np.abs(step[:-1]) > LONE_US) & (np.abs(step[1:]) > LONE_US) & near) + 1
    mended = times.copy()
    mended[lone] = times[lone - 1]
    return mended, len(lone)


def unix_minus_boot_ns(gps: Mapping[str, NDArray[Any]]) -> int:
    """Unix time minus boat time by the first known time of GPS, or 0 [ns].

    gps  its columns, and `time_us`, the boat's time of each row
    """
    names = next((names for names in GPS_TIME if set(names) <= set(gps)), None)
    if names is None:
        return 0
    week, tow_ms, boot_us = numbers(gps[names[0]]), numbers(gps[names[1]]), gps["time_us"]
    known = np.flatnonzero((week > 0.0) & np.isfinite(tow_ms))
    if not len(known):
        return 0
    k = known[0]
    unix_s = GPS_EPOCH_S + WEEK_S * int(week[k]) - LEAP_S
    return unix_s * 10**9 + int(tow_ms[k]) * 10**6 - int(boot_us[k]) * 1000


@dataclass
class DataflashLog(Log):
    """An opened DataFlash log: where its accepted messages lie."""

    path: str
    data: NDArray[np.uint8] = field(repr=False)
    offset: Ints = field(repr=False)  # (K,) start of each message
    type: Ints = field(repr=False)  # (K,)
    tally: Ints = field(repr=False)
    kind: str = "dataflash"
    statistics: Statistics = field(init=False, repr=False)
    _tables: dict[str, Table] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def from_bytes(cls, raw: bytes, path: str = "dataflash") -> "DataflashLog":
        """Reads a log to its end; `path` names it in messages."""
        data = np.frombuffer(raw, np.uint8)
        log = cls(path, data, *walk_messages(data, sizes()))
        if not set(log.counts()) - {"FMT"}:
            raise BadInput(f"{path} holds no DataFlash message: it looks like {looks_like(raw)}")
        log.statistics = log._found()
        return log

    def boats(self) -> tuple[Boat, ...]:
        """The vehicle that the banner of the firmware names."""
        lines = self.table("MSG").texts("Message", Boat(0, 0))
        found = [kind for line in lines for name, kind in VEHICLES.items() if line.startswith(name)]
        return (Boat(0, 0, "ArduPilot", found[0] if found else ""),)

    def decode(self, boat: Boat) -> BoatSamples:
        """All samples, of the lane of the filter in use, yaw rates without the gyro's bias."""
        in_use = lanes_in_use(self)
        decoded = decode_tables(self, boat, RULES, {LANE: in_use.at})
        samples = tuple(self._without_bias(s, in_use) for s in decoded.samples)
        times = decoded.times_at(in_use.order)
        switches = in_use.switches(in_use.receive_time_ns if times is None else times)
        notices = (*decoded.notices, *lanes_notice(switches, self))
        return replace(decoded, samples=samples, lane_switches=switches, notices=notices)

    def _without_bias(self, samples: Samples, in_use: LanesInUse) -> Samples:
        """Yaw rates of the IMU -> the same minus the bias last known; others as they are."""
        if samples.quantity is not Quantity.YAW_RATE:
            return samples
        bias = gyro_bias(samples, self, in_use)
        return samples if bias is None else replace(samples, values=samples.values - bias[:, None])

    def listed_parameters(self, boat: Boat) -> list[ListedParameter]:
        """All PARM, also of values told before."""
        return self.table("PARM").listed("Name", "Value", boat)

    def firmware(self, boat: Boat) -> str:
        """Banner among the texts of MSG."""
        return banner(self.table("MSG").texts("Message", boat))

    @cached_property
    def formats(self) -> Mapping[int, Format]:
        """Type -> format, from the log's own FMT records."""
        return formats(self._records(fmt_itself()))

    @property
    def time_us(self) -> Ints:
        """Time since boot of each message; where it has none, that of the one before: (K,)."""
        return self._clock[0]

    @cached_property
    def _clock(self) -> tuple[Ints, int]:
        """Times of all messages (K,) [µs since boot], and how many had one that cannot be."""
        width, scale = np.zeros(256, np.int64), np.ones(256, np.int64)
        for number, layout in self.formats.items():
            if layout.clock:
                width[number] = layout.dtype["f0"].itemsize
                scale[number] = 1 if layout.clock == "TimeUS" else 1000
        times, wild = clocks(self.data, self.offset, self.type, width, scale)
        times, lone = without_lone(times)
        return frozen(times), wild + lone

    @cached_property
    def unix_minus_boot_ns(self) -> int:
        """Unix time minus boat time [ns]; 0 where the GPS never knew the time."""
        layout = self._by_name.get("GPS")
        if layout is None:
            return 0
        time_us = self.time_us[self._rows(layout)]
        return unix_minus_boot_ns({**self._columns(layout), "time_us": time_us})

    def _found(self) -> Statistics:
        """What was found while reading."""
        garbled = int(self.tally[Tally.GARBLED])
        notes = []
        if garbled:
            notes.append(f"{garbled} message(s) refused: bytes are missing inside")
        if wild := self._clock[1]:
            notes.append(
                f"{wild} message(s) with a time that cannot be: read as of the message before"
            )
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
        numbers = np.bincount(self.type, minlength=256)
        found = {f.name: int(numbers[t]) for t, f in self.formats.items() if numbers[t]}
        return dict(sorted(found.items()))

    def table(self, name: str) -> Table:
        if name not in self._tables:
            self._tables[name] = self._decoded(name)
        return self._tables[name]

    def _decoded(self, name: str) -> Table:
        layout = self._by_name.get(name)
        rows = self._rows(layout) if layout else self.offset[:0]
        time_us = frozen(self.time_us[rows])
        columns = {**self._columns(layout), "time_us": time_us} if layout else {}
        return Table.unaddressed(name, rows, time_us * 1000 + self.unix_minus_boot_ns, columns)

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
