"""Files: written whole or not at all, replaced only where they are ours, remembered, shipped.

A command names its inputs and outputs before it works (`guarded_outputs`). An output that is an
input, or a file that this command did not write, is refused there and then; `--force` overrides. So
is one where nothing can be written (`check_place`), and one whose suffix says that it is something
else (`named_as`). What a command wrote is remembered by size and
time of change: a file that was edited since is the user's again. Names that come up during the work
(a picture for each part of a recording) are asked about when they are written (`check_output`).

What the program remembers between commands stands in the user's state folder, one small file each:
`$XDG_STATE_HOME/shadow-gateway` (else `~/.local/state/shadow-gateway`). Only the user may write
there: an entry that belongs to someone else, or that others may write, is as if it were not there.

Files that ship with the program are vessels, recordings and layouts. In a checkout they stand in
the repository's folders `configs` and `recordings`; a wheel carries the same folders inside the
package.
"""

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from gateway.errors import BadInput, ShadowError, printable

OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


def state_folder() -> Path:
    """The folder that entries are kept in; it may not exist yet."""
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "shadow-gateway"


def remember(kind: str, key: str, entry: dict[str, Any]) -> bool:
    """Keep an entry under a key -> whether that was possible."""
    file = _file(kind, key)
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        part.touch(mode=0o600)
        part.chmod(0o600)  # whatever the umask: an entry that others may write counts for nothing
        part.write_text(json.dumps({"key": key, **entry}), encoding="utf-8")
        part.replace(file)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        return False
    return private(file)


def recall(kind: str, key: str) -> dict[str, Any] | None:
    """The entry under a key; None where there is none that only the user can have written."""
    file = _file(kind, key)
    try:
        if not (private(file.parent) and private(file)):
            return None
        entry = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) and entry.get("key") == key else None


def private(path: Path) -> bool:
    """Whether a file or folder belongs to the user, and nobody else may write it.

    The administrator's count as the user's own: whoever is root can do all of it anyway. A system
    without owners (Windows) has nothing to ask.
    """
    try:
        found = path.stat()
    except OSError:
        return False
    if not hasattr(os, "getuid"):
        return True
    return found.st_uid in (os.getuid(), 0) and not found.st_mode & OTHERS_MAY_WRITE


def _file(kind: str, key: str) -> Path:
    content = hashlib.sha256(key.encode(errors="surrogateescape"))  # a name need not be UTF-8
    return state_folder() / kind / f"{content.hexdigest()[:32]}.json"


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
        stamp = stamp_of(file)
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


# Suffixes of all kinds of files that the program reads or writes.
KINDS = frozenset(
    (".tlog", ".bin", ".mcap", ".csv", ".parquet", ".ulg", ".toml", ".json", ".html", ".pdf",
     ".png", ".svg", ".py")
)  # fmt: skip


def named_as(file: Path | None, *kinds: str) -> Path | None:
    """An output as it was named; BadInput where its suffix is that of another kind than `kinds`.

    A suffix that nobody knows, or none, is the user's own choice.
    """
    if file is not None and file.suffix.lower() in KINDS - set(kinds):
        raise BadInput(
            f"{file}: what is written there is no {file.suffix}: give a name that ends in "
            f"{' or '.join(kinds)}"
        )
    return file


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
        stamp_of(file),
    )


def stamp_of(file: Path) -> list[int] | None:
    """Size [bytes] and time of the last change [ns]; None where there is no such file."""
    try:
        found = file.stat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]


UNSAFE = re.compile(r"[^\w.-]+")  # in the name of a file


def write_whole(file: Path, content: bytes, what: str) -> None:
    """Write a file, or raise a ShadowError that names `what` and leave the old file as it was.

    Folders that are missing are made.
    """
    check_output(file)
    part = file.with_name(f".{file.name}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(file)
    except OSError as error:
        raise ShadowError(f"{file}: cannot write {what}: {error.strerror}") from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
    note_output(file)


def picture_name(name: str) -> str:
    """The name of a figure as that of its file: dashes for blanks and special characters."""
    return UNSAFE.sub("-", name).strip("-").lower() + ".png"


def recording_names(files: Sequence[str | Path]) -> list[str]:
    """A name for each of several recordings: its stem, with as much of its path as keeps it apart.

    Results are grouped, and pictures named, by these: two that differ in no more than what a
    picture's name leaves out would be one.
    """
    longer = [_names_from_short_to_long(Path(file), i + 1) for i, file in enumerate(files)]
    while True:
        keys = [picture_name(names[0]) for names in longer]
        shared = [i for i, key in enumerate(keys) if keys.count(key) > 1 and len(longer[i]) > 1]
        if not shared:
            return [names[0] for names in longer]
        for i in shared:
            del longer[i][0]


def _names_from_short_to_long(file: Path, number: int) -> list[str]:
    """log, log.tlog, d1/log.tlog, …; at last a number, for "a b.tlog" beside "a-b.tlog"."""
    parts = file.absolute().parts[1:]
    paths = ("/".join(parts[-k:]) for k in range(1, len(parts) + 1))
    return [printable(name) for name in (file.stem, *paths, f"{file.name} {number}")]


def pictures_there(folder: Path | None, begin: Iterable[str], end: str = ".png") -> list[Path]:
    """Pictures in a folder that are named as figures about to be drawn begin, or end so."""
    starts = tuple(picture_name(name).removesuffix(".png") for name in begin)
    found = sorted(folder.glob("*.png")) if folder is not None and folder.is_dir() else []
    return [
        file
        for file in found
        if file.name.startswith(starts) or (end != ".png" and file.name.endswith(end))
    ]


INSTALLED = Path(__file__).parent / "_shipped"
ROOT = INSTALLED if INSTALLED.is_dir() else Path(__file__).resolve().parent.parent
VESSELS = ROOT / "configs" / "vessels"
DAYS = ROOT / "configs" / "days"
RECORDINGS = ROOT / "recordings"
LAYOUT = ROOT / "configs" / "foxglove-layout.json"


def vessel_names() -> list[str]:
    """Names under which the vessels that ship can be given instead of a file."""
    return sorted(file.stem for file in VESSELS.glob("*.toml"))


def vessel_path(given: str | Path) -> Path:
    """A vessel file as it was given, or that of a shipped vessel by its name (`otter`).

    A file of that name in the working folder goes first.
    """
    file, name = Path(given), str(given)
    if not file.exists() and name in vessel_names():
        return VESSELS / f"{name}.toml"
    return file


def named_vessel(given: str) -> tuple[str | None, str]:
    """`[NAME=]FILE` -> the name, if there is one, and the file.

    A file that is called so as a whole, with its `=`, goes first.
    """
    name, mark, file = given.partition("=")
    return (name, file) if mark and not Path(given).exists() else (None, given)


NOT_IN_NAMES = "/*$?#@"  # special in keys of zenoh, and in paths


def check_name(name: str, where: str) -> None:
    """BadInput where a boat cannot have that name: it becomes a part of a key, and of files."""
    if not name or set(name) & set(NOT_IN_NAMES) or not name.isprintable():
        raise BadInput(
            f"{where} {name!r}: must not be empty nor contain {' '.join(NOT_IN_NAMES)} or what "
            "cannot be printed"
        )
