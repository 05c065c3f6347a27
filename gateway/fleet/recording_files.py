"""Recordings by folder, glob or URL (any filesystem that fsspec knows), and what is in them.

A path stays a path; `s3://bucket/folder` and the like need the filesystem's package on the client
and on every worker. A task reads its recording where it runs: nothing but its name travels.
"""

import hashlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

import fsspec

from gateway.errors import BadInput, ShadowError
from gateway.ingest.open import suffixes


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
