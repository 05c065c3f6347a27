"""ULog (.ulg): what a PX4 autopilot wrote on board, as tables on its microseconds and on Unix time.

pyulog parses the file and goes on behind damage as well as it can. Here: what it cannot survive
ends in one line, what it prints is not shown, and rows with impossible times are left out. Unix
time comes from its GPS: `time_ref_utc` of the file is a time zone, not a time.

Format: header 'ULog\x01\x12\x35'; definitions (formats, infos, parameters); data.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog

from gateway.errors import BadInput
from gateway.ingest.log import (
    Boat,
    BoatSamples,
    Log,
    Statistics,
    Table,
    column,
    decode_tables,
    frozen,
)
from gateway.ingest.mapping import UNIX_FROM_US
from gateway.ingest.mavlink.mapping import vehicle_type
from gateway.ingest.ulog.mapping import INSTANCE, OUTPUTS, RULES
from sim.state import Ints

TIME = "timestamp"  # µs since boot, in every topic
GPS = ("vehicle_gps_position", "sensor_gps")  # field time_utc_usec
CREDIBLE_US = 7 * 86_400 * 1_000_000  # from the middle of the log: no voyage is longer
MAX_SEEKS = 10_000  # back in a row without getting further: pyulog 1.3 goes round in circles

Columns = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Topic:
    """All messages of one topic, of all its instances, in order of their time.

    order, time_us  (K,)  position among all messages of the log; µs since boot
    """

    order: Ints
    time_us: Ints
    columns: Columns


@dataclass(frozen=True)
class UlogLog(Log):
    """An opened ULog."""

    path: str
    statistics: Statistics
    topics: Mapping[str, Topic] = field(repr=False)
    unix_minus_boot_ns: int  # 0 where the GPS never knew the time
    settings: Mapping[str, float] = field(repr=False)
    software: str
    kind: str = "ulog"

    def counts(self) -> Mapping[str, int]:
        return {name: len(topic.order) for name, topic in sorted(self.topics.items())}

    def table(self, name: str) -> Table:
        """All messages of a topic; arrays as (K, n), the instance in `multi_id`."""
        nothing = np.zeros(0, np.int64)
        topic = self.topics.get(name) or Topic(nothing, nothing, {})
        time_ns = topic.time_us * 1000 + self.unix_minus_boot_ns
        return Table.unaddressed(name, topic.order, time_ns, topic.columns)

    def boats(self) -> tuple[Boat, ...]:
        """The one vehicle, by its MAV_TYPE."""
        status = self.topics.get("vehicle_status")
        types = status.columns.get("system_type") if status else None
        number = types[-1] if types is not None else self.settings.get("MAV_TYPE", -1)
        known = vehicle_type(int(number))
        return (Boat(0, 0, "PX4", "" if known == "?" else known),)

    def decode(self, boat: Boat) -> BoatSamples:
        """All samples; of each topic the first instance that is in the log."""
        return decode_tables(self, boat, [self._with_instance(rule) for rule in RULES])

    def parameters(self, boat: Boat) -> dict[str, float]:
        """Name -> value, the last one where a parameter was changed."""
        return dict(self.settings)

    def firmware(self, boat: Boat) -> str:
        """Release and hash of the autopilot's software."""
        return self.software

    def _with_instance(self, rule: Any) -> Any:
        topic = self.topics.get(rule.message)
        if topic is None or rule.message == OUTPUTS:  # there, each instance has its channels
            return rule
        return replace(rule, number=int(np.min(topic.columns[INSTANCE])))


class _GuardedBytes(io.BytesIO):
    """Bytes that know whether the last read was cut off, and end a parser that makes no way."""

    cut = False
    _furthest = _seeks = 0

    def read(self, size: int | None = -1) -> bytes:
        found = super().read(size)
        # three bytes are the head of a message: where not one is left, the log ends as it should
        self.cut = size is not None and len(found) < size and (size != 3 or bool(found))
        return found

    def seek(self, offset: int, whence: int = 0) -> int:
        at = super().seek(offset, whence)
        further = whence != 1 or at > self._furthest
        self._furthest, self._seeks = (at, 0) if further else (self._furthest, self._seeks + 1)
        if self._seeks > MAX_SEEKS:
            raise RuntimeError("it is damaged near its start")
        return at


def ulog_from_bytes(raw: bytes, path: str = "ulog") -> UlogLog:
    """A ULog from bytes in memory; `path` names it in messages."""
    stream, printed = _GuardedBytes(raw), io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            found = ULog(stream)
    except Exception as error:  # a parser of untrusted bytes: whatever it meets is one line
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(f"{path} cannot be read as a PX4 log (.ulg): {reason}") from None
    topics, dropped = _topics(found.data_list)
    if not topics:
        raise BadInput(f"{path} holds no data: a PX4 log (.ulg) that ends behind its header")
    unix = _unix_minus_boot_ns(topics)
    parameters = {**found.initial_parameters, **{n: v for _, n, v in found.changed_parameters}}
    statistics = Statistics(
        size_bytes=len(raw),
        accepted=sum(len(topic.order) for topic in topics.values()),
        unknown_messages=dropped,
        truncated_tail=stream.cut,
        notes=_notes(found, unix, dropped),
    )
    return UlogLog(path, statistics, topics, unix, _numbers(parameters), _software(found))


def _topics(data: Sequence[Any]) -> tuple[dict[str, Topic], int]:
    """What pyulog found, by name and instance -> topics, number of rows with impossible times."""
    timed = [one for one in data if TIME in one.data]
    if not timed:
        return {}, 0
    stamps = [one.data[TIME].astype(np.uint64) for one in timed]
    middle = float(np.median(np.concatenate(stamps)))
    good = [np.abs(stamp - middle) <= CREDIBLE_US for stamp in stamps]
    times = [stamp[keep].astype(np.int64) for stamp, keep in zip(stamps, good, strict=True)]
    every = np.concatenate(times)
    place = np.empty(len(every), np.int64)
    place[np.argsort(every, kind="stable")] = np.arange(len(every))
    orders = np.split(place, np.cumsum([len(time) for time in times])[:-1])
    parts = list(zip(timed, good, times, orders, strict=True))
    topics = {}
    for name, group in groupby(parts, key=lambda part: part[0].name):  # pyulog sorts by name
        some = [part for part in group if len(part[2])]
        if some:
            topics[name] = _joined(some)
    return topics, sum(len(stamp) for stamp in stamps) - len(every)


def _joined(parts: Sequence[tuple[Any, NDArray[np.bool_], Ints, Ints]]) -> Topic:
    """The instances of one topic -> one table in order of time."""
    order = np.concatenate([part[3] for part in parts])
    by_time = np.argsort(order, kind="stable")
    each = [_columns(one.data, keep) for one, keep, _, _ in parts]
    numbers = [np.full(len(time), one.multi_id) for one, _, time, _ in parts]
    shared = set.intersection(*(set(columns) for columns in each))
    columns: Columns = {
        name: frozen(np.concatenate([columns[name] for columns in each])[by_time])
        for name in each[0]
        if name in shared
    }
    columns[INSTANCE] = frozen(np.concatenate(numbers)[by_time])
    time_us = np.concatenate([part[2] for part in parts])[by_time]
    return Topic(frozen(order[by_time]), frozen(time_us), columns)


def _columns(data: Mapping[str, NDArray[np.generic]], keep: NDArray[np.bool_]) -> Columns:
    """pyulog's columns `q[0]`, `q[1]`, … -> one column `q` (K, n); others as they are (K,)."""
    grouped: dict[str, list[NDArray[np.generic]]] = {}
    for name, values in data.items():
        stem = name.rpartition("[")[0] if name.endswith("]") else name
        grouped.setdefault(stem, []).append(column(values)[keep])
    return {
        name: parts[0] if name in data else np.stack(parts, axis=1)
        for name, parts in grouped.items()
    }


def _unix_minus_boot_ns(topics: Mapping[str, Topic]) -> int:
    """Unix time minus boat time [ns], the median over one GPS; 0 where none knew the time."""
    for name in GPS:
        if name in topics and "time_utc_usec" in topics[name].columns:
            topic = topics[name]
            unix_us = np.asarray(topic.columns["time_utc_usec"]).astype(np.int64)
            known = unix_us >= UNIX_FROM_US
            if known.any():
                return int(np.median((unix_us - topic.time_us)[known])) * 1000
    return 0


def _numbers(parameters: Mapping[str, Any]) -> dict[str, float]:
    numbers = {k: float(v) for k, v in parameters.items() if k and isinstance(v, int | float)}
    return {name: number for name, number in numbers.items() if np.isfinite(number)}


def _software(found: Any) -> str:
    """`PX4 v1.14.3 (1dacb4cd)` as far as the log holds it."""
    info = found.msg_info_dict
    name = str(info.get("sys_name", "PX4"))
    number = info.get("ver_sw_release")
    release = f"v{number >> 24 & 255}.{number >> 16 & 255}.{number >> 8 & 255}" if number else ""
    commit = f"({str(info['ver_sw'])[:8]})" if info.get("ver_sw") else ""
    return " ".join(part for part in (name, release, commit) if part)


def _notes(found: Any, unix_minus_boot_ns: int, dropped: int) -> tuple[str, ...]:
    """What is odd about the log, a sentence each."""
    lost_ms = [dropout.duration for dropout in found.dropouts]
    notes = []
    if lost_ms:
        notes.append(
            f"the logger dropped data {len(lost_ms)} time(s), {sum(lost_ms) * 1e-3:.1f} s "
            f"together, {max(lost_ms) * 1e-3:.1f} s at the longest"
        )
    if found.file_corruption:
        notes.append("parts of the log are damaged and were skipped")
    if dropped:
        notes.append(f"{dropped} message(s) with an impossible time refused")
    if not unix_minus_boot_ns:
        notes.append("no GPS time: times count from the boot of the autopilot")
    return tuple(notes)
