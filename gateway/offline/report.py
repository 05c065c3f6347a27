"""`shadow report`: compare, diagnose where asked, and put it all into one HTML file.

compare → diagnose → compare with what was found → figures → page

Without a vessel one is learnt from the first recording: begin → identify → diagnose → compare on
the time that came after, and on the other recordings. On paper (PDF) the page is printed by a
browser of this machine.
"""

import math
import os
import platform
import shutil
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gateway.errors import BadInput
from gateway.figures import HEADING, FigureData, velocity_texts
from gateway.figures.comparison import error_strips, missing_force_by_regime, vessel_errors
from gateway.figures.diagnosis import (
    LadderBar,
    evidence_figure,
    ladder_bars,
    ranking,
    timeline,
    told_steps,
)
from gateway.figures.html_report import ReportFigure, ReportPage, ReportRecording, render
from gateway.figures.matplotlib_draw import svg_text
from gateway.figures.motion import horizon_velocities, track
from gateway.figures.words import RUNS_AWAY, judgement_text, nowhere_text
from gateway.files import write_whole
from gateway.ingest.open import check_each_once
from gateway.offline.compare import (
    TrialComparison,
    compare_by_trial,
    compare_models,
    distinct_vessels,
)
from gateway.offline.diagnose import DIAGNOSIS_TRIALS, DiagnosisResult, diagnose_logs
from gateway.offline.first_page import first_page
from gateway.offline.from_log import learn_from
from gateway.offline.trials import DEFAULT_TRIALS, TrialOptions
from gateway.vessel_file import dump_vessel
from sim.comparison.compare import Comparison, Judgement
from sim.diagnosis.evidence import evidence_of, evidence_of_rivals
from sim.effects.effect import Effect
from sim.identification.wiring import wiring_notices, wiring_of
from sim.model import Model
from sim.state import Progress
from sim.vessel import Vessel

WORST = 5  # regimes that are named, of each vessel
SECTIONS: tuple[tuple[str, Callable[..., FigureData], str], ...] = (
    ("Velocities", horizon_velocities,
     "Blue measured, orange the model, started anew from the measurement at every gap."),
    ("Track", track, "North is up. Darker is worse."),
    ("Size of the error", lambda _, c: error_strips(c),
     "Each row a velocity, each cell a bin. Darker is worse."),
    ("Missing force", lambda _, c: missing_force_by_regime(c),
     "What the model lacks. Within the grey band it is noise of a single estimate."),
)  # fmt: skip


@dataclass(frozen=True)
class ReportFile:
    """Where the report is, how large, and what it says in a sentence; where it was printed."""

    path: Path
    size_bytes: int
    headline: str
    pdf: Path | None = None

    def to_dict(self) -> dict[str, Any]:
        """What `shadow report --json` prints."""
        printed = {"pdf": str(self.pdf)} if self.pdf else {}
        told = {"report": str(self.path), "bytes": self.size_bytes, "headline": self.headline}
        return told | printed


def make_report(
    logs: Sequence[str | Path],
    files: Sequence[str | Path],
    out: str | Path,
    *,
    diagnose: bool = False,
    options: TrialOptions = DEFAULT_TRIALS,
    effects: Iterable[Effect] = (),
    progress: Progress = lambda text: None,
) -> ReportFile:
    """All recordings against all vessels, and with `diagnose` against what the first one lacks.

    Without vessel files: `report_from_log`.
    """
    more = tuple(effects)
    if not files:
        return report_from_log(logs, out, {}, options=options, effects=more, progress=progress)
    vessels, answer = distinct_vessels(files, more), None
    if diagnose:
        coarse = replace(options, rate_hz=DIAGNOSIS_TRIALS.rate_hz)
        answer = diagnose_logs(logs, files[0], options=coarse, effects=more, progress=progress)
        if answer.diagnosis.best.effects:
            vessels = distinct_vessels([*vessels, _improved_vessel(answer)])
    found = compare_by_trial(logs, vessels, options=options, progress=progress)
    progress("pictures")
    return write_report(report_of(found, vessels, answer), out)


def report_from_log(
    logs: Sequence[str | Path],
    out: str | Path,
    given: Mapping[str, float],
    *,
    options: TrialOptions = DEFAULT_TRIALS,
    effects: Iterable[Effect] = (),
    progress: Progress = lambda text: None,
) -> ReportFile:
    """A vessel learnt from the first recording alone, and how it does on time it never saw.

    `given`: what the user knows of the boat (`BoatSize`).
    """
    if not logs:
        raise BadInput("nothing to report on: give at least one recording")
    check_each_once(logs)
    options = options.with_all(logs)
    learnt = learn_from(logs[0], given, options=options, effects=effects, progress=progress)
    vessels = [learnt.plain]
    if learnt.answer is not None and learnt.answer.diagnosis.best.effects:
        vessels.append(_improved_vessel(learnt.answer))
    models = [Model.of(vessel) for vessel in vessels]
    found = compare_models(learnt.split.judge, models, None, progress)
    if logs[1:]:
        refit = learnt.answer is not None and bool(learnt.answer.voyage_effects)
        found += compare_by_trial(
            logs[1:], vessels, options=options, refit=refit, progress=progress
        )
    if not found:
        raise BadInput(f"{logs[0]}: no stretch that is long enough to be compared over")
    progress("pictures")
    page = report_of(found, vessels, learnt.answer, learnt.plain.name, learnt.assumed)
    return write_report(page, out)


def write_report(page: ReportPage, out: str | Path) -> ReportFile:
    """The page as a file, whole or not at all."""
    file, text = Path(out), render(page).encode()
    write_whole(file, text, "the report")
    return ReportFile(file, len(text), page.headline)


def report_of(
    found: Sequence[TrialComparison],
    vessels: Sequence[Vessel],
    answer: DiagnosisResult | None,
    boat: str = "",
    assumed: Sequence[str] = (),
) -> ReportPage:
    """The whole page as values; `boat` where the vessels have other names than it.

    `assumed`: what had to be assumed, a sentence each.
    """
    wiring: tuple[str, ...] = ()
    if not assumed:  # else the outputs are what the recording itself made likely
        trials = [one.trial for one in found]
        wiring = wiring_notices(wiring_of(trials, vessels[0]), vessels[0])
    first = first_page(found, answer, _headline(found), assumed, wiring)
    names = ", ".join(one.trial.name for one in found)
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return ReportPage(
        title=f"{boat or vessels[0].name}: model against measurement",
        made=f"{names}. Made {now} by shadow-gateway {version('shadow-gateway')}.",
        headline=" ".join(first.verdict),
        recordings=tuple(_recording(one) for one in found),
        vessel_files=tuple((v.name, dump_vessel(v)) for v in vessels),
        versions=_versions(),
        first=first,
        diagnosis=None if answer is None else answer.to_dict(),
        ladder=None if answer is None else _ladder(answer),
        evidence=() if answer is None else _evidence(answer),
    )


def _improved_vessel(answer: DiagnosisResult) -> Vessel:
    vessel = answer.diagnosis.vessel
    added = " + ".join(answer.diagnosis.best.effects).replace("_", " ")
    return replace(vessel, name=f"{vessel.name} + {added}")


def _headline(found: Sequence[TrialComparison]) -> str:
    """One sentence: how far above the noise."""
    worst = max((one.comparisons[0] for one in found), key=_how_far)
    floor = f"{worst.noise_floor_nrmse:.2f}"
    if worst.judgement is Judgement.UNJUDGED:
        if worst.standing.runs_away:
            return f"{worst.vessel} cannot be judged: {RUNS_AWAY}."
        return (
            f"These recordings cannot judge {worst.vessel}: noise alone would show an error of "
            f"{floor}, where 1 is as bad as knowing only the mean."
        )
    if worst.judgement is Judgement.ADEQUATE:
        return (
            f"{worst.vessel} is as good as these recordings can tell: its error of "
            f"{worst.nrmse:.2f} is at the noise floor of {floor}."
        )
    wrong = f"Something is wrong with {worst.vessel}: on {worst.log} its error"
    if worst.standing.by_channel:
        return f"{wrong} is {judgement_text(worst.standing)}."
    return f"{wrong} is {worst.nrmse:.2f}, {judgement_text(worst.standing)} ({floor})."


def _how_far(c: Comparison) -> tuple[bool, float]:
    """The order of recordings: those on which something is wrong last."""
    return c.judgement is Judgement.WRONG, c.nrmse / max(c.noise_floor_nrmse, 1e-9)


def _recording(one: TrialComparison) -> ReportRecording:
    return ReportRecording(
        one.trial.name,
        one.comparisons[0].seconds,
        tuple(row for c in one.comparisons for row in _rows(c)),
        tuple((c.vessel, _worst(c)) for c in one.comparisons),
        one.notices,
        tuple(_figures(one)),
    )


def _worst(c: Comparison) -> tuple[str, ...]:
    """Where it is worst, or why that is not said."""
    nowhere = nowhere_text(c.standing)
    sentences = tuple(b.sentence for b in c.worst(WORST))
    return sentences or (f"{nowhere[0].upper()}{nowhere[1:]}.",)


def _rows(c: Comparison) -> list[dict[str, Any]]:
    """The numbers over the horizon, and those of the free run."""
    run = c.free_run.to_dict()["rmse"]
    interval = "" if c.nrmse_ci95 is None else f" ({c.nrmse_ci95[0]:.2f}–{c.nrmse_ci95[1]:.2f})"
    size = (f"{c.nrmse:.3f}{interval}", f"{c.noise_floor_nrmse:.3f}")
    gone = ("diverged", "", "", "", "")
    free = gone if c.free_run.diverged or "u" not in run else _cells(run)
    return [
        {"recording": c.log, "vessel": c.vessel, "run": c.horizon,
         "cells": (*size, *_cells(c.scores.rmse))},
        {"recording": "", "vessel": "", "run": "free", "cells": ("", "", *free)},
    ]  # fmt: skip


def _cells(rmse: Any) -> tuple[str, ...]:
    place = math.hypot(rmse["x"], rmse["y"])
    heading = rmse["psi"] * HEADING.factor
    return (*velocity_texts(rmse), f"{place:.2f}", f"{heading:.2f}")


def _figures(one: TrialComparison) -> list[ReportFigure]:
    """Of several vessels their errors side by side; then the sections of each."""
    several = len(one.comparisons) > 1
    out = []
    if several:
        out.append(
            ReportFigure("Error of each vessel", "", svg_text(vessel_errors(one.comparisons)))
        )
    for c in one.comparisons:
        for title, make, caption in SECTIONS:
            heading = f"{title}: {c.vessel}" if several else title
            out.append(ReportFigure(heading, caption, svg_text(make(one.trial, c))))
    return out


def _ladder(answer: DiagnosisResult) -> ReportFigure:
    d = answer.diagnosis
    caption = "Each step is judged on time that its fit did not see."
    bars = ladder_bars([LadderBar.named(*told) for told in told_steps(d)], d.noise_floor)
    return ReportFigure("The ladder", caption, svg_text(bars))


def _evidence(answer: DiagnosisResult) -> tuple[ReportFigure, ...]:
    """The ranking, what changed at a moment, the evidence for each effect found and its rivals."""
    d = answer.diagnosis
    ranked = [ReportFigure("Which effect", "", svg_text(ranking(d)))] if d.ranking else []
    found = (*evidence_of(d, answer.trials), *evidence_of_rivals(d, answer.trials))
    course = timeline(d, answer.trials)
    figures = [*([course] if course else []), *(evidence_figure(one) for one in found)]
    return (*ranked, *(ReportFigure(one.title, one.caption, svg_text(one)) for one in figures))


def _versions() -> tuple[tuple[str, str], ...]:
    packages = ("shadow-gateway", "numpy", "scipy", "numba", "matplotlib", "pymavlink")
    return (("Python", platform.python_version()), *((name, version(name)) for name in packages))


# All of one family, which prints without a window; names as their packages install them.
BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge",
    "brave-browser",
)  # fmt: skip
PATIENCE_S = 120.0  # chosen: a page of a few MB takes seconds


def find_browser() -> str:
    """Path of a browser that can print; BadInput where there is none."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        raise BadInput(
            f"--pdf: no browser that prints is here ({', '.join(BROWSERS[:3])} …); leave --pdf out "
            "and print the HTML page from your own browser"
        )
    return found


def print_pdf(page: Path, out: Path) -> None:
    """The HTML file `page` as a PDF, whole or not at all; BadInput where the browser fails."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        made = Path(folder) / "report.pdf"
        # A browser that runs as root has no sandbox; the page is ours, and holds no script.
        root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        command = [
            find_browser(), "--headless", "--disable-gpu", "--no-first-run", *root,
            f"--user-data-dir={Path(folder) / 'profile'}", "--no-pdf-header-footer",
            f"--print-to-pdf={made}", page.resolve().as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        except subprocess.TimeoutExpired:
            raise BadInput(
                f"{out}: {command[0]} did not print the report within {PATIENCE_S:.0f} s"
            ) from None
        if not made.is_file() or not made.read_bytes().startswith(b"%PDF"):
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            raise BadInput(f"{out}: {command[0]} printed nothing: {lines[-1] if lines else ''}")
        write_whole(out, made.read_bytes(), "the report")
