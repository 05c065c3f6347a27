"""`shadow fleet --report`: the table as one HTML file, with map and courses of numbers."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import counted
from gateway.figures import Dots, FigureData, Line, Mark, SeriesRole
from gateway.figures.html_report import FleetPage, ReportFigure, render_fleet
from gateway.figures.matplotlib_draw import svg_text
from gateway.figures.motion import map_panel
from gateway.files import write_whole
from gateway.fleet.analysis import DONE, DUPLICATE, PARTLY
from gateway.fleet.table import read_recordings
from gateway.fleet.wear import FleetWear, wear_of

EARTH_M_PER_DEG = 111_195.0  # of latitude, on a sphere; a map needs no more
NEAR_DEG = 0.2  # recordings further apart stand on maps of their own
GOOD = (DONE, PARTLY)
HALF_MAP = 100.0 * np.array([-1.0, np.nan, 1.0])  # m: corners of the smallest map, not joined

Row = Mapping[str, Any]


def write_fleet_report(folder: str | Path, file: Path) -> None:
    """The report of the table in a folder."""
    page = fleet_page(read_recordings(folder), wear_of(folder), str(folder))
    write_whole(file, render_fleet(page).encode(), "the report")


def fleet_page(rows: Sequence[Row], wear: FleetWear, name: str) -> FleetPage:
    """Rows of the table and what has worn -> the page."""
    now = datetime.now(UTC)
    ordered = sorted(rows, key=by_time)
    changed = {id(one) for one in wear.changes}
    numbers = [*wear.changes, *(one for one in wear.numbers if id(one) not in changed)]
    boats = len({row["boat"] for row in rows if row["boat"]})
    return FleetPage(
        f"Fleet: {counted(boats, 'boat')}, {counted(len(rows), 'recording')}",
        f"{name}, made {now:%Y-%m-%d %H:%M} UTC by shadow-gateway {version('shadow-gateway')}",
        tuple(headline(rows, wear)),
        tuple(_boat(boat, own) for boat, own in fleet_of(rows).items()),
        tuple(_recording(row) for row in ordered),
        tuple(_figure(figure) for figure in maps(ordered)),
        tuple(_figure(one.figure) for one in numbers),
    )


def fleet_of(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of each boat, by name."""
    out: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        out[row["boat"] or "no boat"].append(row)
    return dict(sorted(out.items()))


def headline(rows: Sequence[Row], wear: FleetWear) -> list[str]:
    """What has changed; what is not done."""
    said = wear.sentences or ["no number of any boat was fitted: nothing is known of changes"]
    failed = sum(row["state"] not in (*GOOD, DUPLICATE) for row in rows)
    every = counted(len(rows), "recording")
    return said + ([f"{failed} of {every} could not be used"] if failed else [])


def _boat(boat: str, rows: Sequence[Row]) -> tuple[str, ...]:
    good = [row for row in rows if row["state"] in GOOD]
    days = sorted(f"{row['started']:%Y-%m-%d}" for row in good if row["started"])
    minutes = sum(row["usable_s"] or 0.0 for row in good) / 60.0
    return (
        boat, f"{len(good)} of {len(rows)}", f"{minutes:.0f} min", _mean(good, "nrmse"),
        _mean(good, "noise_floor_nrmse"), *(days[:1] or ["–"]), *(days[-1:] or ["–"]),
    )  # fmt: skip


def _mean(rows: Sequence[Row], key: str) -> str:
    known = [row[key] for row in rows if row[key] is not None]
    return f"{sum(known) / len(known):.3f}" if known else "–"


def _recording(row: Row) -> tuple[str, ...]:
    began = f"{row['started']:%Y-%m-%d %H:%M}" if row["started"] else "–"
    usable = f"{row['usable_s'] / 60.0:.0f} min" if row["usable_s"] else "–"
    about = "; ".join(row["good_for"] or ()) if row["state"] in GOOD else row["why"] or ""
    return (
        Path(row["recording"]).name, row["boat"] or "no boat", began, usable,
        _mean([row], "nrmse"), _mean([row], "noise_floor_nrmse"), row["state"], about,
    )  # fmt: skip


def by_time(row: Row) -> tuple[bool, str, str]:
    """By time, those without one last."""
    return row["started"] is None, str(row["started"] or ""), row["recording"]


def maps(rows: Sequence[Row]) -> list[FigureData]:
    """Where recordings began, one map a water, one series a boat; the largest water first."""
    waters: list[list[Row]] = []
    for row in (row for row in rows if row["latitude_deg"] is not None):
        for water in waters:
            first = water[0]
            if all(abs(row[k] - first[k]) < NEAR_DEG for k in ("latitude_deg", "longitude_deg")):
                water.append(row)
                break
        else:
            waters.append([row])
    return [_map(water) for water in sorted(waters, key=lambda water: -len(water))]


def _map(water: Sequence[Row]) -> FigureData:
    north, east = (
        float(np.median([r[k] for r in water])) for k in ("latitude_deg", "longitude_deg")
    )
    roles = [role for role in SeriesRole if role is not SeriesRole.INTERVAL]
    marks: list[Mark] = [Line(HALF_MAP, HALF_MAP, SeriesRole.CONTEXT)]
    for k, (boat, rows) in enumerate(fleet_of(water).items()):
        x = np.array([r["longitude_deg"] - east for r in rows]) * np.cos(np.radians(north))
        y = np.array([r["latitude_deg"] - north for r in rows])
        x, y = EARTH_M_PER_DEG * x, EARTH_M_PER_DEG * y
        marks.append(Dots(x, y, y, y, roles[k % len(roles)], f"{boat}: {len(rows)}"))
    place = f"{abs(north):.4f}° {'N' if north >= 0.0 else 'S'}, "
    place += f"{abs(east):.4f}° {'E' if east >= 0.0 else 'W'}"
    caption = f"Each point is where a recording begins; the middle is {place}."
    return FigureData(f"around {place}", (map_panel(tuple(marks), ""),), caption=caption)


def _figure(figure: FigureData) -> ReportFigure:
    return ReportFigure(figure.title, figure.caption, svg_text(figure))
