"""The vessel file that is open, and its effect files: were they changed or removed meanwhile?"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from gateway.errors import ShadowError
from gateway.files import stamp_of
from gateway.studio.own_effects import TakenVessel, take_vessel
from gateway.user_effects import EffectFile
from sim.effects.effect import LawError

LOOK_S = 1.0  # between two looks at the files


class VesselNews(NamedTuple):
    """What has become of a vessel's files, and whether they can be taken as they are now."""

    says: str
    usable: bool


@dataclass
class VesselWatch:
    """Looks at a vessel's files now and then; `taken` is what they held when they were read.

    named    effect files that its user named, of whatever vessel
    differs  whether the files hold something else by now
    """

    file: Path
    taken: TakenVessel
    named: Sequence[EffectFile] = ()
    differs: bool = False
    _looked: float = 0.0
    _said: VesselNews | None = None

    def __post_init__(self) -> None:
        self._stamps = self._first = self._stamps_now()

    def news(self) -> VesselNews | None:
        """What has happened since the last look, each change once; None: nothing.

        What cannot be used may become so by itself: an effect file that is trusted at last.
        """
        if time.monotonic() - self._looked < LOOK_S:
            return None
        self._looked, stamps = time.monotonic(), self._stamps_now()
        unchanged, waits = stamps == self._stamps, self._said is not None and not self._said.usable
        if unchanged and not waits:
            return None
        self._stamps, before = stamps, self._said
        self._said = self._state()
        return None if unchanged and self._said == before else self._said

    def _stamps_now(self) -> dict[Path, list[int] | None]:
        paths = [self.file, *(Path(one.path) for one in self.taken.effects)]
        return {path: stamp_of(path) for path in paths}

    def _state(self) -> VesselNews:
        """What is to be said of the files as they are now."""
        gone = [path.name for path, stamp in self._stamps.items() if stamp is None]
        changed = [path.name for path, stamp in self._stamps.items() if stamp != self._first[path]]
        says = f"{' and '.join(gone or changed or [self.file.name])} was changed"
        self.differs = True
        if gone:
            return VesselNews(says.replace("was changed", "is no longer there"), False)
        try:
            now = take_vessel(self.file, self.named)
            for one in now.effects:
                one.load()
        except (ShadowError, LawError, OSError, UnicodeDecodeError) as error:
            reason = " ".join(str(error).split()).removeprefix(f"{self.file.parent}/")
            return VesselNews(f"{says} and cannot be used ({reason})", False)
        self.differs = now != self.taken
        return VesselNews(says, True)
