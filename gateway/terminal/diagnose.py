"""A diagnosis in the terminal: the verdict first, then what it stands on, then what to do next.

What `shadow add` put into a vessel, what it was worth, and how to see that on other data.
"""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.offline.add import Added
from gateway.offline.diagnose import Diagnosed
from sim.diagnosis.answer import Candidate, Diagnosis, LadderStep
from sim.effects.effect import Scope
from sim.identification.intervals import Estimate

UNLIKELY = 0.001


def show_diagnosed(
    found: Diagnosed, saved: Path | None, out: Path | None, pictures: Path | None
) -> None:
    """Everything, the verdict first."""
    console, d = Console(highlight=False), found.diagnosis
    for says in found.notices:
        console.print(f"[bold]![/bold] {escape(says)}")
    console.print(f"[bold]{d.verdict}[/bold]: {d.verdict.says}")
    console.print(f"{d.summary}\n", markup=False)
    console.print(_ladder(d))
    console.print(_base(d), markup=False)
    if d.effects:
        console.print(_parameters(d.ladder[-1]))
    console.print(_ranking(d.ranking))
    for says in (*_doubts(d.ladder[-1]), *_of_a_day(found), *_look_alikes(found), *_left(d)):
        console.print(f"• {says}", markup=False)
    if d.refused:
        console.print("\nnot judged, for these data cannot show it:")
        for because, names in _together(d).items():
            console.print(f"• {', '.join(names)}: {because}", markup=False)
    for file in (saved, out if found.improves else None):
        if file is not None:
            console.print(f"written: {file}", soft_wrap=True, markup=False)
    if out is not None and not found.improves:
        console.print(f"not written: {out}: the vessel holds as it is", markup=False)
    if pictures is not None:
        console.print(f"pictures: {pictures}", soft_wrap=True, markup=False)
    steps = found.next_steps(str(saved) if saved else None, str(out) if out else None)
    if steps:
        console.print("\n[bold]next[/bold]:")
        for step in steps:
            console.print(f"    {step}", soft_wrap=True, markup=False)


def _ladder(d: Diagnosis) -> Table:
    """Error on unseen time after each step, and what a perfect model would show."""
    table = Table(title="error on unseen time (nrmse)", title_justify="left")
    for name in ("step", "error", "95 % interval"):
        table.add_column(name, justify="left" if name == "step" else "right", no_wrap=True)
    for rung in d.ladder:
        ci = rung.heldout.ci95
        table.add_row(
            step_name(rung), f"{rung.heldout.nrmse:.3f}",
            f"{ci[0]:.3f} … {ci[1]:.3f}" if ci else "one block only",
            end_section=rung is d.ladder[-1],
        )  # fmt: skip
    table.add_row("noise alone", f"{d.floor:.3f}", "")
    return table


def step_name(rung: LadderStep) -> str:
    """What was done on this rung."""
    if rung.base == "plain":
        return "as given"
    return f"+ {rung.effects[-1]}" if rung.effects else "base re-fitted"


def _base(d: Diagnosis) -> str:
    if d.base_changed:
        return "base: re-fitted, its numbers had to move"
    return "base: its numbers hold as they were given"


def _parameters(rung: LadderStep) -> Table:
    table = Table(title="what was found", title_justify="left")
    for name in ("parameter", "value", "95 % interval", "unit"):
        right = name in ("value", "95 % interval")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    for numbers in rung.parameters.values():
        for e in numbers:
            table.add_row(_name(e), f"{e.value:.4g}{_mark(e)}", _interval(e), e.unit)
    return table


def _name(e: Estimate) -> str:
    return e.name if e.trial is None else f"{e.name} ({e.trial})"


def _mark(e: Estimate) -> str:
    return "" if e.identifiable else " ?"


def _interval(e: Estimate) -> str:
    if e.ci95[0] == e.ci95[1]:
        return "chosen, not fitted"
    return f"{e.ci95[0]:.4g} … {e.ci95[1]:.4g}"


def _ranking(ranking: Sequence[Candidate]) -> Table:
    """The best of the catalogue, each alone beside the re-fitted base."""
    table = Table(title="each alone beside the re-fitted base", title_justify="left")
    table.add_column("effect", no_wrap=True)
    for name in ("probability", "error", "like the first"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("these data cannot tell it from")
    for row in ranking:
        table.add_row(
            row.effect, _probability(row.probability), f"{row.heldout_nrmse:.3f}",
            f"{100.0 * row.alike:.0f} %", ", ".join(row.confounded_with),
            end_section=row is ranking[-1],
        )  # fmt: skip
    none = 1.0 - sum(row.probability for row in ranking)
    table.add_row("none of these", _probability(max(none, 0.0)), "", "", "")
    return table


def _probability(p: float) -> str:
    return f"{100.0 * p:.1f} %" if p >= UNLIKELY else "< 0.1 %"


def _doubts(rung: LadderStep) -> list[str]:
    every = [e for numbers in rung.parameters.values() for e in numbers]
    return [f"{_name(e)} {e.doubt}" for e in (*every, *rung.base_parameters) if e.doubt]


def _of_a_day(found: Diagnosed) -> list[str]:
    names = [
        a.effect.name for a in found.diagnosis.vessel.effects
        if a.effect.scope is Scope.VOYAGE and a.effect.name in found.diagnosis.effects
    ]  # fmt: skip
    if not names:
        return []
    return [f"{' and '.join(names)}: of this day; on another, compare with --refit voyage"]


def _look_alikes(found: Diagnosed) -> list[str]:
    """Each pair that these data cannot tell apart, and what would."""
    told = found.separations
    out = [f"{a} or {b}? {s.says}" for (a, b), s in told.items()]
    known = {name for pair in told for name in pair}
    if found.diagnosis.next_manoeuvre:
        out.append(f"what would tell most: {found.diagnosis.next_manoeuvre}")
    left = [name for name in found.rivals if name not in known]
    if left:
        out.append(f"{', '.join(left)}: no manoeuvre is known that tells it from the others")
    return out


def _left(d: Diagnosis) -> list[str]:
    out = [f"{each.says} ({100.0 * each.share:.0f} % of what is left)" for each in d.depends_on]
    if d.effects and d.unexplained >= 0.01:
        out.append(f"{100.0 * d.unexplained:.0f} % of the error above the noise is unexplained")
    return out


def _together(d: Diagnosis) -> dict[str, list[str]]:
    """Reason -> the effects that it keeps out."""
    out: dict[str, list[str]] = {}
    for one in d.refused:
        out.setdefault(one.because, []).append(one.effect)
    return out


def show_added(done: Added, names: Sequence[str], vessel: Path, out: Path) -> None:
    """Numbers with intervals, error before and after, the next command line."""
    console = Console(highlight=False)
    table = Table(title=f"{done.vessel.name} with {', '.join(names)}", title_justify="left")
    for name in ("parameter", "value", "95 % interval", "unit"):
        right = name in ("value", "95 % interval")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    for effect, numbers in done.effects.items():
        for key, n in numbers.items():
            low, high = n.ci95
            interval = f"{low:.4g} … {high:.4g}" if low < high else "chosen, not fitted"
            table.add_row(f"{effect}.{key}", f"{n.value:.4g}", interval, n.unit)
    console.print(table)
    console.print(
        f"error on unseen time of {', '.join(done.recordings) or 'the recording'}: "
        f"{done.before:.3f} before, {done.after:.3f} after; the base was re-fitted along",
        markup=False,
    )
    console.print(f"written: {out}", soft_wrap=True, markup=False)
    today = any(
        a.effect.scope is Scope.VOYAGE for a in done.vessel.effects if a.effect.name in names
    )
    console.print(
        f"next: shadow compare ANOTHER_LOG --vessel {quote(str(vessel))} "
        f"--vessel {quote(str(out))}{' --refit voyage' if today else ''}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
