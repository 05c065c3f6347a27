"""The files that the page may see: those in the folders that were given, and nothing else."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from gateway.errors import BadInput

RECORDINGS = (".tlog", ".bin", ".mcap", ".csv")
NAME = re.compile(r"[\w][\w .+-]{0,80}\.toml")
TABLES = ("[dynamics]", "[hull]")


@dataclass(frozen=True)
class Folders:
    """Folders to read from, and the one that is written to."""

    read: tuple[Path, ...]
    write: Path

    @classmethod
    def of(cls, files: Iterable[Path], folders: Iterable[Path], write: Path) -> "Folders":
        """The folders named and those that the files lie in."""
        every = [*folders, *(file.parent for file in files)]
        resolved = dict.fromkeys(folder.resolve() for folder in every)
        for folder in resolved:
            if not folder.is_dir():
                raise BadInput(f"{folder}: no such folder")
        return cls(tuple(resolved), write.resolve())

    def recordings(self) -> list[Path]:
        """All recordings, by name."""
        return self._files(lambda file: file.suffix.lower() in RECORDINGS)

    def vessels(self) -> list[Path]:
        """All vessel files, by name; also those saved."""
        return self._files(_is_vessel)

    def checked(self, path: str | Path) -> Path:
        """A path that may be read; BadInput for every other."""
        file = Path(path).resolve()
        if file.parent not in (*self.read, self.write):
            raise BadInput(f"{Path(path).name}: not in a folder that the studio was given")
        return file

    def to_save(self, name: str) -> Path:
        """Where a vessel file of that name goes: never elsewhere, never over another one."""
        if not NAME.fullmatch(name):
            raise BadInput(f"{name!r}: give a plain name that ends in .toml")
        file = self.write / name
        if file.exists():
            raise BadInput(f"{name} is there already: choose another name")
        return file

    def _files(self, wanted: Callable[[Path], bool]) -> list[Path]:
        found: list[Path] = []
        for folder in dict.fromkeys((*self.read, self.write)):
            if folder.is_dir():
                found += [f for f in sorted(folder.iterdir()) if _plain(f, folder) and wanted(f)]
        return found


def _plain(file: Path, folder: Path) -> bool:
    """A file that lies there itself: a link may lead anywhere."""
    return file.is_file() and not file.name.startswith(".") and file.resolve().parent == folder


def _is_vessel(file: Path) -> bool:
    if file.suffix.lower() != ".toml" or file.stat().st_size > 1_000_000:
        return False
    text = file.read_text(encoding="utf-8", errors="replace")
    return all(table in text for table in TABLES)
