"""Progress of long work, on standard error; silent where that is not a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """A bar while the block runs; call what it gives with the share done, 0 to 1."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def status(what: str) -> Iterator[Callable[[str], None]]:
    """A line that says what is being done; call what it gives with the next thing."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda says: None
        return
    with console.status(what) as line:
        yield lambda says: line.update(f"{what}: {says}")
