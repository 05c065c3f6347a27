"""Many recordings of many boats: one pipeline on Dask, its table, and what wears.

Here: which recordings a fleet has, and which vessel file each is held against: fleet.toml.

[[vessels]]
name = "heron"                        # of this boat, in the table
file = "heron.toml"                   # its vessel file, or the name of one that ships
recordings = ["heron/*", "*_h3.BIN"]  # ends of paths, `*` crosses folders; left out: all
system = 3                            # optional: its MAVLink id, where a log holds several boats
mapping = "columns.toml"              # optional: what the columns of its .csv tables mean

The first entry that matches takes a recording.

Recordings are found by folder, glob or URL (any filesystem that fsspec knows). A path stays a path;
`s3://bucket/folder` and the like need the filesystem's package on the client and on every worker. A
task reads its recording where it runs: nothing but its name travels.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Annotated

import fsspec
from pydantic import Field, TypeAdapter, ValidationError

from gateway.errors import BadInput, ShadowError
from gateway.files import vessel_path
from gateway.ingest.open import suffixes
from gateway.toml_file import explain, read_toml, validated
from gateway.vessel_file import load_vessel
from gateway.vessel_tables import MAX_NAME, StrictTable
from sim.effects.effect import Effect


class BoatTable(StrictTable):
    """[[vessels]]"""

    name: Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
    file: str
    recordings: tuple[str, ...] = ("*",)
    system: int | None = None
    mapping: str | None = None


class FleetTable(StrictTable):
    """A fleet file as written."""

    vessels: Annotated[tuple[BoatTable, ...], Field(min_length=1)]


@dataclass(frozen=True)
class Boat:
    """One boat: its name in the table, its vessel file, and which recordings are its own."""

    name: str
    vessel_file: str
    recordings: tuple[str, ...] = ("*",)
    system: int | None = None
    mapping: str | None = None

    def sailed(self, recording: str) -> bool:
        """Whether a recording, by its path or URL, is this boat's."""
        return any(
            fnmatch(recording, form)
            for pattern in self.recordings
            for form in (pattern, f"*/{pattern}")
        )


_FLEET = TypeAdapter(FleetTable)


def read_fleet(path: str | Path) -> tuple[Boat, ...]:
    """The boats of a fleet file, whose paths are relative to it; BadInput where it is wrong."""
    file = Path(path)
    try:
        read = validated(_FLEET, read_toml(file, "the fleet file"))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None
    names = [one.name for one in read.vessels]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{file}: the name {name!r} is given to {names.count(name)} vessels")
    return tuple(
        Boat(
            one.name, _beside(file, one.file), one.recordings, one.system,
            None if one.mapping is None else str(file.parent / one.mapping),
        )
        for one in read.vessels
    )  # fmt: skip


def _beside(file: Path, given: str) -> str:
    """The path of a vessel file, from the folder of the fleet file; else one that ships."""
    own = file.parent / given
    return str((own if own.exists() else vessel_path(given)).resolve())


def fleet_of_one(vessel_file: str | Path, effects: Sequence[Effect] = ()) -> tuple[Boat, ...]:
    """All recordings are of the one boat of this vessel file."""
    return (Boat(load_vessel(vessel_file, effects).name, str(vessel_path(vessel_file).resolve())),)


def boat_of(recording: str, boats: Sequence[Boat]) -> Boat | None:
    """The boat that sailed a recording; None where no entry matches."""
    return next((boat for boat in boats if boat.sailed(recording)), None)


def find_recordings(named: Iterable[str]) -> list[str]:
    """Folders, globs, files and URLs -> recordings, each once, sorted within what was named.

    Of a folder, files whose suffix is that of a known format; of a glob or a file, what it says.
    """
    found: dict[str, None] = {}
    for name in named:
        recordings = sorted(_found(name))
        if not recordings:
            raise BadInput(f"{name}: no recordings there ({', '.join(sorted(suffixes()))})")
        found |= dict.fromkeys(recordings)
    return list(found)


def _found(name: str) -> list[str]:
    try:
        filesystem, root = fsspec.core.url_to_fs(name)
        if filesystem.isdir(root):
            inside = filesystem.find(root)
            kept = [f for f in inside if PurePosixPath(f).suffix.lower() in suffixes()]
        elif "*" in root or "?" in root or "[" in root:
            kept = [file for file in filesystem.glob(root) if filesystem.isfile(file)]
        elif filesystem.exists(root):
            kept = [root]
        else:
            raise BadInput(f"{name}: there is no such file or folder")
    except BadInput:
        raise
    except Exception as error:  # a filesystem's package has errors of its own
        raise BadInput(f"{name}: cannot look there: {error}") from None
    return kept if _is_local(name) else [filesystem.unstrip_protocol(file) for file in kept]


def _is_local(name: str) -> bool:
    return "://" not in name and "::" not in name


@contextmanager
def local_file(recording: str) -> Iterator[Path]:
    """The recording as a file of this machine; a copy of a URL's lives as long as the block."""
    if _is_local(recording):
        yield Path(recording)
        return
    with tempfile.TemporaryDirectory(prefix="shadow-fleet-") as folder:
        copy = Path(folder) / PurePosixPath(recording).name
        try:
            with fsspec.open(recording, "rb") as source, copy.open("wb") as target:
                shutil.copyfileobj(source, target)
        except Exception as error:  # as above
            raise BadInput(f"{recording} cannot be read: {error}") from None
        try:
            yield copy
        except ShadowError as error:  # people know the recording, not the copy
            raise BadInput(str(error).replace(str(copy), recording)) from None


def digest(recording: str) -> str:
    """SHA-256 of a recording's content; empty where it cannot be read (its analysis says why)."""
    try:
        with fsspec.open(recording, "rb") as stream:
            content = hashlib.sha256()
            while block := stream.read(1 << 20):
                content.update(block)
    except Exception:  # as above
        return ""
    return content.hexdigest()


def stamp(recording: str) -> str | None:
    """What changes when a local file does: size and time of change; None for a URL."""
    if not _is_local(recording):
        return None
    try:
        found = Path(recording).stat()
    except OSError:
        return None
    return f"{found.st_size} {found.st_mtime_ns}"
