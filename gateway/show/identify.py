"""Fitted parameters as a table, every doubt in words, and what is gained on unseen time."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from sim.identification.estimate import Estimate
from sim.identification.identify import Identified
from sim.identification.validation import Validated, Validation


def show_identified(found: Identified, out: Path | None) -> None:
    """Parameters, doubts, validation, and where the file went."""
    console = Console()
    console.print(_parameters(found))
    for e in found.estimates:
        if e.doubt:
            console.print(f"• {e.name} {e.doubt}", highlight=False, markup=False)
    for says in found.trade:
        console.print(f"• {says}", highlight=False, markup=False)
    if found.nuisances:
        console.print(f"Fitted along: {', '.join(_short(e) for e in found.nuisances)}")
    if found.validation:
        console.print(_validation(found))
    if out is not None:
        console.print(f"written: {out}")


def _parameters(found: Identified) -> Table:
    title = f"{found.vessel.name}, {found.method} over {found.seconds:.0f} s"
    table = Table(title=title, title_justify="left")
    table.add_column("parameter", no_wrap=True)
    for name in ("before", "value", "95 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for e in found.estimates:
        name = e.name if e.trial is None else f"{e.name} ({e.trial})"
        low, high = e.ci95
        mark = "" if e.identifiable else " ?"
        table.add_row(
            name, f"{e.before:.4g}", f"{e.value:.5g}{mark}", f"{low:.5g} … {high:.5g}", e.unit
        )
    return table


def _validation(found: Identified) -> Table:
    table = Table(title="on time that the fit did not see", title_justify="left")
    for name in ("recording", "vessel"):
        table.add_column(name, overflow="fold")
    for name in ("nrmse", "u RMSE, MAE, R², fit %", "v", "r"):
        table.add_column(name, justify="right")
    for v in found.validation:
        floor = f" (floor {v.noise_floor_nrmse:.3f})"
        table.add_row(f"{v.name}, {v.seconds:.0f} s", "before", *_row(v.before))
        table.add_row("", "after", *_row(v.after, floor), end_section=not _free(v))
        if _free(v):
            table.add_row("free run", "before", *_free_row(v.before))
            table.add_row("", "after", *_free_row(v.after), end_section=True)
    return table


def _free(v: Validation) -> bool:
    return v.before.free_run is not None


def _row(v: Validated, floor: str = "") -> tuple[str, ...]:
    s = v.scores
    cells = [
        f"{s.rmse[c]:.3f}, {s.mae[c]:.3f}, {s.r2.get(c, float('nan')):.3f}, "
        f"{s.fit_percent.get(c, float('nan')):.0f}"
        for c in ("u", "v", "r")
    ]
    return f"{v.nrmse:.3f}{floor}", *cells


def _free_row(v: Validated) -> tuple[str, ...]:
    if v.free_run is None:
        return ()
    if v.free_run.diverged:
        return "", "diverged", "", ""
    s = v.free_run.scores
    cells = [
        f"{s.rmse[c]:.3f}, {s.mae[c]:.3f}, {s.r2.get(c, float('nan')):.3f}" for c in ("u", "v", "r")
    ]
    return "", *cells


def _short(e: Estimate) -> str:
    return f"{e.name} {e.value:.3g} {e.unit}"
