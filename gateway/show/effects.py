"""The catalogue of effects, and one effect explained."""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gateway.pictures.draw import save
from gateway.pictures.effect import said, what_it_does
from gateway.pictures.figure_data import Role
from gateway.pictures.palette import COLOUR
from gateway.pictures.velocities import CHANNELS
from gateway.show.braille import plot
from sim.diagnosis.next_experiment import separation
from sim.effects.effect import Effect, Parameter
from sim.excitation.effect_example import seen

WITHOUT, WITH = COLOUR[Role.CONTEXT], COLOUR[Role.MODEL]


def show_catalogue(known: Sequence[Effect]) -> None:
    """One line per effect."""
    table = Table("effect", "acts on", "scope", "parameters", "what it looks like")
    for effect in known:
        parameters = ", ".join(f"{p.name} [{p.unit}]" for p in effect.parameters)
        table.add_row(
            effect.name, _places(effect), effect.scope.value, escape(parameters), effect.looks_like
        )
    Console().print(table)
    Console().print("shadow effects NAME explains one; with --write FILE.py it begins your own")


def show_own(like: Effect, file: Path) -> None:
    """Where a file to begin from was written, and what to do with it."""
    out = Console()
    out.print(f"written: {file}, which acts as {like.name} does until you change it", markup=False)
    out.print("the rules for a law: docs/effects.md\n\n[bold]next[/bold]:", highlight=False)
    out.print(f"    shadow diagnose LOG --vessel FILE --effects {quote(str(file))}", soft_wrap=True)


def show_effect(effect: Effect, picture: Path | None = None) -> None:
    """Equation, parameters, what it looks like, what it is mistaken for, how to add it."""
    out = Console()
    out.print(f"[bold]{effect.name}[/bold] ({effect.scope.value}, acts on {_places(effect)})\n")
    out.print(_flowing(effect.explanation), highlight=False, markup=False)
    out.print(f"\n[bold]Looks like[/bold]: {effect.looks_like}")
    _picture(effect, out, picture)
    if effect.mistaken_for:
        out.print(f"[bold]Mistaken for[/bold]: {', '.join(effect.mistaken_for)}")
    for other in effect.mistaken_for:
        told = separation(effect.name, other)
        if told is not None:
            out.print(f"• {other}? {told.says}", highlight=False, markup=False)
    table = Table("parameter", "unit", "from", "to", "a fit starts at", "says")
    for p in effect.parameters:
        table.add_row(*_parameter(p))
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


def _picture(effect: Effect, out: Console, picture: Path | None) -> None:
    """The channel that shows it most, plain and with the effect; all three as a file."""
    run = seen(effect)
    _, axis, factor = CHANNELS[run.channel]
    styles = ((run.plain, WITHOUT), (run.changed, WITH))
    curves = [(values[:, run.channel] * factor, style) for values, style in styles]
    out.print(f"\n[bold]{axis.label}[/bold] of a small boat: ahead, a turn to either side, full "
              "ahead, astern, coast, slowly ahead", highlight=False)  # fmt: skip
    for line in plot(curves, float(run.time[-1]), axis.unit):
        out.print(line, no_wrap=True, highlight=False)
    out.print(f"[{WITHOUT}]⠤ ⠤ ⠤[/] without it   [{WITH}]⠤⠤⠤⠤⠤[/] with {said(run)}\n",
              highlight=False)  # fmt: skip
    if picture is not None:
        out.print(f"picture: {save(what_it_does(run, effect.looks_like), picture)}")


def _flowing(text: str) -> str:
    """Paragraphs as one line each, which the console wraps; indented lines (equations) stay."""
    parts = (part.strip("\n") for part in text.split("\n\n"))
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in parts)


def _parameter(p: Parameter) -> tuple[str, ...]:
    return p.name, p.unit, f"{p.lower:.9g}", f"{p.upper:.9g}", f"{p.start:g}", p.says


def _places(effect: Effect) -> str:
    return ", ".join(place.replace("_", " ") for place in effect.laws)
