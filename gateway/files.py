"""A file written whole or not at all.

Files that ship with the program: vessels, recordings, layouts.

In a checkout they stand in the repository's folders `configs` and `recordings`; a wheel carries the
same folders inside the package.
"""

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from gateway.errors import ShadowError
from gateway.outputs import check_output, note_output

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
