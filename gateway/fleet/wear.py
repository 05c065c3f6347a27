"""`shadow wear`: the table of a fleet -> what has changed on which boat, since when, by how much.

Numbers that `identify` found identifiable, and those of effects that a diagnosis found and that
belong to the boat, each over all recordings of its boat that have a real date. Of recordings of one
time (a voyage's telemetry log and its DataFlash log) one counts: they are no two days.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import BadInput, counted
from gateway.figures import (
    Axis,
    Band,
    Dots,
    FigureData,
    Line,
    Panel,
    SeriesRole,
)
from gateway.fleet.table import read_estimates, read_recordings
from gateway.user_effects import known_effects
from sim.effects.effect import Scope
from sim.wear import (
    MIN_RECORDINGS,
    NORMAL_95,
    Change,
    Course,
    Evidence,
    Series,
    believed,
    course_of,
    evidence_of,
)

DAY_S = 86400.0
CLOCKS_BEGIN = datetime(2000, 1, 1, tzinfo=UTC)  # an earlier date is a clock that was never set
THRUST = ("ahead", "astern")  # of a thruster: what it loses is wear
DRAG = ("X_u", "X_uu")  # growth on the hull makes it larger


@dataclass(frozen=True)
class Wear:
    """One number of one boat over its recordings; `change` is None where none is believed."""

    boat: str
    name: str
    unit: str
    recordings: tuple[str, ...]
    dates: tuple[datetime, ...]
    series: Series
    course: Course
    change: Change | None
    p_value: float

    @property
    def text(self) -> str:
        """The change in a sentence; empty where there is none."""
        return "" if self.change is None else f"{self.boat}: {self._changed(self.change)}"

    def _changed(self, change: Change) -> str:
        verb, sign = ("lost", -100.0) if change.share < 0.0 else ("gained", 100.0)
        low, high = sorted(sign * end for end in change.share95)
        return (
            f"{worded(self.name)} has {verb} {100.0 * abs(change.share):.0f} % "
            f"({low:.0f} to {high:.0f} %) {self._since(change)}"
        )

    def _since(self, change: Change) -> str:
        """A step lies between two recordings; a drift may be older than the first of them."""
        first, last = (self.date(moment) for moment in change.moment95)
        if change.kind == "drift" and change.moment95[0] <= 0.0:
            return (
                f"steadily, since the first recording ({first}) or before"
                f"{'' if first == last else f', since {last} at the latest'}"
            )
        about = "since" if change.kind == "step" else "steadily since about"
        range_ = "" if first == last else f", between {first} and {last}"
        return f"{about} {self.date(change.moment)}{range_}"

    def date(self, moment: float) -> str:
        """A moment of a change [days after the first recording] as a day."""
        day = self.dates[0] + timedelta(days=moment)
        return f"{day.day} {day:%b} {day.year}"

    @property
    def figure(self) -> FigureData:
        """What each recording says with its interval, and the course that is believed."""
        series, course = self.series, self.course
        low, high = (series.value + side * NORMAL_95 * series.std for side in (-1.0, 1.0))
        marks = (
            Band(series.time, course.low, course.high, SeriesRole.INTERVAL, "course, 95 %"),
            Line(series.time, course.mean, SeriesRole.MODEL, "course"),
            Dots(series.time, series.value, low, high, SeriesRole.MEASURED, "recordings"),
        )
        days = Axis(f"time since {self.date(0.0)}", "days")
        panel = Panel(days, Axis("value", self.unit), marks)
        caption = self.text or "no change is clear"
        return FigureData(f"{self.boat} {self.name}", (panel,), caption=caption)

    def to_dict(self) -> dict[str, Any]:
        """What `shadow wear --json` prints."""
        change = None
        if self.change is not None:
            start = self.dates[0]
            moments = (self.change.moment, *self.change.moment95)
            when, *range_ = [(start + timedelta(days=m)).date().isoformat() for m in moments]
            change = self.change._asdict() | {"moment": when, "moment95": range_}
        return {
            "boat": self.boat, "name": self.name, "unit": self.unit,
            "recordings": list(self.recordings),
            "dates": [date.isoformat() for date in self.dates],
            "values": self.series.value.tolist(),
            "course": {key: list(getattr(self.course, key)) for key in ("mean", "low", "high")},
            "scatter": self.course.scatter, "change": change, "text": self.text,
            "p_value": self.p_value,
        }  # fmt: skip


@dataclass(frozen=True)
class FleetWear:
    """All numbers that were followed, and why others were not.

    too_few  per boat, how many numbers had too few recordings for it
    undated  per boat, recordings that have no real date
    twice    per boat, recordings of a time of which another one counts
    """

    numbers: tuple[Wear, ...]
    too_few: Mapping[str, int]
    undated: Mapping[str, int]
    twice: Mapping[str, int]

    @property
    def changes(self) -> list[Wear]:
        """Those that have changed, the clearest first."""
        return sorted((w for w in self.numbers if w.change), key=lambda w: w.p_value)

    @property
    def sentences(self) -> list[str]:
        """What has changed, or that nothing clearly has; what was not followed, and why."""
        n = len(self.numbers)
        none = [f"no change is clear: {counted(n, 'number')} followed"] if n else []
        few = [
            f"{boat}: {counted(count, 'number')} in fewer than {MIN_RECORDINGS} recordings: "
            "too few to tell wear"
            for boat, count in self.too_few.items()
        ]
        dateless = [
            f"{boat}: {counted(count, 'recording')} left out: no real date (a clock that was "
            "not set)"
            for boat, count in self.undated.items()
        ]
        again = [
            f"{boat}: {counted(count, 'recording')} left out: of the same time as another"
            for boat, count in self.twice.items()
        ]
        return [*([one.text for one in self.changes] or none), *few, *dateless, *again]

    def to_dict(self) -> dict[str, Any]:
        """What `shadow wear --json` prints."""
        return {
            "changes": [w.text for w in self.changes],
            "numbers": [w.to_dict() for w in self.numbers], "too_few": dict(self.too_few),
            "undated": dict(self.undated), "twice": dict(self.twice),
        }  # fmt: skip


def worded(name: str) -> str:
    """A number of a vessel as people call it: left.ahead is "the left thruster"."""
    part, _, key = name.rpartition(".")
    return f"the {part} thruster" if part and key == "ahead" else name


def wear_of(folder: str | Path, boats: Sequence[str] = ()) -> FleetWear:
    """What has changed, by the table in a folder; `boats`: these alone are told of.

    What is believed is judged over the whole fleet all the same: who looks at one boat after the
    other would find more false alarms than who looks at all.
    """
    voyage = {e.name for e in known_effects() if e.scope is Scope.VOYAGE}
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    undated, twice = defaultdict[str, set[str]](set), defaultdict[str, set[str]](set)
    tomorrow = datetime.now(UTC) + timedelta(days=1)
    again = _of_one_time(read_recordings(folder))
    for row in read_estimates(folder):
        followed = row["origin"] == "identify" or (
            row["kind"] == "effect" and row["effect"] not in voyage
        )
        if not (followed and row["identifiable"] and row["stretch"] is None):
            continue
        if row["started"] is None or not CLOCKS_BEGIN <= row["started"] < tomorrow:
            undated[row["boat"]].add(row["recording"])
        elif row["recording"] in again:
            twice[row["boat"]].add(row["recording"])
        else:
            groups[row["boat"], row["name"]].append(row)
    every = {*undated, *(boat for boat, _ in groups)}  # a second of one time has a first
    for boat in boats:
        if boat not in every:
            known_boats = ", ".join(sorted(every)) or "none"
            raise BadInput(f"{boat}: no numbers of this boat in {folder} (boats: {known_boats})")
    told = set(boats) or every
    kept = {key: rows for key, rows in groups.items() if len(rows) >= MIN_RECORDINGS}
    few = Counter(boat for boat, _ in sorted(groups.keys() - kept.keys()) if boat in told)
    dateless, second = (
        {boat: len(left_out[boat]) for boat in sorted(told & left_out.keys())}
        for left_out in (undated, twice)
    )
    return FleetWear(tuple(w for w in _followed(kept) if w.boat in told), few, dateless, second)


def _of_one_time(recordings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Recordings of a boat that lie within the time of another with more usable time."""
    known = [row for row in recordings if row["started"] and row["seconds"] and row["usable_s"]]
    kept: dict[str, list[tuple[datetime, datetime]]] = defaultdict(list)
    out = set()
    for row in sorted(known, key=lambda row: (-row["usable_s"], row["recording"])):
        begins = row["started"]
        ends = begins + timedelta(seconds=row["seconds"])
        if any(begins < to and since < ends for since, to in kept[row["boat"]]):
            out.add(row["recording"])
        else:
            kept[row["boat"]].append((begins, ends))
    return out


def _followed(groups: Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]) -> tuple[Wear, ...]:
    """Every series with its evidence; which changes are believed is decided over all of them."""
    ordered = {k: sorted(rows, key=lambda row: row["started"]) for k, rows in groups.items()}
    series = {(boat, name): _series(name, rows) for (boat, name), rows in ordered.items()}
    found = {key: e for key, one in series.items() if (e := evidence_of(one)) is not None}
    wears = [series[key].wears for key in found]
    sure = believed([evidence.p_value for evidence in found.values()], wears)
    changed = dict(zip(found, sure, strict=True))
    return tuple(
        _wear(*key, ordered[key], series[key], found[key], bool(changed[key]))
        for key in sorted(found)
    )


def _series(name: str, rows: Sequence[Mapping[str, Any]]) -> Series:
    days = [(row["started"] - rows[0]["started"]).total_seconds() / DAY_S for row in rows]
    half = np.array([0.5 * (row["high"] - row["low"]) for row in rows])
    part, _, key = name.rpartition(".")
    wears = -1 if part and key in THRUST else int(name in DRAG)
    values = np.array([row["value"] for row in rows])
    return Series(np.array(days), values, half / NORMAL_95, wears)


def _wear(
    boat: str,
    name: str,
    rows: Sequence[Mapping[str, Any]],
    series: Series,
    evidence: Evidence,
    sure: bool,
) -> Wear:
    change = evidence.change if sure else None
    return Wear(
        boat, name, rows[0]["unit"], tuple(row["recording"] for row in rows),
        tuple(row["started"].astimezone(UTC) for row in rows), series, course_of(series, change),
        change, evidence.p_value,
    )  # fmt: skip
