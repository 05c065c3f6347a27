"""What a command may replace: what it wrote itself, and nothing else of the user's.

A command names its inputs and outputs before it works (`guarded_outputs`). An output that is an
input, or a file that this command did not write, is refused there and then; `--force` overrides. So
is one where nothing can be written (`check_place`).
What a command wrote is remembered by size and time of change: a file that was edited since is the
user's again. Names that come up during the work (a picture for each part of a recording) are asked
about when they are written (`check_output`).
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile

from gateway.errors import BadInput
from gateway.user_state import recall, remember

WRITTEN = "written"  # the kind of entry in the user's state
ADVICE = "give another name, or --force to replace it"


@dataclass(frozen=True)
class OutputGuard:
    """A command that writes, and what it reads; `force`: replace whatever is there."""

    command: str
    inputs: tuple[Path, ...] = ()
    force: bool = False
    written: set[Path] = field(default_factory=set)  # during this run

    def check(self, file: Path) -> None:
        """BadInput where writing this file would destroy something."""
        if file.is_dir():
            raise BadInput(f"{file}: is a folder: give the name of a file")
        if self.force or not file.exists():
            return
        for given in self.inputs:
            if given.exists() and file.samefile(given):
                raise BadInput(f"{file}: this is an input of the command: {ADVICE}")
        if file.absolute() not in self.written and not wrote(self.command, file):
            raise BadInput(
                f"{file}: is there already, and not as `shadow {self.command}` wrote it: {ADVICE}"
            )

    def note(self, file: Path) -> None:
        """Remember that this command wrote that file, as it is now."""
        self.written.add(file.absolute())
        stamp = _stamp(file)
        if stamp is not None:
            remember(WRITTEN, str(file.resolve()), {"command": self.command, "stamp": stamp})


_guard: ContextVar[OutputGuard | None] = ContextVar("output_guard", default=None)


@contextmanager
def guarded_outputs(
    command: str,
    inputs: Iterable[Path | None],
    outputs: Iterable[Path | None],
    force: bool,
    folder: Path | None = None,
) -> Iterator[OutputGuard]:
    """Check all outputs now; what the block writes is checked and remembered.

    `folder`: for files whose names come up during the work.
    """
    guard = OutputGuard(command, tuple(p for p in inputs if p is not None), force)
    named: set[Path] = set()
    if folder is not None:
        check_place(folder)
    for file in outputs:
        if file is None:
            continue
        guard.check(file)
        check_place(file.parent, file)
        if file.resolve() in named:
            raise BadInput(f"{file}: is named twice among the outputs: give each its own name")
        named.add(file.resolve())
    token = _guard.set(guard)
    try:
        yield guard
    finally:
        _guard.reset(token)


def check_place(folder: Path, named: Path | None = None) -> None:
    """BadInput that names `named` where no file can be made in a folder, which may be made first.

    A file is made and removed: what a file system allows is known to nobody else.
    """
    whole = folder.absolute()
    nearest = next(one for one in (whole, *whole.parents) if one.exists())
    try:
        with TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        reason = error.strerror or error
        raise BadInput(
            f"{named or folder}: nothing can be written there ({nearest}: {reason}): "
            "choose another place"
        ) from None


def check_output(file: Path) -> None:
    """BadInput where the running command may not replace that file; free outside of commands."""
    guard = _guard.get()
    if guard is not None:
        guard.check(file)


def note_output(file: Path) -> None:
    """Remember that the running command wrote that file."""
    guard = _guard.get()
    if guard is not None:
        guard.note(file)


def wrote(command: str, file: Path) -> bool:
    """Whether that command wrote this file as it is now."""
    entry = recall(WRITTEN, str(file.resolve()))
    return entry is not None and (entry.get("command"), entry.get("stamp")) == (
        command,
        _stamp(file),
    )


def _stamp(file: Path) -> list[int] | None:
    """Size [bytes] and time of the last change [ns]; None where there is no such file."""
    try:
        found = file.stat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]
