"""The report: one HTML file that asks for nothing outside itself.

Pictures are SVG inside the file, sharp on paper and on a phone, shown without a line of script.
"""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gateway.glossary import GLOSSARY

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
