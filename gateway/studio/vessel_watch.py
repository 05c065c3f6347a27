"""The vessel file that is open: its text, and whether it was changed or removed meanwhile."""

import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import tomli_w

from gateway.errors import ShadowError
from gateway.files import stamp_of
from gateway.user_effects import EffectFile, effect_file_beside
from gateway.vessel_file import read_vessel_file

LOOK_S = 1.0  # between two looks at the file


class VesselNews(NamedTuple):
    """What has become of a vessel file, and whether it can be taken as it is now."""

    says: str
    usable: bool


@dataclass
class VesselWatch:
    """Looks at a vessel file now and then; `text` as it was taken.

    differs  whether the file holds something else by now
    """

    file: Path
    text: str
    differs: bool = False
    _stamp: list[int] | None = None
    _looked: float = 0.0

    def __post_init__(self) -> None:
        self._stamp = stamp_of(self.file)

    def news(self) -> VesselNews | None:
        """What has happened since the last look, each change once; None: nothing."""
        if time.monotonic() - self._looked < LOOK_S:
            return None
        self._looked, stamp = time.monotonic(), stamp_of(self.file)
        if stamp == self._stamp:
            return None
        self._stamp, name, self.differs = stamp, self.file.name, True
        if stamp is None:
            return VesselNews(f"{name} is no longer there", False)
        try:
            self.differs = portable(self.file)[0] != self.text
        except (ShadowError, OSError, UnicodeDecodeError) as error:
            reason = " ".join(str(error).split()).replace(f"{self.file.parent}/", "")
            return VesselNews(f"{name} was changed and cannot be used ({reason})", False)
        return VesselNews(f"{name} was changed", True)


def portable(file: Path) -> tuple[str, tuple[EffectFile, ...]]:
    """The text of a vessel file without paths that hold only where it lies, and those paths."""
    entries = read_vessel_file(file).effects
    text = file.read_text(encoding="utf-8")
    named = [e["file"] for e in entries if "file" in e]
    paths = tuple(EffectFile(str(effect_file_beside(file, one)), named=False) for one in named)
    if not paths:
        return text, ()
    tables = tomllib.loads(text)
    for entry in tables["effects"]:
        entry.pop("file", None)
    return tomli_w.dumps(tables), paths
