"""A diagnosis, the verdict first, and what `shadow add` put into a vessel; the effects themselves.

The catalogue of effects, and one effect explained, with curves drawn in dots of Unicode braille,
four high and two wide per letter.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gateway.errors import shell_path
from gateway.figures import COLOUR, VELOCITIES, SeriesRole, probability_text
from gateway.figures.diagnosis import told_steps
from gateway.figures.matplotlib_draw import save_figure
from gateway.figures.motion import effect_example_figure, effect_with_values
from gateway.figures.words import base_text, diagnosis_texts
from gateway.offline.add import AdditionResult
from gateway.offline.diagnose import DiagnosisResult
from gateway.terminal import ResultConsole, result_table
from sim.diagnosis.answer import Diagnosis, LadderStep, Verdict
from sim.diagnosis.next_experiment import separation
from sim.diagnosis.screening_steps import moment_of
from sim.diagnosis.thresholds import MAX_BASE_SIGMAS
from sim.effects.catalogue import mistaken_for
from sim.effects.effect import Effect, Scope
from sim.excitation.responses import run_example
from sim.identification import BASE
from sim.identification.intervals import Estimate
from sim.state import Floats
from sim.vessel import Vessel


def show_diagnosis(
    found: DiagnosisResult, saved: Path | None, out: Path | None, pictures: Path | None
) -> None:
    """Verdict, ladder, parameters, ranking, doubts, files, and the next command lines."""
    console, d = ResultConsole(highlight=False), found.diagnosis
    console.notices(found.notices)
    for text in diagnosis_texts(d):
        console.print(text, style="bold", markup=False)
    console.print(f"\n{d.verdict}: {d.verdict.in_words(d.unexplained)}", markup=False)
    console.print(f"{d.summary}\n", markup=False)
    console.print(_ladder(d))
    last = d.ladder[-1]
    console.print(f"base: {base_text(d)}", markup=False)
    if d.effects and not d.curve_stands_alone:
        estimates = [e for numbers in last.parameters.values() for e in numbers]
        estimates += [e for e in last.base_parameters if e.name not in BASE]
        console.print(_parameters("what was found", map(_parameter_row, estimates)))
    console.print(_ranking(d))
    limits = (*_at_limit(found), *_found_beside(found))
    console.bullets(
        (*limits, *_doubts(last), *_of_voyages(found), *_look_alikes(found), *_unexplained(d))
    )
    for doubted, heading in (
        (False, "not judged, for these data cannot show it"),
        (True, "not believed, though it would help here"),
    ):
        reasons: dict[str, list[str]] = {}
        for refusal in (r for r in d.refused if r.doubted == doubted):
            reasons.setdefault(refusal.reason, []).append(refusal.effect)
        if reasons:
            console.print(f"\n{heading}:")
            console.bullets(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())
    console.path("written", saved)
    if found.improves:
        console.path("written", out)
    elif out is not None:
        console.print(f"not written: {out}: the vessel holds as it is", markup=False)
    console.path("pictures", pictures)
    steps = found.next_steps(str(saved) if saved else None, str(out) if out else None)
    if steps:
        console.print("\n[bold]next[/bold]:")
        for step in steps:
            console.print(f"    {step}", soft_wrap=True, markup=False)


def _ladder(d: Diagnosis) -> Table:
    """Error on unseen time after each step, with a curve where there is one, and what a perfect
    model would show.

    Of several recordings also that on each by the fit without it.
    """
    table = result_table("error on unseen time (nrmse)", "step", "error", "95 % interval")
    several = any(step.left_out for step in d.ladder)
    if several:
        table.add_column("recordings left out", justify="right")
    for name, step in told_steps(d):
        ci, left_out = step.heldout.ci95, step.left_out
        table.add_row(
            name, f"{step.heldout.nrmse:.3f}",
            f"{ci[0]:.3f} … {ci[1]:.3f}" if ci else "one block only",
            *([f"{left_out.nrmse:.3f}" if left_out else ""] if several else []),
            end_section=step is d.best,
        )  # fmt: skip
    table.add_row("noise alone", f"{d.noise_floor:.3f}", "", *([""] if several else []))
    return table


def _parameters(title: str, rows: Iterable[tuple[str, str, str, str]]) -> Table:
    table = result_table(title, "parameter", "value", "95 % interval", unit=True)
    for row in rows:
        table.add_row(*row)
    return table


def _parameter_row(e: Estimate) -> tuple[str, str, str, str]:
    mark = "" if e.identifiable else " ?"
    return _name(e), f"{e.value:.4g}{mark}", _interval(*e.ci95), e.unit


def _name(e: Estimate) -> str:
    return e.name if e.trial is None else f"{e.name} ({e.trial})"


def _interval(low: float, high: float) -> str:
    return f"{low:.4g} … {high:.4g}" if low != high else "chosen, not fitted"


def _ranking(d: Diagnosis) -> Table:
    """The best of the catalogue, each alone beside the re-fitted base.

    Where nothing is missing no probability is told: it compares what does not help.
    """
    is_told = d.verdict is not Verdict.ADEQUATE
    told = ["probability"] if is_told else []
    title = "each alone beside the re-fitted base"
    table = result_table(title, "effect", *told, "error", "like the first")
    table.add_column("these data cannot tell it from")
    ranking = d.told_ranking
    for row in ranking:
        chance = "not believed" if row.doubted else probability_text(row.probability)
        if row.general_of in d.effects and not row.doubted:
            chance = f"in {row.general_of}"
        table.add_row(
            row.effect, *([chance] if is_told else []),
            f"{row.heldout_nrmse:.3f}", f"{100.0 * row.alike:.0f} %",
            ", ".join(row.confounded_with), end_section=row is ranking[-1],
        )  # fmt: skip
    if is_told:
        none = max(1.0 - sum(row.probability for row in ranking), 0.0)
        table.add_row("the base alone", probability_text(none), "", "", "")
    return table


def _at_limit(found: DiagnosisResult) -> list[str]:
    """Base numbers that would have gone further, and how to let them."""
    names = found.at_limit
    if not names:
        return []
    farther = "" if found.diagnosis.prior >= 1.0 else "; if the file was guessed, add --prior 1"
    share = f"{100.0 * MAX_BASE_SIGMAS * found.diagnosis.prior:.0f} %"
    return [f"{', '.join(names)}: as far from the file as is allowed ({share}){farther}"]


def _found_beside(found: DiagnosisResult) -> list[str]:
    """Effects that are not among the best of the catalogue alone."""
    several = len(found.diagnosis.effects) > 1
    how = "found beside what else was found" if several else "it took the place of another"
    return [
        f"{name}: {how}; by itself it was not among the best at first"
        for name in found.found_beside
    ]


def _doubts(step: LadderStep) -> list[str]:
    every = [e for numbers in step.parameters.values() for e in numbers]
    return [f"{_name(e)} {e.doubt}" for e in (*every, *step.base_parameters) if e.doubt]


def _voyage_effects(vessel: Vessel, names: Sequence[str]) -> list[str]:
    """Those of the named effects that mean nothing on another day."""
    added = [a.effect for a in vessel.effects if a.effect.scope is Scope.VOYAGE]
    return [effect.name for effect in added if effect.name in names]


def _of_voyages(found: DiagnosisResult) -> list[str]:
    best = found.diagnosis.best
    names = _voyage_effects(best.vessel, best.effects)
    if not names:
        return []
    out = [f"{' and '.join(names)}: of this day; on another, compare with --refit voyage"]
    if len(found.trials) > 1:
        effects = (a.effect for a in best.vessel.effects if a.effect.name in names)
        sudden = [effect.name for effect in effects if moment_of(effect) is not None]
        out += [f"{name}: its moment is one for all recordings, counted from the start of each; "
                "one that fell into a recording is told by that recording alone"
                for name in sudden]  # fmt: skip
    return out


def _look_alikes(found: DiagnosisResult) -> list[str]:
    """Each pair that these data cannot tell apart, and what would."""
    separations = found.separations
    out = [f"{a} or {b}? {separation.description}" for (a, b), separation in separations.items()]
    if found.diagnosis.next_manoeuvre:
        out.append(f"what would tell most: {found.diagnosis.next_manoeuvre}")
    separated = {name for pair in separations for name in pair}
    left = [name for name in found.rivals if name not in separated]
    if left:
        out.append(f"{', '.join(left)}: no manoeuvre is known that tells it from the others")
    return out


def _unexplained(d: Diagnosis) -> list[str]:
    rest = "% of what is left"
    out = [f"{each.description} ({100.0 * each.share:.0f} {rest})" for each in d.depends_on]
    if d.effects and d.unexplained >= 0.01:
        out.append(f"{100.0 * d.unexplained:.0f} % of the error above the noise is unexplained")
    return out


def _worse(left_out: float, before: float) -> str:
    """What to think of a vessel that predicts recordings it was not fitted to no better."""
    if left_out < before:
        return ""
    return ", no better than before: what was fitted suits these recordings and may suit no other"


def show_addition(
    done: AdditionResult, names: Sequence[str], vessel: Path, out: Path, own: Sequence[Path] = ()
) -> None:
    """Numbers with intervals, error before and after, the next command line.

    own  files of effects of one's own that the vessels need
    """
    console = ResultConsole(highlight=False)
    rows = (
        (f"{effect}.{key}", f"{n.value:.4g}", _interval(*n.ci95), n.unit)
        for effect, numbers in done.effects.items() for key, n in numbers.items()
    )  # fmt: skip
    console.print(_parameters(f"{done.vessel.name} with {', '.join(names)}", rows))
    console.print(
        f"error on unseen time of {', '.join(done.recordings) or 'the recording'}: "
        f"{done.before:.3f} before, {done.after:.3f} after; the base was re-fitted along",
        markup=False,
    )
    if done.left_out is not None:
        console.print(
            f"on each recording by a fit without it: {done.left_out:.3f}"
            f"{_worse(done.left_out, done.before)}", markup=False,
        )  # fmt: skip
    if done.not_enough:
        console.print(
            "the diagnosis said that nothing in the catalogue is what is missing: what comes near "
            "to it on one recording may do harm on another", markup=False,
        )  # fmt: skip
    console.path("written", out)
    refit = " --refit voyage" if _voyage_effects(done.vessel, names) else ""
    old, new = shell_path(vessel), shell_path(out)
    line = f"shadow compare ANOTHER_LOG --vessel {old} --vessel {new}"
    files = "".join(f" --effects {shell_path(file)}" for file in own)
    console.print(f"next: {line}{refit}{files}", soft_wrap=True, markup=False)


BRAILLE = 0x2800  # code of the letter without dots
BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of its eight dots
LABEL = 8  # letters before the axis
WITHOUT, WITH = COLOUR[SeriesRole.CONTEXT], COLOUR[SeriesRole.MODEL]


def braille_plot(
    curves: list[tuple[Floats, str]], seconds: float, unit: str, width: int = 64, height: int = 10
) -> list[Text]:
    """Curves (n,) with their styles, the first drawn with gaps -> lines of text with both axes."""
    low = min(float(np.min(y)) for y, _ in curves)
    high = max(float(np.max(y)) for y, _ in curves)
    span = max(high - low, 1e-9)
    dots = np.zeros((len(curves), 4 * height, 2 * width), bool)
    for layer, (y, _) in zip(dots, curves, strict=True):
        _draw(layer, (np.asarray(y) - low) / span)
    dots[0, :, 2::4] = dots[0, :, 3::4] = False  # told apart without colours too
    lines = []
    for row in range(height):
        value = high - span * row / (height - 1)
        label = f"{value:{LABEL - 1}.2f} " if row in (0, height - 1) else " " * LABEL
        line = Text(label + "│")
        for column in range(width):
            line.append(*_letter(dots[:, 4 * row : 4 * row + 4, 2 * column : 2 * column + 2],
                                 [style for _, style in curves]))  # fmt: skip
        lines.append(line)
    lines.append(Text(f"{unit:>{LABEL - 1}} └" + "─" * width))
    lines.append(Text(" " * LABEL + " 0" + f"{seconds:.0f} s".rjust(width - 1)))
    return lines


def _draw(layer: np.ndarray, y: Floats) -> None:
    """A curve of heights 0 … 1, unbroken from column to column."""
    rows, columns = layer.shape
    at = np.interp(np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, len(y)), y)
    row = np.round((1.0 - at) * (rows - 1)).astype(int)
    before = np.concatenate([row[:1], row[:-1]])
    for column in range(columns):
        a, b = sorted((int(before[column]), int(row[column])))
        layer[a + (a < b and row[column] == b) : b + 1, column] = True


def _letter(cell: np.ndarray, styles: list[str]) -> tuple[str, str]:
    """Dots (curves, 4, 2) -> the letter, in the colour of the last curve that is in it."""
    present = [style for one, style in zip(cell, styles, strict=True) if one.any()]
    code = BRAILLE + int(BITS[cell.any(axis=0)].sum())
    return (chr(code), present[-1]) if present else (" ", "")


def show_catalogue(known: Sequence[Effect]) -> None:
    """A row per effect; what one types (its name, its parameters) whole, however narrow."""
    table = Table(show_lines=True)
    table.add_column("effect and parameters", no_wrap=True)
    for name in ("acts on", "scope", "what it looks like"):
        table.add_column(name)
    for effect in known:
        parameters = [f"  {p.name} \\[{p.unit}]" for p in effect.parameters]
        table.add_row(
            "\n".join((f"[bold]{effect.name}[/bold]", *parameters)),
            _places(effect), effect.scope.value, effect.looks_like,
        )  # fmt: skip
    out = ResultConsole()
    out.print(table)
    out.print("shadow effects NAME explains one; with --write FILE.py it begins your own")


def show_effect_file(like: Effect, file: Path) -> None:
    """Where the file of a user's own effect was written, and what to do with it."""
    out = ResultConsole()
    out.print(f"written: {file}, which acts as {like.name} does until you change it", markup=False)
    out.print("the rules for a law: docs/effects.md\n\n[bold]next[/bold]:", highlight=False)
    line = f"shadow diagnose LOG --vessel FILE --effects {shell_path(file)}"
    out.print(f"    {line}", soft_wrap=True, markup=False)


def show_effect(effect: Effect, picture: Path | None = None) -> None:
    """Equation, parameters, what it looks like, what it is mistaken for, how to add it."""
    out = ResultConsole()
    out.print(f"[bold]{effect.name}[/bold] ({effect.scope.value}, acts on {_places(effect)})\n")
    out.print(_flowing(effect.explanation), highlight=False, markup=False)
    out.print(f"\n[bold]Looks like[/bold]: {effect.looks_like}")
    _show_example(effect, out, picture)
    alike = mistaken_for(effect)
    if alike:
        out.print(f"[bold]Mistaken for[/bold]: {', '.join(alike)}")
    for other in alike:
        found = separation(effect.name, other)
        if found is not None:
            out.bullets([f"{other}? {found.description}"])
    table = Table("parameter", "unit", "from", "to", "a fit starts at", "says")
    for p in effect.parameters:
        bounds = (f"{p.lower:.9g}", f"{p.upper:.9g}")
        table.add_row(p.name, p.unit, *bounds, f"{p.start:g}", p.description)
    if effect.needs:
        out.print(f"[bold]Needs[/bold]: {escape(', '.join(n.value for n in effect.needs))}")
    if effect.shown_by:
        shown = ", ".join(s.value for s in effect.shown_by)
        out.print(f"[bold]Shown by[/bold] recordings with {escape(shown)}")
    out.print(table)
    out.print("In a vessel file:", highlight=False)
    lines = ["[[effects]]", f'type = "{effect.name}"']
    lines += [f"{p.name} = {p.start}" for p in effect.parameters]
    out.print("\n".join("    " + line for line in lines), highlight=False, markup=False)


def _show_example(effect: Effect, out: ResultConsole, picture: Path | None) -> None:
    """The channel that shows it most, plain and with the effect; all three as a file."""
    example = run_example(effect)
    axis = VELOCITIES[example.channel]
    styles = ((example.plain, WITHOUT), (example.changed, WITH))
    curves = [(values[:, example.channel] * axis.factor, style) for values, style in styles]
    out.print(f"\n[bold]{axis.label}[/bold] of a small boat: ahead, a turn to either side, full "
              "ahead, astern, coast, slowly ahead", highlight=False)  # fmt: skip
    for line in braille_plot(curves, float(example.time[-1]), axis.unit):
        out.print(line, no_wrap=True, highlight=False)
    label = effect_with_values(example)
    out.print(f"[{WITHOUT}]⠤ ⠤ ⠤[/] without it   [{WITH}]⠤⠤⠤⠤⠤[/] with {label}\n", highlight=False)
    if picture is not None:
        out.print(
            f"picture: {save_figure(effect_example_figure(example, effect.looks_like), picture)}"
        )


def _flowing(text: str) -> str:
    """Paragraphs as one line each, which the console wraps; indented lines (equations) stay."""
    parts = (part.strip("\n") for part in text.split("\n\n"))
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in parts)


def _places(effect: Effect) -> str:
    return ", ".join(place.replace("_", " ") for place in effect.laws)
