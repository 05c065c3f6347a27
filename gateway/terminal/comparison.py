"""Comparisons: how far models are from the measurement, and the worst regimes in words."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from gateway.figures.quantities import velocity_texts
from gateway.terminal.console import ResultConsole
from sim.comparison.compare import Comparison

WORST = 5  # regimes that are named


def show_comparisons(found: Sequence[Comparison], pictures: Path | None) -> None:
    """All comparisons: errors beside the floor, then where each vessel is worst."""
    out = ResultConsole()
    out.print(_table(found))
    out.print(
        "nrmse: error of free predictions over the horizon, in standard deviations of the motion; "
        "at the floor it is noise. A free run starts once and is never corrected."
    )
    out.bullets(_refits(found))
    out.notices(dict.fromkeys(n for comparison in found for n in comparison.notices))
    for one in found:
        worst = one.worst(WORST)
        heading = "where it is worst" if worst else "no worse anywhere than noise"
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
    table = Table(title="measured − model, RMSE", title_justify="left")
    for name in ("recording", "vessel", "run"):
        table.add_column(name, overflow="fold")
    for name in ("u m/s", "v m/s", "r °/s", "nrmse", "floor"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in found:
        interval = "" if c.nrmse_ci95 is None else f" {c.nrmse_ci95[0]:.2f}–{c.nrmse_ci95[1]:.2f}"
        table.add_row(
            escape(f"{c.log}, {c.seconds:.0f} s"), escape(c.vessel),
            f"{c.ruler.settings.horizon:g} s", *velocity_texts(c.scores.rmse),
            f"{c.nrmse:.3f}{interval}", f"{c.noise_floor_nrmse:.3f}",
        )  # fmt: skip
        rmse = c.free_run.to_dict().get("rmse", {})
        free = velocity_texts(rmse) if "u" in rmse else ("diverged", "", "")
        table.add_row("", "", "free", *free, end_section=True)
    return table
