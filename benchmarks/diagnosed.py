"""One voyage diagnosed as a user would, timed, and its answer as cells of a table."""

import time
from pathlib import Path
from typing import Any, NamedTuple

from gateway.offline.diagnose import DiagnosisResult, diagnose_logs


class Diagnosed(NamedTuple):
    """What a diagnosis found, the same as in its JSON, and how long it took [s]."""

    found: DiagnosisResult
    said: dict[str, Any]
    seconds: float

    @property
    def answer(self) -> str:
        """The verdict, and the effects that were found."""
        return f"`{self.said['verdict']}` {', '.join(self.said['effects']) or 'nothing'}"

    @property
    def errors(self) -> str:
        """The error on unseen time as given and at last, and the noise."""
        each = [step["heldout_nrmse"] for step in self.said["ladder"]]
        return f"{each[0]:.3f} → {each[-1]:.3f} ({self.said['noise_floor_nrmse']:.3f})"


def diagnosed(log: Path, vessel: Path) -> Diagnosed:
    """A log held against a vessel file."""
    begun = time.perf_counter()
    found = diagnose_logs([log], vessel)
    return Diagnosed(found, found.to_dict(), time.perf_counter() - begun)
