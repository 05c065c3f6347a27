"""The first page of a report: what was tested, the verdict, one picture, what to do.

It is written for people who do not read the pages behind it; nothing on it needs the glossary.
"""

from collections.abc import Sequence
from dataclasses import replace

from gateway.figures import VELOCITIES, FigureData, Line, Panel, SeriesRole
from gateway.figures.html_report import FirstPage, ReportFigure
from gateway.figures.matplotlib_draw import svg_text
from gateway.figures.motion import horizon_velocities, with_earlier_model
from gateway.figures.words import diagnosis_texts, judgement_text, moved_numbers
from gateway.offline.compare import TrialComparison
from gateway.offline.diagnose import DiagnosisResult
from gateway.offline.trials import date_of
from sim.comparison.compare import Comparison, Judgement
from sim.diagnosis.answer import Verdict

AXES = ("u", "v", "r")
PUT_RIGHT = "Correct the outputs in the vessel file first: the errors are of motors elsewhere."
GUESSED = (  # what is said of a vessel file, and of what was assumed in its place
    (" than modelled", " than was assumed"),
    (" than in the file", " than was assumed"),
    ("where the file says", "where it was assumed"),
    ("Numbers of the vessel file are off", "Numbers that were assumed are off"),
    ("of the thrust in the file", "of the thrust that was assumed"),
    ("the thrust in the file were", "the thrust that was assumed were"),
    (" of the file", ""),
)
PICTURE_S = 120.0  # of time that the picture shows: more is too dense for half a page


def first_page(
    found: Sequence[TrialComparison],
    answer: DiagnosisResult | None,
    headline: str,
    assumed: Sequence[str] = (),
    wiring: Sequence[str] = (),
) -> FirstPage:
    """The page for comparisons of the same vessels each, the last being the best.

    assumed  what stood in for a vessel file; wiring: where its outputs contradict the recordings
    """
    verdict = (headline,) if answer is None else diagnosis_texts(answer.diagnosis)
    if assumed:
        verdict = tuple(map(of_a_guess, verdict))
    if answer is not None and _is_predicted(found, answer):
        verdict = (headline, *(f"From one moment to the next alone: {text}" for text in verdict))
    if failed := not_borne_out(found):
        verdict = (*failed, *(f"What was found: {text}" for text in verdict))
    verdict = (*_sentences(wiring), *verdict)
    shown = max(found, key=lambda one: one.comparisons[0].nrmse)
    return FirstPage(
        tested=tuple(map(_tested, found)),
        verdict=verdict,
        picture=_picture(shown),
        actions=_sentences(_with_outputs_right(_actions(found, answer), answer, wiring)),
        assumed=_sentences(assumed),
    )


def _sentences(texts: Sequence[str]) -> tuple[str, ...]:
    """Each with a capital letter and a full stop."""
    return tuple(f"{text[0].upper()}{text[1:].removesuffix('.')}." for text in texts)


def _with_outputs_right(
    actions: Sequence[str], answer: DiagnosisResult | None, wiring: Sequence[str]
) -> tuple[str, ...]:
    """What to do, with the outputs first where they are wrong: unless what was found exchanges
    them, and each mistake of theirs once.
    """
    others = [text for text in dict.fromkeys(actions) if text not in wiring]
    if not wiring:
        return tuple(others)
    found = () if answer is None else answer.diagnosis.vessel.effects
    exchanged = any(added.effect.wiring is not None for added in found)
    return tuple(others if exchanged else [PUT_RIGHT, *others])


def _is_predicted(found: Sequence[TrialComparison], answer: DiagnosisResult) -> bool:
    """Whether something is said to be missing without a name, though the first vessel predicts all
    recordings to the noise.
    """
    judged = {one.comparisons[0].judgement for one in found}
    return answer.diagnosis.verdict is Verdict.UNKNOWN and judged == {Judgement.ADEQUATE}


def of_a_guess(text: str) -> str:
    """A sentence about a vessel of whom nobody wrote a file: what is off was assumed."""
    for given, guessed in GUESSED:
        text = text.replace(given, guessed)
    return text


def not_borne_out(found: Sequence[TrialComparison]) -> tuple[str, ...]:
    """A sentence for each recording on which the last vessel does worse than the first."""
    pairs = [(one.comparisons[0], one.comparisons[-1]) for one in found if one.comparisons[1:]]
    return tuple(
        f"What was found is not borne out: on {after.log} the error rises from "
        f"{before.nrmse:.2f} to {after.nrmse:.2f}."
        for before, after in pairs
        if f"{after.nrmse:.2f}" != f"{before.nrmse:.2f}"
        and after.nrmse > before.nrmse
        and after.judgement is not Judgement.ADEQUATE
    )


def _tested(one: TrialComparison) -> str:
    """Which recording, of which day, how long, and how far each vessel is off."""
    errors = "; ".join(
        f"{c.vessel}: error {c.nrmse:.2f}, {judgement_text(c.standing)}" for c in one.comparisons
    )
    seconds = f"{one.comparisons[0].seconds:.0f} s"
    which = ", ".join(filter(None, (one.trial.name, date_of(one.trial), seconds)))
    return f"{which}. {errors}."


def _picture(one: TrialComparison) -> ReportFigure:
    """The velocity that the first vessel is worst at: measured, before and after."""
    before, after = one.comparisons[0], one.comparisons[-1]
    axis = max(range(3), key=lambda i: _share(before, i))
    data = horizon_velocities(one.trial, after)
    if after is not before:
        earlier = horizon_velocities(one.trial, before)
        data = with_earlier_model(earlier, data, "before")
    panel = _named(data.panels[axis], "after" if after is not before else "predicted")
    name = VELOCITIES[axis].label
    what = "before and after" if after is not before else "measured and predicted"
    caption = f"The model starts anew from the measurement every {before.horizon}. " + _errors_text(
        before, after
    )
    figure = _window(FigureData("", (panel,)), one)
    return ReportFigure(f"{name[0].upper()}{name[1:]}, {what}", caption, svg_text(figure))


def _named(panel: Panel, model: str) -> Panel:
    """A panel whose line of the model has that name."""
    marks = tuple(
        replace(mark, label=model)
        if isinstance(mark, Line) and mark.role is SeriesRole.MODEL
        else mark
        for mark in panel.marks
    )
    return replace(panel, marks=marks, title="")


def _share(c: Comparison, i: int) -> float:
    """Error of a velocity in the scales of the comparison."""
    return float(c.scores.rmse[AXES[i]] / c.ruler.scales[i])


def _errors_text(before: Comparison, after: Comparison) -> str:
    floor = f"noise alone would show {before.noise_floor_nrmse:.2f}"
    if after is before:
        return f"Error {before.nrmse:.2f}; {floor}."
    return f"Error {before.nrmse:.2f} before, {after.nrmse:.2f} after; {floor}."


def _window(data: FigureData, one: TrialComparison) -> FigureData:
    """The first stretch of usable time that fits on half a page."""
    start = float(one.trial.time[one.trial.usable][0])
    panel = data.panels[0]
    marks = []
    for mark in panel.marks:
        if isinstance(mark, Line):
            rows = (mark.x >= start) & (mark.x <= start + PICTURE_S)
            marks.append(replace(mark, x=mark.x[rows], y=mark.y[rows]))
    return replace(data, panels=(replace(panel, marks=tuple(marks)),))


def _actions(found: Sequence[TrialComparison], answer: DiagnosisResult | None) -> list[str]:
    """What to do next, the likeliest first."""
    verdicts = {one.comparisons[0].judgement for one in found}
    if answer is None:
        if Judgement.WRONG in verdicts:
            return ["Find out what is missing: the same command with --diagnose."]
        if Judgement.ADEQUATE in verdicts:
            return ["Use the model as it is, for what these recordings hold of speeds and turns."]
        if any(one.comparisons[0].standing.runs_away for one in found):
            return ["Check the numbers of the vessel: mass, inertia, damping."]
        return ["Record a longer run with more turns and changes of speed: shadow plan writes one."]
    d, out = answer.diagnosis, list(answer.notices)
    if not_borne_out(found):
        out.append("Do not use the vessel with what was found; record a longer run with more turns "
                   "and changes of speed: shadow plan writes one.")  # fmt: skip
    elif d.best.effects:
        out.append("Use the better vessel file at the end of this report, and compare it with a "
                   "recording of another day.")  # fmt: skip
    elif answer.improves:
        numbers = moved_numbers(d.ladder[-1])
        moved = f" ({numbers})" if numbers else ""
        out.append("Use the vessel file at the end of this report: its plain numbers had to move"
                   f"{moved}.")  # fmt: skip
    if answer.voyage_effects:
        out.append("What belongs to this day (current, wind, load) is to be found anew on others.")
    manoeuvre = d.next_manoeuvre or next((s.description for s in answer.separations.values()), None)
    if manoeuvre and d.verdict is not Verdict.ADEQUATE:
        out.append(f"Sail what would settle it: {manoeuvre}.")
    if d.verdict is Verdict.UNKNOWN:
        out.append(
            "Look at the pages behind for what the rest depends on: no known effect does it."
        )
    return out or ["Nothing: the model does as well as these recordings can tell."]
