"""Comparisons: how far models are from the measurement, and the worst regimes in words.

Of one mission sailed twice: each sentence only where its numbers are so.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from gateway.figures import motion_texts
from gateway.figures.words import nowhere_text
from gateway.offline.beside_loop import BesideLoop
from gateway.terminal import ResultConsole
from sim.comparison.compare import Comparison
from sim.comparison.improvement import by_trial, improvements
from sim.comparison.missions import MissionComparison, Parting

WORST = 5  # regimes that are named


def show_comparisons(found: Sequence[Comparison], pictures: Path | None) -> None:
    """All comparisons: errors beside the floor, then where each vessel is worst."""
    out = ResultConsole()
    for group in by_trial(found):
        out.print(_table(group))
    out.print(
        "nrmse: error of free predictions over the horizon, in standard deviations of the motion; "
        "at the floor it is noise. A free run starts once and is never corrected."
    )
    out.bullets(dict.fromkeys(one.cut_text for one in found if one.cut_text))
    out.bullets(each.sentence for each in improvements(found))
    out.bullets(_refits(found))
    out.notices(dict.fromkeys(n for comparison in found for n in comparison.notices))
    for one in found:
        worst = one.worst(WORST)
        heading = "where it is worst" if worst else nowhere_text(one.standing)
        out.print(f"\n[bold]{escape(one.vessel)}[/bold] on {escape(one.log)}: {heading}")
        out.bullets(each.sentence for each in worst)
        if one.place is not None:
            out.bullets([str(one.place.to_dict()["says"])])
        if one.independence is not None and one.independence.description:
            out.bullets([one.independence.description])
    if pictures is not None:
        out.print(f"\npictures: {pictures}", soft_wrap=True, markup=False)


def _refits(found: Sequence[Comparison]) -> list[str]:
    """What was estimated anew on the day, either half of the blocks from the other."""
    return [
        f"{c.vessel} on {c.log}, estimated anew on blocks that it is not judged by: "
        + ", ".join(f"{key} {a:.3g} / {b:.3g}" for (key, a), b in zip(
            c.refit[0].items(), c.refit[1].values(), strict=True))
        for c in found if c.refit
    ]  # fmt: skip


def _table(found: Sequence[Comparison]) -> Table:
    """Comparisons on one recording, by one ruler."""
    first = found[0]
    title = f"{first.log}, {first.seconds:.0f} s: measured − model, RMSE"
    table = Table(title=escape(title), title_justify="left")
    table.add_column("vessel", overflow="fold")
    for name in ("u m/s", "v m/s", "r °/s", "place m", "head °", "nrmse"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in found:
        interval = "" if c.nrmse_ci95 is None else f" {c.nrmse_ci95[0]:.2f}–{c.nrmse_ci95[1]:.2f}"
        table.add_row(
            f"{escape(c.vessel)}, {c.horizon}",
            *motion_texts(c.scores.rmse), f"{c.nrmse:.3f}{interval}",
        )  # fmt: skip
        rmse = c.free_run.to_dict().get("rmse", {})
        free = motion_texts(rmse) if "u" in rmse else ("diverged", "", "", "", "")
        table.add_row("  one free run", *free, "", end_section=True)
    table.add_row("noise alone", "", "", "", "", "", f"{first.noise_floor_nrmse:.3f}")
    return table


TURNING = 0.05  # rad/s; chosen
MIN_LAG_S = 1.0  # a smaller lag is none: time is known to tenths, places to a metre
MIN_SHARE = 0.3  # of the largest lag: less does not come from one stretch
MIN_PULSE_US = 10.0
MOST = 3  # partings that are told


def mission_sentences(found: MissionComparison) -> list[str]:
    """What two passages of a mission have in common, and where they differ."""
    gap = np.abs(found.gap)
    worst = int(np.argmax(gap))
    first, second = found.first, found.second
    out = [
        f"under way: the boat {first.time[-1]:.0f} s and {first.along[-1]:.0f} m, in the loop "
        f"{second.time[-1]:.0f} s and {second.along[-1]:.0f} m",
    ]
    if not found.same_mission:
        out.append(
            f"hardly the same mission: half of the track lies more than {np.median(gap):.0f} m away"
        )
    out.append(
        f"along the track: {np.median(gap):.1f} m apart in the median, at most {gap[worst]:.1f} m, "
        f"{found.along[worst]:.0f} m from the start"
    )
    out += _partings(found)
    out.append(_lag(found))
    out.append(
        f"at the same time since the start: at most {found.apart_at_once.max():.1f} m from one "
        "another"
    )
    return out + _pulses(found)


def _partings(found: MissionComparison) -> list[str]:
    if not found.partings:
        return [f"they do not part: never more than {found.limit:.1f} m between the tracks"]
    out = [_parting(parting, found.limit) for parting in found.partings[:MOST]]
    if len(found.partings) > MOST:
        out.append(f"and {len(found.partings) - MOST} more times")
    return out


def _parting(p: Parting, limit: float) -> str:
    if abs(p.turning) < TURNING:
        doing = "on a straight leg"
    else:
        doing = f"in a turn to {'starboard' if p.turning > 0.0 else 'port'}"
    side = "starboard" if p.gap > 0.0 else "port"
    return (
        f"they part {p.start:.0f} m from the start, after {p.time:.0f} s, {doing}: over "
        f"{p.end - p.start:.0f} m the loop lies more than {limit:.1f} m to {side}, at most "
        f"{abs(p.gap):.1f} m"
    )


def _lag(found: MissionComparison) -> str:
    last, largest = float(found.lag[-1]), float(np.abs(found.lag).max())
    if largest < MIN_LAG_S:
        return f"in time: never more than {MIN_LAG_S:.0f} s from one another at the same place"
    text = (
        f"in time: the loop comes to the end {abs(last):.1f} s {'later' if last > 0 else 'earlier'}"
    )
    if abs(last) < MIN_LAG_S:
        text = "in time: both come to the end within a second"
    text += f"; at most {largest:.1f} s apart at the same place"
    start, end, change = found.slowest
    if abs(change) >= max(MIN_LAG_S, MIN_SHARE * largest):
        what = "loses" if change > 0.0 else "gains"
        text += f"; it {what} {abs(change):.1f} s between {start:.0f} and {end:.0f} m"
    return text


def _pulses(found: MissionComparison) -> list[str]:
    return [
        f"output {channel}: {boat:.0f} µs in the mean on the boat, {loop:.0f} µs in the loop"
        for channel, (boat, loop) in found.mean_pulses().items()
        if abs(boat - loop) >= MIN_PULSE_US
    ]


def show_missions(beside: BesideLoop) -> None:
    """Print the notices, then each mission in sentences."""
    out, found = ResultConsole(), beside.missions
    out.notices(beside.notices)
    out.print("\n[bold]The mission beside the loop[/bold]", highlight=False)
    out.print(f"{found.first.name} (the boat), {found.second.name} (in the loop)", markup=False)
    out.bullets(mission_sentences(found))


def missions_as_dict(beside: BesideLoop) -> dict[str, Any]:
    """Missions as plain values for JSON, in SI units."""
    found = beside.missions
    return {
        "boat": found.first.name,
        "loop": found.second.name,
        "seconds": [float(found.first.time[-1]), float(found.second.time[-1])],
        "limit_m": found.limit,
        "same_mission": found.same_mission,
        "along_m": found.along.tolist(),
        "gap_m": found.gap.tolist(),
        "lag_s": found.lag.tolist(),
        "partings": [vars(parting) for parting in found.partings],
        "mean_pulses_us": {str(k): list(v) for k, v in found.mean_pulses().items()},
        "notices": list(beside.notices),
        "says": mission_sentences(found),
    }
