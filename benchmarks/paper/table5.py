"""Table 5: the nine parameters from noisy, smoothed data, with intervals.

Least squares as the paper prints it, with the Munk moment in the yaw row (consistent), and the
default of `shadow identify`. An interval should meet the paper's value ± its standard deviation
(∩), and hold the truth (✓), which here is the paper's value.
"""

from collections.abc import Sequence

import numpy as np

from benchmarks.paper.boats import truth
from benchmarks.paper.campaign import Campaign, Study
from benchmarks.paper.part import Part
from benchmarks.paper.published import TABLE_5_STD
from benchmarks.paper.scoring import header, row
from gateway.figures import Axis, Dots, FigureData, Level, Panel, SeriesRole
from sim.identification import BASE
from sim.identification.intervals import Estimate
from sim.identification.regression import DELTA_SIGN, Regression

Interval = tuple[float, float, float]  # value, low, high of δ
METHODS = ("LQS printed", "LQS consistent", "default")
DELTAS = ("δ1 m−X_u̇", "δ2 m−Y_v̇", "δ3 I_z−N_ṙ", "δ4 −X_u", "δ5 −X_uu", "δ6 −Y_v", "δ7 −Y_vv",
          "δ8 −N_r", "δ9 −N_rr")  # fmt: skip


def table_5(c: Campaign) -> Part:
    """One table per boat and instruments."""
    lines: list[str] = [
        "Value [95 % interval]. ∩: the interval meets the paper's value ± its standard deviation. "
        "✓ or ✗: it holds the truth or not. ?: told as not identifiable from these data.",
    ]
    held, pictures = {}, {}
    for study in c.studies.values():
        name = f"{study.pair.name}, {study.instruments.name}"
        lines += ["", f"**{name}**", "", *_table(study), "", _says(study)]
        held[f"{name}: every interval of the default meets the paper's"] = all(
            meets(found, δ, std) for found, δ, std in zip(
                intervals(study)["default"], deltas(study), stds(study), strict=True
            )
        )  # fmt: skip
    for i, pair in enumerate(c.boats):
        pictures[f"table_5_{pair.boat.name.lower()}"] = _picture(
            pair.name, [s for s in c.studies.values() if s.pair is c.boats[i]]
        )
    return Part("Table 5: identified parameters", tuple(lines), held, pictures)


def deltas(study: Study) -> list[float]:
    """δ1 … δ9 that the boat has."""
    return list((truth(study.pair) * DELTA_SIGN).tolist())


def stds(study: Study) -> tuple[float, ...]:
    """Standard deviations as the paper prints them."""
    return TABLE_5_STD[study.pair.name]


def intervals(study: Study) -> dict[str, list[Interval]]:
    """δ with its 95 % interval by method."""
    default = [_of_estimate(e) for e in study.found.estimates]
    return dict(zip(METHODS, (_of(study.printed), _of(study.consistent), default), strict=True))


def meets(found: Interval, value: float, std: float) -> bool:
    """The interval and value ± std have a point in common."""
    return found[1] <= value + std and found[2] >= value - std


def _of(r: Regression) -> list[Interval]:
    low, high = np.sort(np.stack([r.low * DELTA_SIGN, r.high * DELTA_SIGN]), axis=0)
    return list(zip(r.delta.tolist(), low.tolist(), high.tolist(), strict=True))


def _of_estimate(e: Estimate) -> Interval:
    sign = float(DELTA_SIGN[BASE.index(e.name)])
    low, high = sorted(sign * x for x in e.ci95)
    return sign * e.value, low, high


def _table(study: Study) -> list[str]:
    lines = header(["", "paper = truth (STD)", *METHODS])
    for i, (label, δ, std) in enumerate(zip(DELTAS, deltas(study), stds(study), strict=True)):
        cells = [label, f"{δ:.2f} ({std:.2f})"]
        for method, found in intervals(study).items():
            vague = method == "default" and not study.found.estimates[i].identifiable
            cells.append(_cell(found[i], δ, std) + (" ?" if vague else ""))
        lines.append(row(cells))
    return lines


def _cell(found: Interval, δ: float, std: float) -> str:
    value, low, high = found
    signs = ("∩" if meets(found, δ, std) else "") + ("✓" if low <= δ <= high else "✗")
    return f"{value:.2f} [{low:.2f}, {high:.2f}] {signs}"


def _says(study: Study) -> str:
    """How many intervals meet the paper's, and hold the truth, by method."""
    parts = []
    for method, found in intervals(study).items():
        triples = list(zip(found, deltas(study), stds(study), strict=True))
        meeting = sum(meets(f, δ, s) for f, δ, s in triples)
        holding = sum(f[1] <= δ <= f[2] for f, δ, _ in triples)
        parts.append(f"{method}: {meeting} of 9 meet the paper's, {holding} of 9 hold the truth")
    return "; ".join(parts) + "."


def _picture(name: str, studies: Sequence[Study]) -> FigureData:
    """Intervals in per cent of the truth, methods side by side."""
    panels = []
    for study in studies:
        marks: list[Dots | Level] = [Level(0.0, SeriesRole.CONTEXT)]
        for k, (method, found) in enumerate(intervals(study).items()):
            δ = np.array(deltas(study))
            value, low, high = (100.0 * (np.array(x) / δ - 1.0) for x in zip(*found, strict=True))
            role = (SeriesRole.ERROR, SeriesRole.MODEL, SeriesRole.MEASURED)[k]
            marks.append(Dots(np.arange(9.0) + 0.2 * (k - 1), value, low, high, role, method))
        panels.append(
            Panel(
                Axis("parameter"), Axis("estimate − truth", "%"), tuple(marks),
                study.instruments.name, names=tuple(d.split()[0] for d in DELTAS),
            )
        )  # fmt: skip
    return FigureData(f"Table 5: {name}, 95 % intervals", tuple(panels))
