"""A diagnosis, the verdict first, and what `shadow add` put into a vessel."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from shlex import quote

from rich.table import Table

from gateway.figures.diagnosis import step_name
from gateway.figures.style import probability_text
from gateway.figures.words import diagnosis_texts
from gateway.offline.add import AdditionResult
from gateway.offline.diagnose import DiagnosisResult
from gateway.terminal.console import ResultConsole, result_table
from sim.diagnosis.answer import Candidate, Diagnosis, LadderStep
from sim.diagnosis.thresholds import MAX_BASE_SIGMAS
from sim.effects.effect import Scope
from sim.identification.intervals import Estimate
from sim.identification.settings import BASE
from sim.vessel import Vessel


def show_diagnosis(
    found: DiagnosisResult, saved: Path | None, out: Path | None, pictures: Path | None
) -> None:
    """Verdict, ladder, parameters, ranking, doubts, files, and the next command lines."""
    console, d = ResultConsole(highlight=False), found.diagnosis
    console.notices(found.notices)
    for text in diagnosis_texts(d):
        console.print(text, style="bold", markup=False)
    console.print(f"\n{d.verdict}: {d.verdict.description}", markup=False)
    console.print(f"{d.summary}\n", markup=False)
    console.print(_ladder(d))
    moved = "re-fitted, its numbers had to move"
    kept = "its numbers hold as they were given"
    console.print(f"base: {moved if d.base_changed else kept}", markup=False)
    last = d.ladder[-1]
    if d.effects:
        estimates = [e for numbers in last.parameters.values() for e in numbers]
        estimates += [e for e in last.base_parameters if e.name not in BASE]
        console.print(_parameters("what was found", map(_parameter_row, estimates)))
    console.print(_ranking(d.ranking))
    limits = (*_at_limit(found), *_found_beside(found))
    console.bullets(
        (*limits, *_doubts(last), *_of_voyages(found), *_look_alikes(found), *_unexplained(d))
    )
    if d.refused:
        console.print("\nnot judged, for these data cannot show it:")
        reasons: dict[str, list[str]] = {}
        for refusal in d.refused:
            reasons.setdefault(refusal.reason, []).append(refusal.effect)
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
    """Error on unseen time after each step, and what a perfect model would show.

    Of several recordings also that on each by the fit without it.
    """
    table = result_table("error on unseen time (nrmse)", "step", "error", "95 % interval")
    several = any(step.left_out for step in d.ladder)
    if several:
        table.add_column("recordings left out", justify="right")
    for step in d.ladder:
        ci, left_out = step.heldout.ci95, step.left_out
        table.add_row(
            step_name(step), f"{step.heldout.nrmse:.3f}",
            f"{ci[0]:.3f} … {ci[1]:.3f}" if ci else "one block only",
            *([f"{left_out.nrmse:.3f}" if left_out else ""] if several else []),
            end_section=step is d.ladder[-1],
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


def _ranking(ranking: Sequence[Candidate]) -> Table:
    """The best of the catalogue, each alone beside the re-fitted base."""
    title = "each alone beside the re-fitted base"
    table = result_table(title, "effect", "probability", "error", "like the first")
    table.add_column("these data cannot tell it from")
    for row in ranking:
        table.add_row(
            row.effect, probability_text(row.probability), f"{row.heldout_nrmse:.3f}",
            f"{100.0 * row.alike:.0f} %", ", ".join(row.confounded_with),
            end_section=row is ranking[-1],
        )  # fmt: skip
    none = max(1.0 - sum(row.probability for row in ranking), 0.0)
    table.add_row("none of these", probability_text(none), "", "", "")
    return table


def _at_limit(found: DiagnosisResult) -> list[str]:
    """Base numbers that would have gone further, and how to let them."""
    names = found.at_limit
    if not names:
        return []
    farther = "" if found.prior >= 1.0 else "; if the file was guessed, add --prior 1"
    share = f"{100.0 * MAX_BASE_SIGMAS * found.prior:.0f} %"
    return [f"{', '.join(names)}: as far from the file as is allowed ({share}){farther}"]


def _found_beside(found: DiagnosisResult) -> list[str]:
    """Effects that are not among the best of the catalogue alone."""
    return [
        f"{name}: found beside what else was found; alone it is not among the first"
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
    names = _voyage_effects(found.diagnosis.vessel, found.diagnosis.effects)
    if not names:
        return []
    return [f"{' and '.join(names)}: of this day; on another, compare with --refit voyage"]


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


def show_addition(done: AdditionResult, names: Sequence[str], vessel: Path, out: Path) -> None:
    """Numbers with intervals, error before and after, the next command line."""
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
    console.path("written", out)
    refit = " --refit voyage" if _voyage_effects(done.vessel, names) else ""
    line = f"shadow compare ANOTHER_LOG --vessel {quote(str(vessel))} --vessel {quote(str(out))}"
    console.print(f"next: {line}{refit}", soft_wrap=True, markup=False)
