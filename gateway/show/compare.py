"""How far models are from the measurement: a table, and the worst regimes in words."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sim.diagnosis.compare import Comparison

WORST = 5  # regimes told


def show_comparisons(found: Sequence[Comparison], pictures: Path | None) -> None:
    """All comparisons: errors beside the floor, then where the last vessel of a trial is worst."""
    out = Console()
    out.print(_table(found))
    out.print(
        "nrmse: error of free predictions over the horizon, in standard deviations of the motion; "
        "at the floor it is noise. A free run starts once and is never corrected."
    )
    for comparison in found:
        worst = comparison.worst(WORST)
        head = f"\n[bold]{comparison.vessel}[/bold] on {comparison.log}"
        out.print(f"{head}: where it is worst" if worst else f"{head}: no worse anywhere than noise")
        for one in worst:
            out.print(f"• {one.says}", highlight=False, markup=False)
    if pictures is not None:
        out.print(f"\npictures: {pictures}")


def _table(found: Sequence[Comparison]) -> Table:
    table = Table(title="measured − model", title_justify="left")
    for name in ("recording", "vessel", "nrmse", "95 %", "floor", "u", "v", "r", "free run u, v, r"):
        table.add_column(name, justify="left" if name in ("recording", "vessel") else "right")
    for c in found:
        interval = "" if c.nrmse_ci95 is None else f"{c.nrmse_ci95[0]:.3f}–{c.nrmse_ci95[1]:.3f}"
        table.add_row(
            f"{c.log}, {c.seconds:.0f} s", c.vessel, f"{c.nrmse:.3f}", interval,
            f"{c.noise_floor_nrmse:.3f}", *_errors(c.scores.rmse), _free_run(c),
        )  # fmt: skip
    return table


def _errors(rmse: object) -> tuple[str, str, str]:
    values = dict(rmse)  # type: ignore[call-overload]
    return (
        f"{values['u']:.3f} m/s",
        f"{values['v']:.3f} m/s",
        f"{math.degrees(values['r']):.2f} °/s",
    )


def _free_run(c: Comparison) -> str:
    free = c.free_run.as_dict()
    if "rmse" not in free or "u" not in free["rmse"]:
        return "diverged"
    return ", ".join(_errors(free["rmse"]))
