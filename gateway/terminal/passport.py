"""Vessel files in the terminal: origins of their numbers, differences, history."""

from rich.markup import escape
from rich.table import Table

from gateway.offline.passport import Passport, differences, outputs_that_differ
from gateway.terminal.console import ResultConsole, result_table


def show_passport(read: Passport) -> None:
    """Every number with its interval and its origin."""
    console = ResultConsole()
    table = Table(title=f"{read.vessel.name}: {read.path}", title_justify="left")
    for name in ("number", "value", "95 % interval", "unit"):
        table.add_column(name, no_wrap=True, justify="left" if name == "number" else "right")
    table.add_column("from", overflow="fold")
    for one in read.numbers:
        ci95 = one.origin.ci95 if one.origin else None
        interval = "" if ci95 is None else f"{ci95[0]:.4g} … {ci95[1]:.4g}"
        source = escape(one.source)
        table.add_row(escape(one.name), f"{one.value:.5g}", interval, one.unit, source)
    console.print(table)
    if read.vessel.source:
        console.print(f"source: {read.vessel.source}", markup=False, highlight=False)
    console.notices(read.vessel.assumptions)


def show_difference(first: Passport, second: Passport) -> None:
    """The numbers and the wiring that differ."""
    console, found = ResultConsole(), differences(first, second)
    table = result_table("what differs", "number", "first", "second", "change", "intervals",
                         unit=True)  # fmt: skip
    words = {None: "not stated", True: "beyond", False: "within"}
    for one in found:
        change = "" if one.share is None else f"{100.0 * one.share:+.1f} %"
        ends = ("–" if value is None else f"{value:.5g}" for value in (one.first, one.second))
        table.add_row(one.name, *ends, change, words[one.beyond], one.unit)
    if found:
        console.print(table)
    wiring = outputs_that_differ(first.vessel, second.vessel)
    console.bullets(wiring)
    if not found and not wiring:
        console.bullets(["the two are the same vessel"])


def show_history(read: Passport) -> None:
    """One line a revision, with what it changed."""
    console = ResultConsole()
    for one in read.tables.history:
        changed = ", ".join(
            f"{name} {one.before[name]:.4g} → {now:.4g}"
            if name in one.before
            else f"{name} {now:.4g}"
            for name, now in one.now.items()
        )
        console.bullets([f"{one.date}, {one.by} on {one.recording}: {changed}"])
    if not read.tables.history:
        console.bullets(["no history: no command of this program has changed its numbers"])
