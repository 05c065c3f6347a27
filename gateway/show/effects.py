"""The catalogue of effects, and one effect explained."""

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.effects.effect import Effect, Parameter


def show_catalogue(known: Sequence[Effect]) -> None:
    """One line per effect."""
    table = Table("effect", "acts on", "scope", "parameters", "what it looks like")
    for effect in known:
        parameters = ", ".join(f"{p.name} [{p.unit}]" for p in effect.parameters)
        table.add_row(
            effect.name, _places(effect), effect.scope.value, escape(parameters), effect.looks_like
        )
    Console().print(table)
    Console().print("shadow effects NAME explains one. Of your own: docs/effects.md")


def show_effect(effect: Effect) -> None:
    """Equation, parameters, what it looks like, what it is mistaken for, how to add it."""
    out = Console()
    out.print(f"[bold]{effect.name}[/bold] ({effect.scope.value}, acts on {_places(effect)})\n")
    out.print(_flowing(effect.explanation), highlight=False, markup=False)
    out.print(f"\n[bold]Looks like[/bold]: {effect.looks_like}")
    if effect.mistaken_for:
        out.print(f"[bold]Mistaken for[/bold]: {', '.join(effect.mistaken_for)}")
    table = Table("parameter", "unit", "from", "to", "a fit starts at", "says")
    for p in effect.parameters:
        table.add_row(*_parameter(p))
    if effect.needs:
        out.print(f"[bold]Needs[/bold]: {escape(', '.join(n.value for n in effect.needs))}")
    out.print(table)
    out.print("In a vessel file:", highlight=False)
    lines = ["[[effects]]", f'type = "{effect.name}"']
    lines += [f"{p.name} = {p.start}" for p in effect.parameters]
    out.print("\n".join("    " + line for line in lines), highlight=False, markup=False)


def _flowing(text: str) -> str:
    """Paragraphs as one line each, which the console wraps; indented lines (equations) stay."""
    parts = (part.strip("\n") for part in text.split("\n\n"))
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in parts)


def _parameter(p: Parameter) -> tuple[str, ...]:
    return p.name, p.unit, f"{p.lower:.9g}", f"{p.upper:.9g}", f"{p.start:g}", p.says


def _places(effect: Effect) -> str:
    return ", ".join(place.replace("_", " ") for place in effect.laws)
