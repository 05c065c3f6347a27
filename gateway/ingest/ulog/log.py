"""ULog (.ulg): what a PX4 autopilot wrote on board, as tables on its microseconds and on Unix time.

Within one boot rows are in the order of their time; a clock that restarts opens a new one, which
follows the one before. Unix time comes from the GPS of each boot: `time_ref_utc` of the file is a
time zone, not a time. Texts of the autopilot are a table as topics are (`SAID`).

Format: header 'ULog\x01\x12\x35'; definitions (formats, infos, parameters); data.
Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.log import (
    Boat,
    BoatSamples,
    ListedParameter,
    Log,
    Statistics,
    Table,
    column,
    decode_tables,
    frozen,
    lanes_notice,
)
from gateway.ingest.mapping import UNIX_FROM_US
from gateway.ingest.mavlink.mapping import vehicle_type
from gateway.ingest.ulog.boots import Boots, boots
from gateway.ingest.ulog.instances import estimator_in_use, rules_for
from gateway.ingest.ulog.mapping import ESTIMATORS, INSTANCE
from gateway.ingest.ulog.records import Records, Told, read_records
from sim.state import Ints

TIME = "timestamp"  # µs since boot, in every topic
SAID = "logged_message"  # name of the table of the autopilot's texts
GPS = ("vehicle_gps_position", "sensor_gps")  # field time_utc_usec
NOTHING = "holds no data: a PX4 log (.ulg) that ends behind its header"
BETWEEN_BOOTS_US = 1_000_000  # where no GPS says how long the autopilot was off

Columns = dict[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Topic:
    """All messages of one topic, of all its instances, in order of their time.

    order, time_us, boot  (K,)  position among all messages of the log; µs since boot; which boot
    """

    order: Ints
    time_us: Ints
    boot: Ints
    columns: Columns


@dataclass(frozen=True)
class UlogLog(Log):
    """An opened ULog.

    unix_minus_boot_ns  (S,)  of each boot; where no GPS ever knew the time they count from the
                              first one's boot
    """

    path: str
    statistics: Statistics
    topics: Mapping[str, Topic] = field(repr=False)
    unix_minus_boot_ns: Ints
    settings: Sequence[ListedParameter] = field(repr=False)
    software: str
    kind: str = "ulog"

    def counts(self) -> Mapping[str, int]:
        return {name: len(topic.order) for name, topic in sorted(self.topics.items())}

    def table(self, name: str) -> Table:
        """All messages of a topic; arrays as (K, n), the instance in `multi_id`."""
        nothing = np.zeros(0, np.int64)
        topic = self.topics.get(name) or Topic(nothing, nothing, nothing, {})
        time_ns = topic.time_us * 1000 + self.unix_minus_boot_ns[topic.boot]
        return Table.unaddressed(name, topic.order, time_ns, topic.columns)

    def boats(self) -> tuple[Boat, ...]:
        """The one vehicle, by its MAV_TYPE."""
        status = self.topics.get("vehicle_status")
        types = status.columns.get("system_type") if status else None
        set_to = [one.value for one in self.settings if one.name == "MAV_TYPE"]
        number = types[-1] if types is not None else (set_to or [-1.0])[-1]
        known = vehicle_type(int(number))
        return (Boat(0, 0, "PX4", "" if known == "?" else known),)

    def decode(self, boat: Boat) -> BoatSamples:
        """All samples, those of the EKF of the one in use."""
        rules, told = rules_for(self, self.parameters(boat))
        in_use = estimator_in_use(self)
        chosen = {f"{topic}.{INSTANCE}": in_use.at for topic in ESTIMATORS if in_use is not None}
        decoded = decode_tables(self, boat, rules, chosen)
        times = None if in_use is None else decoded.times_at(in_use.order)
        switches = () if in_use is None or times is None else in_use.switches(times)
        notices = (*decoded.notices, *told, *lanes_notice(switches, self))
        return replace(decoded, lane_switches=switches, notices=notices)

    def listed_parameters(self, boat: Boat) -> list[ListedParameter]:
        """Those that the log begins with, and each that was changed."""
        return list(self.settings)

    def firmware(self, boat: Boat) -> str:
        """Release and hash of the autopilot's software."""
        return self.software


class _Rows(NamedTuple):
    """Rows of one instance of a topic in the order of the file, (K,) each."""

    topic: str
    instance: int
    place: Ints
    stamp: NDArray[np.uint64]
    columns: Columns

    def of(self, keep: NDArray[np.bool_]) -> "_Rows":
        """Some of them."""
        columns = {name: column(values[keep]) for name, values in self.columns.items()}
        return _Rows(self.topic, self.instance, self.place[keep], self.stamp[keep], columns)


def ulog_from_bytes(raw: bytes, path: str = "ulog") -> UlogLog:
    """A ULog from bytes in memory; `path` names it in messages."""
    try:
        found = read_records(raw)
    except ValueError as error:
        raise BadInput(f"{path} cannot be read as a PX4 log (.ulg): {error}") from None
    rows = _rows(found, raw)
    if not rows:
        raise BadInput(f"{path} {NOTHING}")
    known = boots([one.place for one in rows], [one.stamp for one in rows])
    kept = [one.of(keep) for one, keep in zip(rows, known.kept, strict=True)]
    topics = _topics(kept, known)
    if not set(topics) - {SAID}:
        raise BadInput(f"{path} {NOTHING}")
    unix, by_gps = _unix_minus_boot_ns(topics, len(known.restarts) + 1)
    moments = _Moments(kept, known)
    wild = sum(int(np.count_nonzero(~keep)) for keep in known.kept)
    statistics = Statistics(
        size_bytes=len(raw),
        accepted=sum(len(topic.order) for topic in topics.values()),
        junk_bytes=sum(one.size for one in found.damage),
        unknown_messages=found.unknown,
        time_backwards=len(known.restarts),
        truncated_tail=found.truncated,
        notes=_notes(found, moments, by_gps, wild),
    )
    settings = _settings(found.parameters, moments, unix)
    return UlogLog(path, statistics, topics, unix, settings, _software(found.infos))


def _rows(found: Records, raw: bytes) -> list[_Rows]:
    """The rows of each instance that have a time, by name and instance; texts as a topic."""
    out = list[_Rows]()
    for one in found.series:
        names = one.layout.names or ()
        if TIME in names and one.layout[TIME].kind in "iu" and len(one.offset):
            packed = one.rows(raw)
            columns: Columns = {name: packed[name] for name in names}
            stamp = packed[TIME].astype(np.uint64)
            out.append(_Rows(one.topic, one.instance, one.places(), stamp, columns))
    if found.said:
        stamp = np.array([one.time_us for one in found.said], np.uint64)
        said: Columns = {
            "severity": np.array([one.level for one in found.said], np.uint8),
            "text": np.array([one.text for one in found.said]),
        }
        place = np.array([one.place for one in found.said], np.int64)
        out.append(_Rows(SAID, 0, place, stamp, {TIME: stamp, **said}))
    by_name = sorted(out, key=lambda rows: (rows.topic, rows.instance))
    groups = groupby(by_name, key=lambda rows: (rows.topic, rows.instance))
    return [_as_one(list(group)) for _, group in groups]


def _as_one(parts: Sequence[_Rows]) -> _Rows:
    """Rows of an instance that was announced again, where a log goes on behind another one."""
    place, stamp = (np.concatenate([part[i] for part in parts]) for i in (2, 3))
    columns = _side_by_side([part.columns for part in parts])
    return parts[0]._replace(place=place, stamp=stamp, columns=columns)


def _side_by_side(parts: Sequence[Columns]) -> Columns:
    """Columns one behind the other; those that not all have, or in another shape, are left out."""
    shared = set.intersection(*(set(one) for one in parts))
    alike = [n for n in parts[0] if n in shared and len({one[n].shape[1:] for one in parts}) == 1]
    return {name: np.concatenate([one[name] for one in parts]) for name in alike}


def _topics(rows: Sequence[_Rows], known: Boots) -> dict[str, Topic]:
    """Rows of all instances -> topics, in the order of boots and times."""
    rows = [one for one in rows if len(one.place)]
    if not rows:
        return {}
    time = np.concatenate([one.stamp for one in rows]).astype(np.int64)
    boot = known.of(np.concatenate([one.place for one in rows]))
    order = np.empty(len(time), np.int64)
    order[np.lexsort((time, boot))] = np.arange(len(time))
    cuts = np.cumsum([len(one.place) for one in rows])[:-1]
    parts = list(
        zip(rows, *(np.split(all_of, cuts) for all_of in (order, time, boot)), strict=True)
    )
    return {
        name: _joined(list(group)) for name, group in groupby(parts, key=lambda part: part[0].topic)
    }


def _joined(parts: Sequence[tuple[_Rows, Ints, Ints, Ints]]) -> Topic:
    """The instances of one topic, with order, time and boot of their rows -> one table in order."""
    order, time_us, boot = (np.concatenate([part[i] for part in parts]) for i in (1, 2, 3))
    by_order = np.argsort(order, kind="stable")
    together = _side_by_side([one.columns for one, *_ in parts])
    columns: Columns = {name: frozen(values[by_order]) for name, values in together.items()}
    numbers = [np.full(len(one.place), one.instance) for one, *_ in parts]
    columns[INSTANCE] = frozen(np.concatenate(numbers)[by_order])
    order, time_us, boot = (frozen(values[by_order]) for values in (order, time_us, boot))
    return Topic(order, time_us, boot, columns)


def _unix_minus_boot_ns(topics: Mapping[str, Topic], count: int) -> tuple[Ints, bool]:
    """Unix time minus boat time of each boot (S,) [ns], by the median over one GPS; and whether any
    knew the time. A boot without one, or that would begin before the one before ended, follows it.
    """
    first, last = np.full(count, np.iinfo(np.int64).max), np.zeros(count, np.int64)
    for topic in topics.values():
        np.minimum.at(first, topic.boot, topic.time_us)
        np.maximum.at(last, topic.boot, topic.time_us)
    told = [_by_gps(topics, boot) for boot in range(count)]
    known = [boot for boot in range(count) if told[boot] is not None]
    out = np.zeros(count, np.int64)
    start = known[0] if known else 0
    out[start] = told[start] or 0
    for boot in range(start - 1, -1, -1):  # as late as it can be before the first one that knows
        out[boot] = out[boot + 1] + first[boot + 1] - BETWEEN_BOOTS_US - last[boot]
    for boot in range(start + 1, count):
        follows = out[boot - 1] + last[boot - 1] + BETWEEN_BOOTS_US - first[boot]
        out[boot] = max(follows, told[boot] or follows)
    return frozen(out * 1000), bool(known)


def _by_gps(topics: Mapping[str, Topic], boot: int) -> int | None:
    """Unix time minus boat time of one boot [µs]; None where no GPS knew it."""
    for name in GPS:
        if name in topics and "time_utc_usec" in topics[name].columns:
            topic = topics[name]
            unix_us = np.asarray(topic.columns["time_utc_usec"]).astype(np.int64)
            known = (unix_us >= UNIX_FROM_US) & (topic.boot == boot)
            if known.any():
                return int(np.median((unix_us - topic.time_us)[known]))
    return None


class _Moments:
    """When it was at a place of the file: by the rows before it."""

    def __init__(self, rows: Sequence[_Rows], known: Boots) -> None:
        place = np.concatenate([one.place for one in rows])
        time = np.concatenate([one.stamp for one in rows]).astype(np.int64)
        by_place = np.argsort(place, kind="stable")
        self.place, self.time = place[by_place], time[by_place]
        self.boot = known.of(self.place)
        self.order = np.empty(len(place), np.int64)
        self.order[np.lexsort((self.time, self.boot))] = np.arange(len(place))

    def row_before(self, place: int) -> int:
        """Number of the row in this order that is the last before a place, or the first."""
        return max(int(np.searchsorted(self.place, place)) - 1, 0)

    def missing_s(self, place: int) -> float:
        """How much time passes between the rows before and behind a place [s]."""
        k = self.row_before(place)
        step = self.time[k + 1 : k + 2] - self.time[k]
        return float(max(step.sum(), 0)) * 1e-6


def _settings(
    parameters: Sequence[Told], moments: _Moments, unix_minus_boot_ns: Ints
) -> list[ListedParameter]:
    """Parameters that are numbers, those of the head as of the first row."""
    out = []
    for one in parameters:
        if isinstance(one.value, int | float) and np.isfinite(one.value):
            k = moments.row_before(one.place)
            at = int(moments.time[k] * 1000 + unix_minus_boot_ns[moments.boot[k]])
            order, changed = int(moments.order[k]), one.place >= 0
            out.append(ListedParameter(order, at, one.name, float(one.value), changed))
    return out


def _software(info: Mapping[str, Any]) -> str:
    """`PX4 v1.14.3 (1dacb4cd)` as far as the log holds it."""
    name, number = str(info.get("sys_name", "PX4")), info.get("ver_sw_release")
    packed = number if isinstance(number, int) else 0
    release = f"v{packed >> 24 & 255}.{packed >> 16 & 255}.{packed >> 8 & 255}" if packed else ""
    commit = f"({str(info['ver_sw'])[:8]})" if info.get("ver_sw") else ""
    return " ".join(part for part in (name, release, commit) if part)


def _notes(found: Records, moments: _Moments, by_gps: bool, wild: int) -> tuple[str, ...]:
    """What is odd about the log, a sentence each."""
    lost_ms, notes = found.lost_ms, []
    if lost_ms:
        notes.append(
            f"the logger dropped data {len(lost_ms)} time(s), {sum(lost_ms) * 1e-3:.1f} s "
            f"together, {max(lost_ms) * 1e-3:.1f} s at the longest"
        )
    if found.damage:
        missing = sum(moments.missing_s(one.place) for one in found.damage)
        notes.append(
            f"the log is damaged in {len(found.damage)} place(s): {missing:.1f} s of it are missing"
        )
    if wild:
        notes.append(f"{wild} message(s) with an impossible time refused")
    if not by_gps:
        notes.append("no GPS time: times count from the boot of the autopilot")
    return tuple(notes)
