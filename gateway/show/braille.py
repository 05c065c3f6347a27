"""Two curves in a few lines of text: dots of Unicode braille, four high and two wide per letter."""

import numpy as np
from rich.text import Text

from sim.state import Floats

FIRST = 0x2800
BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
LABEL = 8  # letters before the axis


def plot(
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
    there = [style for one, style in zip(cell, styles, strict=True) if one.any()]
    code = FIRST + int(BITS[cell.any(axis=0)].sum())
    return (chr(code) if there else " "), (there[-1] if there else "")
