"""How far models are from the measurement: a table, and the worst regimes in words."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.comparison.compare import Comparison

WORST = 5  # regimes told


def show_comparisons(found: Sequence[Comparison], pictures: Path | None) -> None:
    """All comparisons: errors beside the floor, then where the last vessel of a trial is worst."""
    out = Console()
    out.print(_table(found))
    out.print(
        "nrmse: error of free predictions over the horizon, in standard deviations of the motion; "
        "at the floor it is noise. A free run starts once and is never corrected."
    )
    for says in _refits(found):
        out.print(f"• {says}", highlight=False, markup=False)
    for notice in dict.fromkeys(n for comparison in found for n in comparison.notices):
        out.print(f"[bold]![/bold] {escape(notice)}", highlight=False)
    for comparison in found:
        worst = comparison.worst(WORST)
        says = "where it is worst" if worst else "no worse anywhere than noise"
        out.print(f"\n[bold]{escape(comparison.vessel)}[/bold] on {escape(comparison.log)}: {says}")
        for one in worst:
            out.print(f"• {one.says}", highlight=False, markup=False)
        for says in _besides(comparison):
            out.print(f"• {says}", highlight=False, markup=False)
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


def _besides(comparison: Comparison) -> list[str]:
    """The worst place on the map, and which commands the errors follow; in words."""
    place, follows = comparison.place, comparison.independence
    out = [str(place.as_dict()["says"])] if place is not None else []
    return [*out, follows.says] if follows is not None and follows.says else out


def _table(found: Sequence[Comparison]) -> Table:
    table = Table(title="measured − model, RMSE", title_justify="left")
    for name in ("recording", "vessel", "run"):
        table.add_column(name, overflow="fold")
    for name in ("u m/s", "v m/s", "r °/s", "nrmse", "floor"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in found:
        interval = "" if c.nrmse_ci95 is None else f" {c.nrmse_ci95[0]:.2f}–{c.nrmse_ci95[1]:.2f}"
        table.add_row(
            escape(f"{c.log}, {c.seconds:.0f} s"), escape(c.vessel),
            f"{c.ruler.settings.horizon:g} s", *_errors(c.scores.rmse), f"{c.nrmse:.3f}{interval}",
            f"{c.noise_floor_nrmse:.3f}",
        )  # fmt: skip
        table.add_row("", "", "free", *_free_run(c), end_section=True)
    return table


def _errors(rmse: Mapping[str, float]) -> tuple[str, str, str]:
    return f"{rmse['u']:.3f}", f"{rmse['v']:.3f}", f"{math.degrees(rmse['r']):.2f}"


def _free_run(c: Comparison) -> tuple[str, ...]:
    rmse = c.free_run.as_dict().get("rmse", {})
    return _errors(rmse) if "u" in rmse else ("diverged", "", "")
