"""A learned table as a formula: candidates for its curve, and the file of an own effect."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sim.effects.effect import Formula, Values
from sim.effects.formulas import FilledForm, Form, fitted_forms, named_form
from sim.effects.learned_axes import (
    AHEAD,
    HEADING,
    KNOTS,
    MOTOR,
    SIDEWAYS,
    SURGE,
    SWAY,
    THRUST,
    TURNING,
    YAW,
)

SYMBOLS = {AHEAD: "u", SIDEWAYS: "v", TURNING: "r", HEADING: "ψ", MOTOR: "s"}
PYTHON = {AHEAD: "flow.u", SIDEWAYS: "flow.v", TURNING: "flow.r", HEADING: "flow.yaw"}
MEANING = {AHEAD: "u [m/s] ahead through the water", SIDEWAYS: "v [m/s] to starboard through the "
           "water", TURNING: "r [rad/s]", HEADING: "ψ [rad] the heading",
           MOTOR: "s the thrust of a motor over its full thrust ahead"}  # fmt: skip
AXES = {SURGE: "X", SWAY: "Y", YAW: "N", THRUST: "F_i → F_i (1 + y), y"}
OWN_DRAG = {(AHEAD, SURGE), (SIDEWAYS, SWAY), (TURNING, YAW)}  # what the base's drag can take on
LIMIT = 10.0  # times what was found: how far a size may go


def formulas(vessel: Any, values: Values, std: Mapping[str, float]) -> list[Formula]:
    """Of a filled table and the standard deviations of its knots, the shortest first."""
    by, acts = values["by"], values["acts"]
    x = np.linspace(values["low"], values["high"], KNOTS)
    names = [f"f{k}" for k in range(KNOTS)]
    y, sure = (np.array([of[n] for n in names]) for of in (values, std))
    found = fitted_forms(x, y, sure, turns=by == HEADING, own_drag=(by, acts) in OWN_DRAG)
    return [_formula(filled, vessel, values) for filled in found]


def _formula(filled: FilledForm, vessel: Any, values: Values) -> Formula:
    acts = values["acts"]
    size = {SURGE: 1.0, SWAY: 1.0, YAW: 0.5 * vessel.hull.length, THRUST: 0.0}[acts]
    scale = size * values["full"] if size else 1.0
    sizes = filled.form.sizes
    numbers = {k: v * scale if k in sizes else v for k, v in filled.values.items()}
    if acts == SWAY:
        numbers["x"] = values["x"]
    knots = {f"f{k}": float(np.clip(y, -2.0, 2.0)) for k, y in enumerate(filled.y)}
    text = _text(filled.form, values, numbers)
    return Formula(filled.form.name, text, numbers, {**values, **knots})


def _text(found: Form, values: Values, numbers: Mapping[str, float]) -> str:
    """The equation with its numbers: X = c u, c = 3.1 N s/m."""
    by, acts = values["by"], values["acts"]
    form = found.text.replace("x0", "\0").replace("exp", "\1").replace("x", SYMBOLS[by])
    form = form.replace("\0", f"{SYMBOLS[by]}0").replace("\1", "exp")
    told = {f"{SYMBOLS[by]}0" if k == "x0" else k: v for k, v in numbers.items() if k != "x"}
    at = f", N = {numbers['x']:+.2f} Y" if acts == SWAY else ""
    return f"{AXES[acts]} = {form}{at}, " + ", ".join(f"{k} = {v:.4g}" for k, v in told.items())


def formula_source(name: str, values: Values, formula: Formula) -> str:
    """Text of the Python file of an effect with this formula and these numbers.

    KeyError for a form, a variable or a number that does not exist: nothing of a formula gets into
    a program but its numbers.
    """
    form, by, acts = named_form(formula.form), values["by"], values["acts"]
    needed = {*form.sizes, *(("x0", "w") if form.placed else ()), *(("x",) if acts == SWAY else ())}
    if set(formula.numbers) != needed:
        raise KeyError(f"{formula.form} has the numbers {', '.join(sorted(needed))}")
    text = _text(form, values, formula.numbers)
    numbers = "\n".join(f"        {_parameter(k, v, values)}" for k, v in formula.numbers.items())
    return SOURCE.format(
        title=name.replace("_", " ").capitalize(), name=name, text=text,
        meaning=MEANING[by], law=_law(form.python, by, acts), numbers=numbers,
        place="thrust" if acts == THRUST else "reaction" if by == MOTOR else "force",
        drive="from sim.body import Flow, ThrusterParameters\n" if _of_motor(by, acts)
        else "from sim.body import Flow\n",
        wrench="" if acts == THRUST else "from sim.state import Wrench\n",
    )  # fmt: skip


def _of_motor(by: float, acts: float) -> bool:
    return by == MOTOR or acts == THRUST


def _law(python: str, by: float, acts: float) -> str:
    """The function: its arguments, the variable, what it returns."""
    share = "F / np.maximum(drive.ahead, 1e-9)"
    x = share if by == MOTOR else PYTHON[by]
    if acts == THRUST:
        head = "def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:"
        says, give = "Thrust, motion -> thrust [N].", f"F * (1.0 + {python})"
    else:
        head = "def force(flow: Flow, p: Any) -> Wrench:"
        if by == MOTOR:
            head = (
                "def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:"
            )
        says = "-> X, Y, N on the hull [N, N, N m]."
        give = {
            SURGE: f"Wrench({python}, 0.0, 0.0)",
            SWAY: f"Wrench(0.0, {python}, p.x * ({python}))",
            YAW: f"Wrench(0.0, 0.0, {python})",
        }[acts]
    return f'{head}\n    """{says}"""\n    x = {x}\n    return {give}'


def _parameter(key: str, value: float, values: Values) -> str:
    """One parameter as it is declared: sizes do nothing at zero, places stay in the range."""
    low, high = values["low"], values["high"]
    bounds = {
        "x0": (low, high), "w": (1e-3 * (high - low), high - low), "x": (-50.0, 50.0),
    }.get(key, (-LIMIT * abs(value), LIMIT * abs(value)))  # fmt: skip
    value = min(max(value, bounds[0]), bounds[1])
    neutral = "" if key in ("x0", "w", "x") else ", neutral=0.0"
    start = math.copysign(float(f"{abs(value):.6g}"), value)
    return (
        f'Parameter("{key}", "SI", lower={bounds[0]:.6g}, upper={bounds[1]:.6g}, '
        f"start={start:.6g}{neutral}),"
    )


SOURCE = '''"""{title}: which cause is this?

    {text}

{meaning}; SI units throughout. A formula that predicts unseen time as well as the curve which
`shadow diagnose` learned: it fits, it explains nothing yet. Say here what pushes, where the law is
from, and for what it holds.
"""

from typing import Any

import numpy as np

{drive}from sim.effects.effect import Effect, Parameter, Scope
{wrench}

{law}


EFFECT = Effect(
    name="{name}",
    scope=Scope.BOAT,
    {place}={place},
    parameters=(
{numbers}
    ),
    looks_like="{text}",
)
'''
