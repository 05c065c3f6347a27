"""The catalogue of effects, and one effect explained, with curves drawn in the terminal.

A curve is drawn in dots of Unicode braille, four high and two wide per letter.
"""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

import numpy as np
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from gateway.figures.excitation import effect_example_figure, effect_with_values
from gateway.figures.figure_data import SeriesRole
from gateway.figures.matplotlib_draw import save_figure
from gateway.figures.style import COLOUR, VELOCITIES
from gateway.terminal.console import ResultConsole
from sim.diagnosis.next_experiment import separation
from sim.effects.catalogue import mistaken_for
from sim.effects.effect import Effect
from sim.excitation.effect_example import run_example
from sim.state import Floats

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
    out.print(f"    shadow diagnose LOG --vessel FILE --effects {quote(str(file))}", soft_wrap=True)


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
