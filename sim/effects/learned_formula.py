"""A learned table as a formula: candidates for its curve, and the file of an own effect.

Also what a learned table is over, and what it acts on: the codes that a vessel file holds.

A form is y(x) of one variable with one to three numbers, linear in its sizes: they are fitted to
the table's knots by weighted least squares, the place and width of a form on a grid. What the base
of the vessel can take on by itself (a drag along the same axis) is fitted beside the form and is no
part of it. Which formula does as well as the table is for unseen time to say
(`sim.diagnosis.verdict`).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sim.effects.effect import Values
from sim.effects.tables import KNOTS, Formula, knot_shares
from sim.effects.words import FittedValues
from sim.state import Floats

SURGE, SWAY, YAW, THRUST, ANGLE, OUTWARD = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
PUSHES = {SWAY, OUTWARD}  # at a place of their own
AHEAD, SIDEWAYS, TURNING, HEADING, MOTOR, RUDDER, BATTERY = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0

NAMES = {AHEAD: "speed ahead", SIDEWAYS: "speed sideways", TURNING: "yaw rate",
         HEADING: "heading", MOTOR: "thrust of each motor",
         RUDDER: "angle that is commanded", BATTERY: "battery's voltage"}  # fmt: skip
# what a knot is told in: unit, and how many of it make one of the table's
UNITS = {AHEAD: ("m/s", 1.0), SIDEWAYS: ("m/s", 1.0), TURNING: ("°/s", math.pi / 180.0),
         HEADING: ("°", math.pi / 180.0), MOTOR: ("%", 0.01),
         RUDDER: ("°", math.pi / 180.0), BATTERY: ("V", 1.0)}  # fmt: skip


DRAWN_AGAINST = {AHEAD: "surge", SIDEWAYS: "sway", TURNING: "turn_rate", HEADING: "heading",
                 MOTOR: "throttle", RUDDER: "helm", BATTERY: "voltage"}  # fmt: skip


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


SYMBOLS = {AHEAD: "u", SIDEWAYS: "v", TURNING: "r", HEADING: "ψ", MOTOR: "s",
           RUDDER: "δ", BATTERY: "V"}  # fmt: skip
PYTHON = {AHEAD: "flow.u", SIDEWAYS: "flow.v", TURNING: "flow.r", HEADING: "flow.yaw",
          MOTOR: "F / np.maximum(drive.ahead, 1e-9)", RUDDER: "δ",
          BATTERY: "np.fmax(flow.voltage, 0.0)"}  # fmt: skip
MEANING = {AHEAD: "u [m/s] ahead through the water", SIDEWAYS: "v [m/s] to starboard through the "
           "water", TURNING: "r [rad/s]", HEADING: "ψ [rad] the heading",
           MOTOR: "s the thrust of a motor over its full thrust ahead",
           RUDDER: "δ [rad] the angle of each rudder as commanded",
           BATTERY: "V [V] measured"}  # fmt: skip
AXES = {SURGE: "X", SWAY: "Y", YAW: "N", THRUST: "F_i → F_i (1 + y), y", ANGLE: "δ → δ + y, y",
        OUTWARD: "Y = ±y F_i (+ of a motor to starboard), y"}  # fmt: skip
OWN_DRAG = {(AHEAD, SURGE), (SIDEWAYS, SWAY), (TURNING, YAW)}  # what the base's drag can take on
LIMIT = 10.0  # times what was found: how far a size may go


def knot_places(values: Values | FittedValues) -> Floats:
    """Where the knots of a table are (K,), in its variable."""
    return np.asarray(values["low"] + (values["high"] - values["low"]) * knot_shares(values))


def formulas(vessel: Any, values: Values, std: Mapping[str, float]) -> list[Formula]:
    """Of a filled table and the standard deviations of its knots, the shortest first."""
    by, acts = values["by"], values["acts"]
    x = knot_places(values)
    names = [f"f{k}" for k in range(KNOTS)]
    y, sure = (np.array([of[n] for n in names]) for of in (values, std))
    if by == HEADING:  # all around: the last knot is the first
        y[-1], sure[-1] = y[0], sure[0]
    found = fitted_forms(x, y, sure, turns=by == HEADING, own_drag=(by, acts) in OWN_DRAG)
    return [_formula(filled, vessel, values) for filled in found]


def _formula(filled: FilledForm, vessel: Any, values: Values) -> Formula:
    acts = values["acts"]
    size = {SURGE: 1.0, SWAY: 1.0, YAW: 0.5 * vessel.hull.length}.get(acts, 0.0)
    scale = size * values["full"] if size else 1.0
    sizes = filled.form.sizes
    numbers = {k: v * scale if k in sizes else v for k, v in filled.values.items()}
    if acts in PUSHES:
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
    at = f", N = {numbers['x']:+.2f} Y" if acts in PUSHES else ""
    return f"{AXES[acts]} = {form}{at}, " + ", ".join(f"{k} = {v:.4g}" for k, v in told.items())


def formula_source(name: str, values: Values, formula: Formula) -> str:
    """Text of the Python file of an effect with this formula and these numbers.

    KeyError for a form, a variable or a number that does not exist: nothing of a formula gets into
    a program but its numbers.
    """
    form, by, acts = named_form(formula.form), values["by"], values["acts"]
    needed = {
        *form.sizes,
        *(("x0", "w") if form.placed else ()),
        *(("x",) if acts in PUSHES else ()),
    }
    if set(formula.numbers) != needed:
        raise KeyError(f"{formula.form} has the numbers {', '.join(sorted(needed))}")
    of_motors = acts == THRUST or by != BATTERY
    if (acts == ANGLE) != (by == RUDDER) or (acts == OUTWARD and by != MOTOR) or not of_motors:
        raise KeyError(f"a table over the {NAMES[by]} does not act so")
    text = _text(form, values, formula.numbers)
    numbers = "\n".join(f"        {_parameter(k, v, values)}" for k, v in formula.numbers.items())
    return SOURCE.format(
        title=name.replace("_", " ").capitalize(), name=name, text=text,
        meaning=MEANING[by], law=_law(form.python, by, acts), numbers=numbers,
        place=_place(by, acts), drive=f"from sim.body import {_body(by, acts)}\n",
        wrench="" if acts in {THRUST, ANGLE} else "from sim.state import Wrench\n",
    )  # fmt: skip


def _place(by: float, acts: float) -> str:
    """The place of the law in an effect."""
    return {THRUST: "thrust", ANGLE: "angle"}.get(acts, "reaction" if by == MOTOR else "force")


def _body(by: float, acts: float) -> str:
    """What the law takes of `sim.body`."""
    if acts == ANGLE:
        return "RudderParameters"
    return "Flow, ThrusterParameters" if by == MOTOR or acts == THRUST else "Flow"


def _law(python: str, by: float, acts: float) -> str:
    """The function: its arguments, the variable, what it returns."""
    x = PYTHON[by]
    if acts == OUTWARD:
        x += "\n    outward = np.sign(drive.y) * F"
    if acts == ANGLE:
        head = "def angle(δ: float, blade: RudderParameters, p: Any) -> float:"
        says, give = "Angle -> angle [rad].", f"δ + {python}"
    elif acts == THRUST:
        head = "def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:"
        says, give = "Thrust, motion -> thrust [N].", f"F * (1.0 + {python})"
        if by == BATTERY:
            says = "Thrust, voltage (NaN: not measured) -> thrust [N]."
            give = f"F * (1.0 + np.isfinite(flow.voltage) * ({python}))"
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
            OUTWARD: f"Wrench(0.0, outward * ({python}), p.x * outward * ({python}))",
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
