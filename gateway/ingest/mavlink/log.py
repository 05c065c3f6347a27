"""Logs of MAVLink frames: telemetry logs (.tlog), and the frames of the gateway's own recording.

Raw frames in the order of receipt, whatever container they came from, become tables. Sequence
numbers show which frames of a source were lost, late or doubled.

The order in the file is that of receipt: where the receiver's clock was set back, stamps are not.
A file whose stamps go back again and again is in disorder itself, where its sequence numbers are
more nearly whole in the order of the stamps: then that is the order of receipt.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput, counted
from gateway.ingest import looks_like
from gateway.ingest.clock import STEP_BACK
from gateway.ingest.log import (
    Boat,
    BoatSamples,
    ListedParameter,
    Log,
    Statistics,
    Table,
    columns,
    decode_tables,
    frozen,
)
from gateway.ingest.mapping import banner
from gateway.ingest.mavlink.frames import (
    GOOD,
    Bytes,
    Headers,
    Tally,
    check_frames,
    checksum_seeds,
    checksum_table,
    definitions,
    examine,
    gather,
    group,
    ids_by_name,
    layout,
    read_headers,
    read_stamps,
    walk_records,
)
from gateway.ingest.mavlink.mapping import (
    AUTOPILOT_INVALID,
    from_heartbeats,
    from_motion,
    rules_of,
)
from gateway.ingest.mavlink.senders import (
    SeveralSenders,
    components_notice,
    motion_of,
    senders_notice,
    series_of,
)
from sim.kernel.compiled import compiled
from sim.state import Ints

if TYPE_CHECKING:
    from gateway.recording.reader import Recording


SOURCES = 65536  # systems × components
WHOLE = (1, 2, 3, 4, 5, 6)  # MAV_PARAM_TYPE of integers of up to 32 bits
MAX_STEPS = 32  # of a receiver's clock that was set back; chosen
LATE = 32  # a sequence number that steps back less than this is a late frame, not a loss, …
REBOOT = 6  # … but where so many follow one another from there on


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
def unnumbered(h: Headers) -> NDArray[np.bool_]:
    """Headers (K,) -> which sources (SOURCES,) give all their frames the same number.

    Of two alike frames one may be doubled: a third one shows that the number never changes.
    """
    first, count = np.full(SOURCES, -1, np.int64), np.zeros(SOURCES, np.int64)
    changes = np.zeros(SOURCES, np.bool_)
    for i in range(len(h.offset)):
        source = np.int64(h.system[i]) * 256 + h.component[i]
        count[source] += 1
        if first[source] < 0:
            first[source] = h.sequence[i]
        elif first[source] != h.sequence[i]:
            changes[source] = True
    return ~changes & (count > 2)


@compiled
def continuity(data: Bytes, h: Headers) -> tuple[int, int, int]:
    """Headers (K,) -> frames lost, late, doubled, each source (system, component) by itself.

    A source whose numbers never change tells none of these.
    """
    lost = late = doubled = 0
    silent = unnumbered(h)
    last = np.full(SOURCES, -1, np.int64)  # frame before this one
    expected = np.zeros(SOURCES, np.int64)
    restart = np.full(SOURCES, -1, np.int64)  # follows if a step back was a reboot
    follow = np.zeros(SOURCES, np.int64)  # frames that followed one another after a step back
    for i in range(len(h.offset)):
        source = np.int64(h.system[i]) * 256 + h.component[i]
        if silent[source]:
            continue
        number, after = np.int64(h.sequence[i]), (np.int64(h.sequence[i]) + 1) & 0xFF
        before, last[source] = last[source], i
        gap = (number - expected[source]) & 0xFF
        if before >= 0 and same_frame(data, h, before, i):
            doubled += 1
        elif before >= 0 and gap > 256 - LATE:
            follow[source] = follow[source] + 1 if number == restart[source] else 1
            late += 1
            restart[source] = after
            if follow[source] == REBOOT:
                late -= REBOOT
                restart[source], expected[source] = -1, after
        else:
            if before >= 0:
                lost += gap
            restart[source], expected[source] = -1, after
    return max(lost - late, 0), late, doubled  # a late frame's empty place was counted as a loss


AUTOPILOT_BYTE = 5  # of the payload of HEARTBEAT


@dataclass(frozen=True)
class Frames:
    """Accepted frames: their checksum holds and their message is known.

    data             (n,)  uint8: the bytes that all offsets refer to
    headers                where each frame and its payload lie, (K,) each
    receive_time_ns  (K,)  int64 Unix ns
    statistics             what was found while they were read
    several                sources (system, component) that several senders share: how many they are
    numbers                headers of the accepted frames and of those of messages without a
                           definition, which have a sequence number too
    numbers_time_ns        their receipt, int64 Unix ns
    """

    data: NDArray[np.uint8]
    headers: Headers
    receive_time_ns: Ints
    statistics: Statistics
    numbers: Headers
    numbers_time_ns: Ints
    _groups: tuple[Ints, Ints] = field(repr=False)
    several: SeveralSenders = field(default_factory=dict)
    _tables: dict[str, Table] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def from_records(cls, raw: bytes) -> "Frames":
        """The frames of a .tlog: each behind its time stamp."""
        data = np.frombuffer(raw, np.uint8)
        offset, unread, tally = walk_records(data, checksum_seeds(), checksum_table())
        both = np.concatenate([offset, unread])
        return _described(data, both, read_stamps(data, both), len(offset), tally)

    @classmethod
    def from_buffer(cls, raw: bytes, start: Ints, end: Ints, receive_time_ns: Ints) -> "Frames":
        """One frame in each raw[start:end] (K,); those that do not hold are counted, not kept."""
        data = np.frombuffer(raw, np.uint8)
        start, end = np.asarray(start, np.int64), np.asarray(end, np.int64)
        accepted, unread, tally = check_frames(data, start, end, checksum_seeds(), checksum_table())
        both = np.concatenate([accepted, unread])
        times = np.asarray(receive_time_ns, np.int64)[both]
        return _described(data, start[both], times, len(accepted), tally)

    def __len__(self) -> int:
        return len(self.headers.offset)

    def raw(self, i: int) -> bytes:
        """The bytes of one frame as they were received."""
        start, length = self.headers.offset[i], self.headers.length[i]
        return self.data[start : start + length].tobytes()

    def counts(self) -> Mapping[str, int]:
        """Message name -> number of frames, by name."""
        starts = self._groups[1]
        found = {layout(int(n)).name: int(starts[n + 1] - starts[n]) for n in _present(starts)}
        return dict(sorted(found.items()))

    def table(self, name: str) -> Table:
        """All messages of that name as columns (an empty table where there is none)."""
        if name not in self._tables:
            self._tables[name] = self._decoded(name)
        return self._tables[name]

    def _decoded(self, name: str) -> Table:
        number = ids_by_name().get(name)
        order, starts = self._groups
        rows = order[:0] if number is None else order[starts[number] : starts[number + 1]]
        return Table(
            name=name,
            order=frozen(rows),
            receive_time_ns=frozen(self.receive_time_ns[rows]),
            system=frozen(self.headers.system[rows]),
            component=frozen(self.headers.component[rows]),
            columns={} if number is None else self._columns(number, rows),
        )

    def _columns(self, number: int, rows: Ints) -> Mapping[str, NDArray[np.generic]]:
        plan = layout(number)
        h, size = self.headers, plan.dtype.itemsize
        payloads = gather(self.data, h.payload_offset, h.payload_length, rows, size)
        return columns(payloads.view(plan.dtype), plan.fields)


def _described(
    data: NDArray[np.uint8], offset: Ints, times: Ints, accepted: int, tally: Ints
) -> Frames:
    """Frames in order of receipt, with their headers read and their statistics counted.

    The first `accepted` of those at `offset` are, the others are of messages without a definition.
    """
    steps, backwards = (int((np.diff(times[:accepted]) < limit).sum()) for limit in (-STEP_BACK, 0))
    placed = np.argsort(offset, kind="stable")
    known, offset, times = placed < accepted, offset[placed], times[placed]
    numbers, notes = read_headers(data, offset), tuple[str, ...]()
    if steps > MAX_STEPS:
        order = _by_stamp(times, numbers.sequence)
        by_stamp = read_headers(data, offset[order])
        if continuity(data, by_stamp)[0] <= continuity(data, numbers)[0]:
            numbers, times, known, notes = by_stamp, times[order], known[order], (_disorder(steps),)
        else:
            notes = (_flapping(steps),)
    headers, receive_time_ns = Headers._make(column[known] for column in numbers), times[known]
    for array in (*headers, receive_time_ns, *numbers, times):
        array.setflags(write=False)
    several = series_of(numbers)
    found = _statistics(data, numbers, tally, several)
    statistics = replace(
        found, accepted=accepted, time_backwards=backwards, notes=(*notes, *found.notes)
    )
    groups = group(headers.message_id, max(definitions()))
    return Frames(data, headers, receive_time_ns, statistics, numbers, times, groups, several)


def _by_stamp(times: Ints, sequence: NDArray[np.uint8]) -> Ints:
    """The order (K,) by stamp; frames of one stamp by their numbers, which go on at 0 after 255."""
    group = np.unique(times, return_inverse=True)[1]
    least, most = np.full(len(times), 255), np.zeros(len(times), np.int64)
    np.minimum.at(least, group, sequence)
    np.maximum.at(most, group, sequence)
    turned = (most - least > 128)[group] & (sequence < 128)
    return np.lexsort((sequence + 256 * turned, times))


def _statistics(
    data: NDArray[np.uint8], headers: Headers, tally: Ints, several: SeveralSenders
) -> Statistics:
    """What was found; of sources of several senders frames are lost in each series by itself."""
    lost, late, doubled = continuity(data, _without(headers, [*several, *passed_on(data, headers)]))
    lost += sum(lost_of for _, lost_of in several.values())
    return Statistics(
        size_bytes=len(data),
        accepted=len(headers.offset),
        bad_checksum=int(tally[Tally.BAD_CHECKSUM]),
        junk_bytes=int(tally[Tally.JUNK_BYTES]),
        unknown_messages=int(tally[Tally.UNKNOWN]),
        signed=int(np.count_nonzero(headers.signed)),
        mavlink1=int(np.count_nonzero(headers.version == 1)),
        mavlink2=int(np.count_nonzero(headers.version == 2)),
        truncated_tail=bool(tally[Tally.TRUNCATED_TAIL]),
        lost=int(lost),
        duplicates=int(doubled),
        notes=(*((_late(int(late)),) if late else ()), *_about_unnumbered(headers)),
    )


def passed_on(data: NDArray[np.uint8], headers: Headers) -> list[tuple[int, int]]:
    """Sources (system, component) that say they are no autopilot: ground stations, companions.

    A boat or a router that passes their frames on chooses among them: numbers that are missing
    tell of no loss.
    """
    beats = np.flatnonzero((headers.message_id == 0) & (headers.payload_length > AUTOPILOT_BYTE))
    autopilot = data[headers.payload_offset[beats] + AUTOPILOT_BYTE]
    none = beats[autopilot == AUTOPILOT_INVALID]
    return sorted({(int(headers.system[i]), int(headers.component[i])) for i in none})


def _without(headers: Headers, sources: Collection[tuple[int, int]]) -> Headers:
    """The headers of all other sources."""
    if not sources:
        return headers
    of_source = headers.system.astype(np.int64) * 256 + headers.component
    others = ~np.isin(of_source, [system * 256 + component for system, component in sources])
    return Headers._make(column[others] for column in headers)


def _present(starts: Ints) -> Ints:
    """Message ids of which there is at least one."""
    return np.flatnonzero(np.diff(starts))


def _disorder(steps: int) -> str:
    return (
        f"its frames are in disorder: their time stamps go back {steps} times; read in the order "
        "of the stamps"
    )


def _flapping(steps: int) -> str:
    return (
        f"the receiver's clock was set back {steps} times, though the frames are in order: when "
        "they were received is not known"
    )


def _about_unnumbered(headers: Headers) -> tuple[str, ...]:
    """A sentence about sources whose frames all have the same number."""
    of_source = headers.system.astype(np.int64) * 256 + headers.component
    count = int(np.count_nonzero(unnumbered(headers)[of_source]))
    if not count:
        return ()
    return (
        f"{counted(count, 'frame')} of sources whose sequence numbers never change: whether any "
        "were lost or late is not known",
    )


def _late(count: int) -> str:
    if count == 1:
        return "1 frame came after a later one of its source"
    return f"{count} frames came after later ones of their source"


@dataclass(frozen=True)
class MavlinkLog(Log):
    """An opened log of MAVLink frames.

    frames     the accepted ones in order of receipt
    recording  the gateway's own recording that they come from, where it is one
    """

    path: str
    frames: Frames
    statistics: Statistics
    kind: str = "tlog"
    recording: "Recording | None" = None

    def counts(self) -> Mapping[str, int]:
        return self.frames.counts()

    def table(self, name: str) -> Table:
        return self.frames.table(name)

    def boats(self) -> tuple[Boat, ...]:
        """The autopilots, by their HEARTBEAT or else by the motion that they report.

        Of several components of one system the one that tells most of its motion comes first.
        """
        found = from_heartbeats(self.table("HEARTBEAT")) or from_motion(self)
        if len({boat.system for boat in found}) == len(found):
            return found
        return tuple(sorted(found, key=lambda boat: (boat.system, -len(motion_of(self, boat)))))

    def decode(self, boat: Boat) -> BoatSamples:
        found = decode_tables(self, boat, rules_of(boat))
        senders, _ = self.frames.several.get((boat.system, boat.component), (1, 0))
        notices = *senders_notice(boat, found, senders), *components_notice(self, boat)
        return replace(found, notices=(*found.notices, *notices))

    def listed_parameters(self, boat: Boat) -> list[ListedParameter]:
        """All PARAM_VALUE, also of values told before; PX4 sends whole numbers bit by bit."""
        table = self.table("PARAM_VALUE")
        columns = _whole_numbers(table) if boat.autopilot == "PX4" else table.columns
        return replace(table, columns=columns).listed("param_id", "param_value", boat)

    def firmware(self, boat: Boat) -> str:
        """Banner of a STATUSTEXT, else the version of AUTOPILOT_VERSION."""
        return banner(self.table("STATUSTEXT").texts("text", boat)) or _version(
            self.table("AUTOPILOT_VERSION"), boat
        )


def tlog_from_bytes(raw: bytes, path: str = "tlog") -> MavlinkLog:
    """A telemetry log, read to its end; `path` names it in messages."""
    if _unstamped(raw):
        raise BadInput(f"{path} is MAVLink without time stamps: a .tlog has one before each frame")
    frames = Frames.from_records(raw)
    if not len(frames):
        raise BadInput(
            f"{path} holds no MAVLink frame with a time stamp: it looks like {looks_like(raw)}"
        )
    return MavlinkLog(path, frames, frames.statistics)


def _unstamped(raw: bytes) -> bool:
    """Do two good frames stand at the start without a time stamp?"""
    data, at = np.frombuffer(raw, np.uint8), 0
    for _ in range(2):
        verdict, length = examine(data, at, len(data), checksum_seeds(), checksum_table())
        if verdict != GOOD:
            return False
        at += int(length)
    return True


def _whole_numbers(table: Table) -> dict[str, NDArray[np.generic]]:
    """The columns of PARAM_VALUE, its integers read from the bits of the float that bears them; one
    that is a whole number as a float was written so by somebody else.
    """
    columns = dict(table.columns)
    told, kind = columns.get("param_value"), columns.get("param_type")
    if told is None or kind is None or told.dtype != np.float32:
        return columns
    bits = np.ascontiguousarray(told).view(np.int32)
    whole = np.isin(kind, WHOLE) & ~(np.isfinite(told) & (np.abs(told) >= 1.0))
    return columns | {"param_value": np.where(whole, bits, np.asarray(told, np.float64))}


def _version(table: Table, boat: Boat) -> str:
    """flight_sw_version: one byte each for major, minor, patch, kind of release."""
    mine = table.sent_by(boat)
    if not mine.any():
        return ""
    packed = int(np.asarray(table.columns["flight_sw_version"])[mine][-1])
    major, minor, patch = packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255
    return f"version {major}.{minor}.{patch}" if packed else ""
