"""`shadow wear`: the table of a fleet -> what has changed on which boat, since when, by how much.

Numbers that `identify` found identifiable, and those of effects that a diagnosis found and that
belong to the boat, each over all recordings of its boat.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from gateway.figures.figure_data import FigureData
from gateway.figures.wear import course_figure
from gateway.fleet.table import read_estimates
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
        since = "since" if change.kind == "step" else "steadily since about"
        first, last = (self.date(moment) for moment in change.moment95)
        range_ = "" if first == last else f", between {first} and {last}"
        return (
            f"{worded(self.name)} has {verb} {100.0 * abs(change.share):.0f} % "
            f"({low:.0f}–{high:.0f} %) {since} {self.date(change.moment)}{range_}"
        )

    def date(self, moment: float) -> str:
        """A moment of a change [days after the first recording] as a day."""
        day = self.dates[0] + timedelta(days=moment)
        return f"{day.day} {day:%b} {day.year}"

    @property
    def figure(self) -> FigureData:
        """Recordings and course."""
        return course_figure(
            f"{self.boat} {self.name}", self.unit, self.date(0.0), self.series, self.course,
            self.text or "nothing has changed",
        )  # fmt: skip

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
    """All numbers that were followed, and per boat how many had too few recordings for it."""

    numbers: tuple[Wear, ...]
    too_few: Mapping[str, int]

    @property
    def changes(self) -> list[Wear]:
        """Those that have changed, the clearest first."""
        return sorted((w for w in self.numbers if w.change), key=lambda w: w.p_value)

    def to_dict(self) -> dict[str, Any]:
        """What `shadow wear --json` prints."""
        return {
            "changes": [w.text for w in self.changes],
            "numbers": [w.to_dict() for w in self.numbers], "too_few": dict(self.too_few),
        }  # fmt: skip


def worded(name: str) -> str:
    """A number of a vessel as people call it: left.ahead is "the left thruster"."""
    part, _, key = name.rpartition(".")
    return f"the {part} thruster" if part and key == "ahead" else name


def wear_of(folder: str | Path, boats: Sequence[str] = ()) -> FleetWear:
    """What has changed, by the table in a folder; `boats`: these alone."""
    voyage = {e.name for e in known_effects() if e.scope is Scope.VOYAGE}
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in read_estimates(folder):
        followed = row["origin"] == "identify" or (
            row["kind"] == "effect" and row["effect"] not in voyage
        )
        known = row["identifiable"] and row["stretch"] is None and row["started"] is not None
        if followed and known and (not boats or row["boat"] in boats):
            groups[row["boat"], row["name"]].append(row)
    kept = {key: rows for key, rows in groups.items() if len(rows) >= MIN_RECORDINGS}
    too_few: dict[str, int] = {}
    for boat, _ in sorted(groups.keys() - kept.keys()):
        too_few[boat] = too_few.get(boat, 0) + 1
    return FleetWear(_followed(kept), too_few)


def _followed(groups: Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]) -> tuple[Wear, ...]:
    """Every series with its evidence; which changes are believed is decided over all of them."""
    ordered = {k: sorted(rows, key=lambda row: row["started"]) for k, rows in groups.items()}
    series = {key: _series(rows) for key, rows in ordered.items()}
    found = {key: e for key, one in series.items() if (e := evidence_of(one)) is not None}
    sure = believed([evidence.p_value for evidence in found.values()])
    changed = dict(zip(found, sure, strict=True))
    return tuple(
        _wear(*key, ordered[key], series[key], found[key], bool(changed[key]))
        for key in sorted(found)
    )


def _series(rows: Sequence[Mapping[str, Any]]) -> Series:
    days = [(row["started"] - rows[0]["started"]).total_seconds() / DAY_S for row in rows]
    half = np.array([0.5 * (row["high"] - row["low"]) for row in rows])
    return Series(np.array(days), np.array([row["value"] for row in rows]), half / NORMAL_95)


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
