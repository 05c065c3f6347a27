"""Words that the page and the report use, each explained in a sentence.

The report: one HTML file that asks for nothing outside itself.

Pictures are SVG inside the file, sharp on paper and on a phone, shown without a line of script.
"""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

GLOSSARY = {
    "nrmse": "size of the error of u, v and r together, in standard deviations of the motion: "
    "0 is perfect, 1 is as bad as knowing only the mean",
    "noise floor": "the error that a perfect model would still show, because sensors are noisy",
    "free run": "the model starts once and is never corrected",
    "horizon": "how long the model runs freely before it is started anew from the measurement",
    "surge u": "speed over ground towards the bow",
    "sway v": "speed over ground towards starboard",
    "yaw rate r": "how fast the boat turns, clockwise from above",
    "missing force": "what the model would need on top of its commanded forces to move as measured",
    "95 % interval": "where the true number lies in 95 of 100 cases like this one",
    "unseen time": "stretches of the recordings that were left out of the fit",
    "ladder": "the error on unseen time after each effect that was added",
    "base": "the nine plain numbers of a vessel: masses and damping",
    "probability": "how likely it is that this effect explains unseen time best: of those ranked, "
    "each alone, and of nothing being missing",
    "effect": "one physical cause that a model may or may not contain: current, thruster lag, …",
    "regime": "a range of speed, heading, throttle, time, … in which the error is looked at",
    "NIS": "how well the filter's stated noise fits what it sees: 1 is honest",
    "clock offset": "the receiver's clock minus the boat's",
    "gated": "measurements refused as outliers since the start",
    "reference": "the velocity that the shadow follows: measured, or predicted by the model",
    "shadow": "the simulated boat that follows the real one",
}


LARGEST = 4_700_000  # bytes of the whole file
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Shown:
    """A picture: its heading, the sentence below it, and the SVG."""

    title: str
    says: str
    svg: str

    @property
    def address(self) -> str:
        """The picture as an address that holds all of it."""
        return "data:image/svg+xml;base64," + b64encode(self.svg.encode()).decode()


@dataclass(frozen=True)
class Recording:
    """One stretch of a recording: numbers of each vessel, the worst in words, pictures."""

    name: str
    seconds: float
    rows: tuple[Mapping[str, Any], ...]
    worst: tuple[tuple[str, tuple[str, ...]], ...]  # vessel, sentences
    notices: tuple[str, ...]
    pictures: tuple[Shown, ...]


@dataclass(frozen=True)
class Report:
    """All that the page says; `diagnosis` is what `shadow diagnose --json` prints, if asked for."""

    title: str
    made: str
    headline: str
    recordings: tuple[Recording, ...]
    vessel_files: tuple[tuple[str, str], ...]  # heading, text
    versions: tuple[tuple[str, str], ...]
    diagnosis: Mapping[str, Any] | None = None
    ladder: Shown | None = None
    evidence: tuple[Shown, ...] = ()
    glossary: Mapping[str, str] = field(default_factory=lambda: GLOSSARY)


def render(report: Report) -> str:
    """The page as text, never beyond the size that a mail takes."""
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["signed"] = _number
    template = environment.get_template("report.html")
    shown, left_out = _that_fit(report)
    return template.render(r=report, recordings=shown, left_out=left_out)


def _that_fit(report: Report) -> tuple[list[tuple[Recording, tuple[Shown, ...]]], int]:
    """Recordings with the pictures that there is room for; how many there is none for."""
    files = sum(len(text.encode()) for _, text in report.vessel_files)
    room = LARGEST - 150_000 - files - sum(_size((p,)) for p in report.evidence)
    out: list[tuple[Recording, tuple[Shown, ...]]] = []
    left_out = 0
    for recording in report.recordings:
        fits = _size(recording.pictures) <= room
        room -= _size(recording.pictures) if fits else 0
        left_out += 0 if fits else len(recording.pictures)
        out.append((recording, recording.pictures if fits else ()))
    return out, left_out


def _size(pictures: Sequence[Shown]) -> int:
    return sum(4 * len(picture.svg.encode()) // 3 for picture in pictures)


def _number(value: float) -> str:
    """Four digits that count, a true minus."""
    return f"{value:.4g}".replace("-", "−")
