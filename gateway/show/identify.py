"""Fitted parameters as a table, every doubt in words, and what is gained on unseen time."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.show.responses import responses_table
from sim.identification.identify import Identified
from sim.identification.intervals import Estimate
from sim.identification.validation import Validation
from sim.prediction.scores import Scores

UNITS = {"u": "u m/s", "v": "v m/s", "r": "r rad/s", "x": "north m", "y": "east m", "psi": "ψ rad"}


def show_identified(found: Identified, out: Path | None, pictures: Path | None = None) -> None:
    """Parameters, doubts, validation, and where file and pictures went."""
    console = Console()
    for says in found.notices:
        console.print(f"[bold]![/bold] {escape(says)}", highlight=False)
    console.print(_parameters(found))
    for e in (*found.estimates, *found.nuisances):
        if e.doubt:
            console.print(f"• {e.name} {e.doubt}", highlight=False, markup=False)
    for says in (*found.cross_check, *found.trade):
        console.print(f"• {says}", highlight=False, markup=False)
    if found.nuisances:
        console.print(f"Fitted along: {', '.join(_short(e) for e in found.nuisances)}")
    console.print(responses_table(found.vessel, found.answers))
    if found.validation:
        console.print(_validation(found))
    for says in found.untold:
        console.print(f"[bold]![/bold] {escape(says)}", highlight=False)
    if out is not None:
        console.print(f"written: {out}", soft_wrap=True, markup=False)
    if pictures is not None:
        console.print(f"pictures: {pictures}", soft_wrap=True, markup=False)


def _parameters(found: Identified) -> Table:
    title = f"{escape(found.vessel.name)}, {found.method} over {found.seconds:.0f} s"
    table = Table(title=title, title_justify="left")
    table.add_column("parameter", no_wrap=True)
    for name in ("before", "value", "95 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for e in found.estimates:
        name = e.name if e.trial is None else escape(f"{e.name} ({e.trial})")
        low, high = e.ci95
        mark = "" if e.identifiable else " ?"
        table.add_row(
            name, f"{e.before:.4g}", f"{e.value:.5g}{mark}", f"{low:.5g} … {high:.5g}", e.unit
        )
    return table


def _validation(found: Identified) -> Table:
    table = Table(title="on time that the fit did not see", title_justify="left")
    table.add_column("recording", overflow="fold")
    for name in ("", "vessel", "RMSE", "MAE", "R²", "fit %"):
        table.add_column(name, justify="right", no_wrap=True)
    for v in found.validation:
        floor = f"{escape(v.name)}, {v.seconds:.0f} s: nrmse {v.before.nrmse:.3f} before, "
        floor += f"{v.after.nrmse:.3f} after, {v.noise_floor_nrmse:.3f} by noise alone"
        rows = _rows(v.before.scores, v.after.scores)
        for i, cells in enumerate(rows):
            table.add_row(floor if i == 0 else "", *cells, end_section=i == len(rows) - 1)
        for cells in _free_rows(v):
            table.add_row("one free run" if cells[0] == "u m/s" else "", *cells)
        table.add_section()
    return table


def _rows(before: Scores, after: Scores) -> list[tuple[str, ...]]:
    """Channel by channel, before and after."""
    return [
        (UNITS[c] if when == "before" else "", when, *_cells(s, c))
        for c in UNITS
        for when, s in (("before", before), ("after", after))
    ]


def _free_rows(v: Validation) -> list[tuple[str, ...]]:
    runs = v.before.free_run, v.after.free_run
    if runs[0] is None or runs[1] is None:
        return []
    if len(runs[1].error) == 0:
        return [("u m/s", "after", "diverged", "", "", "")]
    return _rows(runs[0].scores, runs[1].scores)


def _cells(s: Scores, channel: str) -> tuple[str, ...]:
    moved = channel in s.r2
    return (
        f"{s.rmse[channel]:.3f}", f"{s.mae[channel]:.3f}",
        f"{s.r2[channel]:.3f}" if moved else "", f"{s.fit_percent[channel]:.0f}" if moved else "",
    )  # fmt: skip


def _short(e: Estimate) -> str:
    return f"{e.name} {e.value:.3g} {e.unit}"
