"""Short formulas for a learned table: a small library of forms, and the effect file of one.

A form is y(x) of one variable with one to three numbers, linear in its sizes: they are fitted to
the table's knots by weighted least squares, the place and width of a form on a grid. What the base
of the vessel can take on by itself (a drag along the same axis) is fitted beside the form and is no
part of it. Which formula does as well as the table is for unseen time to say
(`sim.diagnosis.free_curve`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.state import Floats

GRID = 15  # places of a step or a bump over the range that was sailed
WIDTHS = (0.06, 0.1, 0.16, 0.25)  # of a bump, in ranges
STEP_WIDTH = 0.04  # over which a step rises, in ranges
MIN_STD = 1e-3  # of a knot, in the table's scale: no knot is better known

Grid = Mapping[str, tuple[float, float]]  # place and width by name
Columns = Callable[[Floats, float, float], Sequence[Floats]]


class Form(NamedTuple):
    """y(x): its parts as arrays, and as text and Python for the effect file.

    columns  (x (T,), place, width) -> the parts that sizes multiply
    text     with sizes c, d, place x0 and width w
    python   the same; `x` is the variable
    placed   whether it has a place; `wide`: and a width of its own
    turns    of a heading
    """

    name: str
    columns: Columns
    text: str
    python: str
    sizes: tuple[str, ...] = ("c",)
    placed: bool = False
    wide: bool = False
    turns: bool = False

    @property
    def numbers(self) -> int:
        """How many it has."""
        return len(self.sizes) + self.placed + self.wide


FORMS = (
    Form("constant", lambda x, a, w: [np.ones_like(x)], "c", "p.c + 0.0 * x"),
    Form("linear", lambda x, a, w: [x], "c x", "p.c * x"),
    Form("size", lambda x, a, w: [np.abs(x)], "c |x|", "p.c * np.abs(x)"),
    Form("square", lambda x, a, w: [x * x], "c x²", "p.c * x * x"),
    Form("quadratic", lambda x, a, w: [x * np.abs(x)], "c x |x|", "p.c * x * np.abs(x)"),
    Form("cubic", lambda x, a, w: [x**3], "c x³", "p.c * x * x * x"),
    Form(
        "step", lambda x, a, w: [0.5 + 0.5 * np.tanh((x - a) / w)],
        "c (x > x0)", "p.c * (0.5 + 0.5 * np.tanh((x - p.x0) / p.w))", placed=True,
    ),
    Form(
        "bump", lambda x, a, w: [np.exp(-0.5 * ((x - a) / w) ** 2)],
        "c exp(−½ ((x − x0) / w)²)", "p.c * np.exp(-0.5 * ((x - p.x0) / p.w) ** 2)",
        placed=True, wide=True,
    ),
    Form(
        "once around", lambda x, a, w: [np.cos(x), np.sin(x)], "c cos x + d sin x",
        "p.c * np.cos(x) + p.d * np.sin(x)", ("c", "d"), turns=True,
    ),
    Form(
        "twice around", lambda x, a, w: [np.cos(2.0 * x), np.sin(2.0 * x)], "c cos 2x + d sin 2x",
        "p.c * np.cos(2.0 * x) + p.d * np.sin(2.0 * x)", ("c", "d"), turns=True,
    ),
)  # fmt: skip
DRAG = (FORMS[1], FORMS[4])  # what the base itself can be along one axis


@dataclass(frozen=True)
class FilledForm:
    """A form with its numbers; `y` is what it and the base's own part give at the knots."""

    form: Form
    values: Mapping[str, float]
    y: Floats

    @property
    def numbers(self) -> int:
        """How many the form has."""
        return self.form.numbers


def named_form(name: str) -> Form:
    """KeyError where there is none of that name."""
    return {form.name: form for form in FORMS}[name]


def fitted_forms(
    x: Floats, y: Floats, std: Floats, *, turns: bool = False, own_drag: bool = False
) -> list[FilledForm]:
    """Forms through knots x, y (K,) with standard deviations (K,), the shortest first.

    turns     x is a heading [rad]
    own_drag  a drag over x can be taken on by the base: such forms say nothing
    """
    weight = 1.0 / np.maximum(std, MIN_STD)
    beside = DRAG if own_drag else ()
    able = [f for f in FORMS if (turns and f.turns) or not f.turns]
    able = [f for f in able if f not in beside and not (turns and f.placed)]
    if turns:
        able = [f for f in able if f.turns or f.name == "constant"]
    filled = [_filled(form, x, y, weight, beside) for form in able]
    return sorted(filled, key=lambda f: f.numbers)


def _filled(form: Form, x: Floats, y: Floats, weight: Floats, beside: Sequence[Form]) -> FilledForm:
    """The sizes by least squares, place and width where they leave least."""
    span = float(np.ptp(x)) or 1.0
    places = np.linspace(x.min(), x.max(), GRID) if form.placed else [0.0]
    widths = [w * span for w in WIDTHS] if form.wide else [STEP_WIDTH * span]
    best, least = FilledForm(form, {}, np.zeros_like(y)), np.inf
    for place in places:
        for width in widths:
            own = form.columns(x, float(place), width)
            A = np.column_stack([*own, *(f.columns(x, 0.0, 1.0)[0] for f in beside)])
            sizes = np.linalg.lstsq(A * weight[:, None], y * weight, rcond=None)[0]
            left = float(np.sum((weight * (A @ sizes - y)) ** 2))
            if left < least:
                values = dict(zip(form.sizes, map(float, sizes), strict=False))
                if form.placed:
                    values |= {"x0": float(place), "w": float(width)}
                best, least = FilledForm(form, values, A @ sizes), left
    return best
