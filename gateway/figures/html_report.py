"""The report: one HTML file that asks for nothing outside itself, and the words it explains.

Figures are SVG inside the file, sharp on paper and on a phone, shown without a line of script.
"""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gateway.figures import probability_text

GLOSSARY = {  # words of the pages and the report, each in a sentence
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
LARGEST = 4_700_000  # bytes of the whole file: what a mail takes
PAGE_BYTES = 150_000  # reserved for the page without its figures and vessel files


@dataclass(frozen=True)
class ReportFigure:
    """A figure: its heading, the sentence below it, and the SVG."""

    title: str
    caption: str
    svg: str

    @property
    def address(self) -> str:
        """The figure as an address that holds all of it."""
        return "data:image/svg+xml;base64," + b64encode(self.svg.encode()).decode()


@dataclass(frozen=True)
class ReportRecording:
    """One stretch of a recording: numbers of each vessel, the worst in words, figures."""

    name: str
    seconds: float
    rows: tuple[Mapping[str, Any], ...]
    worst: tuple[tuple[str, tuple[str, ...]], ...]  # vessel, sentences
    notices: tuple[str, ...]
    figures: tuple[ReportFigure, ...]


@dataclass(frozen=True)
class FirstPage:
    """What a client reads: sentences on what was tested, the verdict, what to do, what was assumed.

    picture   measured, and the model before and after, or the model alone
    """

    tested: tuple[str, ...]
    verdict: tuple[str, ...]
    picture: ReportFigure | None
    actions: tuple[str, ...]
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class ReportPage:
    """The page as values; `diagnosis` is what `shadow diagnose --json` prints, if asked for."""

    title: str
    made: str
    headline: str
    recordings: tuple[ReportRecording, ...]
    vessel_files: tuple[tuple[str, str], ...]  # heading, text
    versions: tuple[tuple[str, str], ...]
    first: FirstPage
    diagnosis: Mapping[str, Any] | None = None
    ladder: ReportFigure | None = None
    evidence: tuple[ReportFigure, ...] = ()
    glossary: Mapping[str, str] = field(default_factory=lambda: GLOSSARY)


@dataclass(frozen=True)
class FleetPage:
    """The report of a fleet as values: sentences, rows of texts, maps, courses of numbers.

    boats       boat, recordings, usable, error, noise floor, first and last day
    recordings  recording, boat, began, usable, error, noise floor, state, what it is good for or
                why it is not done
    left_out    courses for which there is no room
    """

    title: str
    made: str
    headline: tuple[str, ...]
    boats: tuple[tuple[str, ...], ...]
    recordings: tuple[tuple[str, ...], ...]
    maps: tuple[ReportFigure, ...]
    courses: tuple[ReportFigure, ...]
    left_out: int = 0


def render_fleet(page: FleetPage) -> str:
    """The page as text; the last courses are left out where it would be too large for a mail."""
    rows = sum(len(cell) + 40 for row in page.recordings for cell in row)
    room, courses = LARGEST - PAGE_BYTES - rows - _size(page.maps), list[ReportFigure]()
    for figure in page.courses:
        room -= _size((figure,))
        if room < 0:
            break
        courses.append(figure)
    shown = replace(page, courses=tuple(courses), left_out=len(page.courses) - len(courses))
    return _environment().get_template("fleet_report.html").render(r=shown)


def render(page: ReportPage) -> str:
    """The page as text, never beyond the size that a mail takes."""
    template = _environment().get_template("report.html")
    recordings, left_out = _within_limit(page)
    return template.render(r=page, recordings=recordings, left_out=left_out)


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["signed"] = _number
    environment.filters["probability"] = probability_text
    return environment


def _within_limit(
    page: ReportPage,
) -> tuple[list[tuple[ReportRecording, tuple[ReportFigure, ...]]], int]:
    """Recordings with the figures that there is room for; the number of those left out."""
    files = sum(len(text.encode()) for _, text in page.vessel_files)
    room = LARGEST - PAGE_BYTES - files - sum(_size((f,)) for f in page.evidence)
    room -= _size((page.first.picture,)) if page.first.picture else 0
    out: list[tuple[ReportRecording, tuple[ReportFigure, ...]]] = []
    left_out = 0
    for recording in page.recordings:
        fits = _size(recording.figures) <= room
        room -= _size(recording.figures) if fits else 0
        left_out += 0 if fits else len(recording.figures)
        out.append((recording, recording.figures if fits else ()))
    return out, left_out


def _size(figures: Sequence[ReportFigure]) -> int:
    """Bytes of the figures in base64."""
    return sum(4 * len(figure.svg.encode()) // 3 for figure in figures)


def _number(value: float) -> str:
    """Four significant digits, a true minus."""
    return f"{value:.4g}".replace("-", "−")
