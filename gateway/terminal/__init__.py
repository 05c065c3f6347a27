"""Results as tables and sentences in the terminal, one file per kind of result.

Here: what all results share, which is lines, tables, and the progress of long work.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from gateway.errors import printable
from gateway.terminal.work_line import WorkLine, duration

NARROWEST = 12  # letters that prose in a table is folded into at most


class SafeConsole(Console):
    """A console that shows control characters of names and messages instead of sending them."""

    def _render_buffer(self, buffer: Iterable[Segment]) -> str:
        """What goes out; rich's own commands to the terminal are segments of their own kind."""
        return super()._render_buffer(
            segment if segment.control else segment._replace(text=printable(segment.text))
            for segment in buffer
        )


class ResultConsole(SafeConsole):
    """Standard output for results; the methods below print text as it is, without markup."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but no cell of a table is cut off, however narrow the terminal."""
        super().print(*(self._whole(o) if isinstance(o, Table) else o for o in objects), **options)

    def _whole(self, table: Table) -> RenderableType:
        """The table where its names and numbers fit; else a paragraph for each row."""
        for column in table.columns:
            column.overflow = "fold"  # a long word in a column of prose goes on in the next line
        needed = 1 + sum(3 + self._least(table, column) for column in table.columns)
        return table if needed <= self.width else self._paragraphs(table)

    def _least(self, table: Table, column: Column) -> int:
        """Columns of the terminal that a column takes: all of it, or what prose folds into."""
        cells = [*([column.header] if table.show_header else []), *column.cells]
        widest = max((self.measure(cell).maximum for cell in cells), default=0)
        return widest if column.no_wrap else min(widest, NARROWEST)

    def _paragraphs(self, table: Table) -> RenderableType:
        """Each row as its first cell and, below it, a line for each of the others."""
        lines = [Text.from_markup(str(table.title), style="italic")] if table.title else []
        headers = [Text.from_markup(str(column.header)) for column in table.columns]
        for first, *rest in zip(*(column.cells for column in table.columns), strict=True):
            lines.append(Text.from_markup(str(first), style="bold"))
            for name, cell in zip(headers[1:], rest, strict=True):
                if str(cell):
                    lines.append(Text.assemble("  ", name, ": ", Text.from_markup(str(cell))))
        return Group(*lines)

    def notices(self, notices: Iterable[str]) -> None:
        """What a user should know before the result, each with an exclamation mark."""
        for notice in notices:
            self.print(f"[bold]![/bold] {escape(notice)}", highlight=False)

    def bullets(self, sentences: Iterable[str]) -> None:
        """One sentence per line."""
        for sentence in sentences:
            self.print(f"• {sentence}", highlight=False, markup=False)

    def path(self, label: str, file: Path | str | None) -> None:
        """Print where a file was written; nothing where it was not."""
        if file is not None:
            self.print(f"{label}: {file}", soft_wrap=True, markup=False)


def result_table(title: str, first: str, *numbers: str, unit: bool = False) -> Table:
    """A table without wrapping: a first column of names, columns of numbers, their unit."""
    table = Table(title=title, title_justify="left")
    table.add_column(first, no_wrap=True)
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    if unit:
        table.add_column("unit", no_wrap=True)
    return table


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """A bar while the block runs; call what it gives with the share done, 0 to 1."""
    console = SafeConsole(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def status_line(what: str, keep: str = "") -> Iterator[Callable[[str], None]]:
    """A line that says what is being done, and how long it takes; call what it gives with the next
    thing.

    `keep`: what begins so stays on the screen, with the time that it took.
    """
    console = SafeConsole(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    line = WorkLine(what)
    with console.status(line):

        def show(text: str) -> None:
            if keep and text.startswith(keep):
                console.print(f"{text} ({duration(line.seconds)}; tested now)", markup=False)
            line.step(text)

        yield show
