"""A learned table as a short law: the form that made it is found, and its file says the same."""

from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.user_effects import load_effects, write_effect_formula
from sim.effects.learned import EFFECT
from sim.effects.learned_formula import (
    AHEAD,
    ANGLE,
    BATTERY,
    FORMS,
    HEADING,
    KNOTS,
    MOTOR,
    OUTWARD,
    RUDDER,
    SURGE,
    SWAY,
    THRUST,
    TURNING,
    YAW,
    fitted_forms,
    formulas,
)
from sim.effects.tables import Formula
from tests.sim.vessels import WAMV

X = np.linspace(-0.4, 2.0, KNOTS)
SURE = np.full(KNOTS, 0.01)
EMPTY = {**EFFECT.example, "low": -0.4, "high": 2.0}
STD = {f"f{k}": 0.01 for k in range(KNOTS)}


def best(y, **how):
    """The shortest form of those that leave nearly nothing of the knots."""
    found = fitted_forms(X, y, SURE, **how)
    left = [float(np.sum((f.y - y) ** 2)) for f in found]
    return next(f for f, rest in zip(found, left, strict=True) if rest <= 1.01 * min(left) + 1e-12)


@pytest.mark.parametrize(
    ("y", "name", "numbers"),
    [
        (0.3 * X, "linear", {"c": 0.3}),
        (-0.2 * X * np.abs(X), "quadratic", {"c": -0.2}),
        (0.1 * X * X, "square", {"c": 0.1}),
        (np.full(KNOTS, 0.2), "constant", {"c": 0.2}),
    ],
)
def test_the_form_that_made_the_knots_is_the_first_that_fits(y, name, numbers):
    found = best(y)
    assert found.form.name == name
    assert found.values == pytest.approx(numbers)


def test_a_hump_is_a_bump_in_its_place_whatever_drag_lies_beneath():
    hump = -0.4 * np.exp(-0.5 * ((X - 0.8) / 0.38) ** 2)
    found = best(hump + 0.15 * X - 0.08 * X * np.abs(X), own_drag=True)
    assert found.form.name == "bump"
    assert found.values["x0"] == pytest.approx(0.8, abs=0.09)
    assert found.values["c"] == pytest.approx(-0.4, rel=0.2)


def test_a_drag_that_the_base_can_take_on_is_no_formula():
    names = {f.form.name for f in fitted_forms(X, -0.3 * X, SURE, own_drag=True)}
    assert not {"linear", "quadratic"} & names
    assert {"linear", "quadratic"} <= {f.form.name for f in fitted_forms(X, -0.3 * X, SURE)}


def test_knots_that_nothing_determined_bend_no_formula():
    y, std = 0.3 * X, SURE.copy()
    y[-1], std[-1] = 1.5, 5.0
    line = next(f for f in fitted_forms(X, y, std) if f.form.name == "linear")
    assert line.values["c"] == pytest.approx(0.3, abs=1e-3)


def test_a_heading_has_only_forms_that_close():
    turning = np.linspace(0.0, 2.0 * np.pi, KNOTS)
    found = fitted_forms(turning, np.cos(turning), SURE, turns=True)
    assert {f.form.name for f in found} == {"constant", "once around", "twice around"}


def flow_at(by, x):
    """A motion whose variable of the table is x."""
    body = SimpleNamespace(length=WAMV.hull.length)
    motion = dict.fromkeys(("u", "v", "r", "yaw", "voltage"), 0.0)
    name = {AHEAD: "u", TURNING: "r", HEADING: "yaw", BATTERY: "voltage"}.get(by)
    return SimpleNamespace(**(motion | ({name: x} if name else {})), body=body)


@pytest.mark.parametrize(
    ("by", "acts"),
    [
        (MOTOR, OUTWARD),
        (BATTERY, THRUST),
        *product((AHEAD, TURNING, HEADING, MOTOR), (SURGE, SWAY, YAW, THRUST)),
    ],
)
def test_the_file_of_a_formula_does_what_its_table_says(by, acts, tmp_path: Path):
    high = 2.0 * np.pi if by == HEADING else 2.0
    table = {**EMPTY, "by": by, "acts": acts, "low": 0.0, "high": high, "x": -0.3}
    at = np.linspace(0.0, high, KNOTS)
    table |= {f"f{k}": float(0.2 * np.cos(x) - 0.1 * x * (by != HEADING)) for k, x in enumerate(at)}
    for i, formula in enumerate(formulas(WAMV, table, STD)):
        file = tmp_path / f"own_{i}.py"
        write_effect_formula(EFFECT, table, formula, file)
        (own,) = load_effects(file)
        assert own.name == file.stem
        assert formula.text.split(",")[0] in own.looks_like
        p = SimpleNamespace(**{q.name: q.start for q in own.parameters})
        filled = SimpleNamespace(**formula.values)
        drive = SimpleNamespace(ahead=50.0, y=-0.4)
        (place,) = own.laws
        for x in at:
            F = 50.0 * x if by == MOTOR else 20.0
            given = (flow_at(by, x),) if place == "force" else (F, drive, flow_at(by, x))
            said = np.array(own.laws[place](*given, p), float)
            told = np.array(EFFECT.laws[place](*given, filled), float)
            size = max(np.abs(said).max(), 1e-3)
            if not own_drag(by, acts):  # there the table holds what the base takes on as well
                np.testing.assert_allclose(said, told, atol=2e-2 * size, err_msg=formula.text)


def test_the_file_of_a_formula_turns_the_rudder_as_its_table_says(tmp_path: Path):
    table = {**EMPTY, "by": RUDDER, "acts": ANGLE, "low": -0.6, "high": 0.6}
    at = np.linspace(-0.6, 0.6, KNOTS)
    table |= {f"f{k}": float(-0.3 * x) for k, x in enumerate(at)}
    weaker = next(f for f in formulas(WAMV, table, STD) if f.form == "linear")
    assert weaker.text.startswith("δ → δ + y, y = c δ, c = -0.3")
    file = tmp_path / "linkage.py"
    write_effect_formula(EFFECT, table, weaker, file)
    (own,) = load_effects(file)
    assert set(own.laws) == {"angle"}
    p = SimpleNamespace(**{q.name: q.start for q in own.parameters})
    assert own.laws["angle"](0.5, None, p) == pytest.approx(0.35)


def own_drag(by, acts):
    return (by, acts) in {(AHEAD, SURGE), (TURNING, YAW)}


@pytest.mark.parametrize(
    ("formula", "table"),
    [
        (Formula("linear", "", {"c": 1.0, 'd", start=__import__("os")': 1.0}, {}), EMPTY),
        (Formula("evil", "", {"c": 1.0}, {}), EMPTY),
        (Formula("linear", "", {"c": 1.0}, {}), {**EMPTY, "by": 7.0}),
        (Formula("linear", "", {}, {}), EMPTY),
        # no motor and no rudder to act on
        (Formula("linear", "", {"c": 1.0, "x": 0.0}, {}), {**EMPTY, "by": AHEAD, "acts": OUTWARD}),
        (Formula("linear", "", {"c": 1.0}, {}), {**EMPTY, "by": AHEAD, "acts": ANGLE}),
        (Formula("linear", "", {"c": 1.0}, {}), {**EMPTY, "by": RUDDER, "acts": SURGE}),
        (Formula("linear", "", {"c": 1.0}, {}), {**EMPTY, "by": BATTERY, "acts": SURGE}),
    ],
)
def test_nothing_of_a_diagnosis_gets_into_a_program_but_numbers(formula, table, tmp_path: Path):
    with pytest.raises(BadInput, match="not known here"):
        write_effect_formula(EFFECT, table, formula, tmp_path / "own.py")
    text = Formula("linear", '"; import os', {"c": 1.0}, {})
    write_effect_formula(EFFECT, EMPTY, text, tmp_path / "own.py")
    assert "import os" not in (tmp_path / "own.py").read_text()


def test_the_forms_say_and_compute_the_same():
    x = np.linspace(0.1, 1.9, 7)
    for form in FORMS:
        p = SimpleNamespace(c=0.7, d=-0.4, x0=0.9, w=0.3)
        parts = form.columns(x, p.x0, p.w)
        want = sum(getattr(p, s) * part for s, part in zip(form.sizes, parts, strict=True))
        got = eval(form.python, {"np": np, "p": p, "x": x})
        np.testing.assert_allclose(got, want, atol=1e-12, err_msg=form.name)
