"""Which effects are followed, and what a first look tells."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from sim.diagnosis import screening, thresholds
from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.screening import (
    CATALOGUE,
    FIRST_IMPRESSION,
    first_impression,
    in_its_place,
)
from sim.diagnosis.screening_steps import Begun, Screening
from sim.effects import learned_spot
from sim.effects.catalogue import named
from sim.model import Model
from sim.state import CountedStep
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

NAMES = sorted(CATALOGUE)
BEFORE = 1000.0


def looked(name: str, promise: float, cost: float = 1.0) -> Any:
    return SimpleNamespace(name=name, deviance=BEFORE - promise, cost=cost)


def begun(name: str, cost: float = 1.0, promised: float | None = None) -> Any:
    return Begun(cast(Any, None), looked(name, 0.0, cost), cost if promised is None else promised)


def followed(results: list[Any], every: dict[str, list[Any]]) -> list[str]:
    """The names, in the order of the catalogue, one for each start that is followed."""
    some = screening._followed(results, every, BEFORE)
    return [each.result.name for begun in some for each in begun]


@pytest.fixture(autouse=True)
def _two_at_least(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.diagnosis.screening.thresholds.MIN_FOLLOWED", 2)
    monkeypatch.setattr("sim.diagnosis.screening.thresholds.MIN_PROMISE_FOLLOWED", 0.1)


def test_the_most_promising_are_followed() -> None:
    """A share of what the best one promises, and so many in any case; the others are settled."""
    a, b, c, d = NAMES[:4]
    every = {name: [begun(name)] for name in (a, b, c, d)}
    results = [looked(a, 100.0), looked(b, 20.0), looked(c, 11.0), looked(d, 9.0)]
    assert followed(results, every) == [a, b, c]
    results = [looked(a, 100.0), looked(b, 2.0), looked(c, 1.0), looked(d, -1e6)]
    assert followed(results, every) == [a, b]


def test_what_still_falls_is_followed_whatever_it_promises() -> None:
    """A lag begins far above the error of the boat without one, and comes down step by step."""
    a, b, c = NAMES[:3]
    every = {a: [begun(a)], b: [begun(b)], c: [begun(c, 9.0, promised=8.0)]}
    results = [looked(a, 100.0), looked(b, 50.0), looked(c, -900.0, 9.0)]
    assert followed(results, every) == [a, b, c]


def test_of_two_bases_the_better_is_followed_and_the_other_while_it_promises_more() -> None:
    a, b, c, d = NAMES[:4]
    results = [
        looked(name, promise) for name, promise in ((a, 100.0), (b, 50.0), (c, 1.0), (d, 0.0))
    ]
    every = {
        a: [begun(a, 1.0), begun(a, 2.0)],
        b: [begun(b, 3.0), begun(b, 9.0, promised=2.0)],
        c: [begun(c, 5.0), begun(c, 6.0, promised=5.5)],
        d: [begun(d, 7.0), begun(d, 8.0, promised=6.0)],
    }
    some = screening._followed(results, every, BEFORE)
    costs = [[each.result.cost for each in of_one] for of_one in some]
    assert costs == [[1.0], [3.0, 9.0], [8.0]]


def test_ones_own_effect_is_followed_for_somebody_asks_for_it() -> None:
    a, b = NAMES[:2]
    every = {a: [begun(a)], b: [begun(b)], "keel": [begun("keel")]}
    results = [looked(a, 100.0), looked(b, 50.0), looked("keel", -5.0)]
    assert followed(results, every) == [a, b, "keel"]


def test_nothing_looked_at_leaves_nothing_to_follow() -> None:
    assert screening._followed([], {}, BEFORE) == []


def test_what_promises_much_less_than_an_effect_has_is_not_fitted_in_its_place() -> None:
    results = [looked(name, promise) for name, promise in (("a", 120.0), ("b", 80.0), ("c", 60.0))]
    for has, left in ((100.0, ["a", "b"]), (150.0, ["a"]), (200.0, []), (-10.0, ["a", "b", "c"])):
        assert [r.name for r in in_its_place(results, BEFORE, BEFORE - has)] == left


def test_a_first_impression_names_three_at_most() -> None:
    results = [looked(name, 0.0) for name in ("a", "b", "c", "d")]
    said = f"{FIRST_IMPRESSION}: most like a"
    assert first_impression(results) == f"{said}, then b or c, if anything is missing"
    assert first_impression(results[:2]) == f"{said}, then b, if anything is missing"
    assert first_impression(results[:1]) == f"{said}, if anything is missing"


@pytest.mark.parametrize(
    ("costs", "promises", "settled", "promised"),
    [
        ([100.0, 50.0, 49.9], [60.0, 49.0], True, 49.9),  # the last step brought little
        ([100.0, 50.0, 40.0], [60.0, 30.0], False, 30.0),
        ([100.0, 50.0, 40.0], [60.0, 45.0], False, 39.6),  # it fell below what was promised
        ([100.0, 99.9], [60.0], True, 99.9),
    ],
)
def test_what_fell_by_its_last_step_is_not_settled(
    costs: list[float], promises: list[float], settled: bool, promised: float
) -> None:
    """Slopes may promise less than a step brings: a lag comes down from far above."""
    steps: Any = [SimpleNamespace(cost=cost) for cost in costs]
    slopes = iter(SimpleNamespace(promised=p, to=k + 1) for k, p in enumerate(promises))
    made: Any = SimpleNamespace(
        _steps=lambda some: some, _slopes=lambda _: [next(slopes)],
        _best_steps=lambda some: [steps[s.to] for s in some],
    )  # fmt: skip
    begun = Screening.begun(made, steps[:1])
    assert begun is not None
    assert begun.is_settled == settled
    assert begun.promised == pytest.approx(promised)


@pytest.mark.parametrize("effect", ["current_change", "thruster_fault", "thruster_lag"])
def test_starts_looked_at_together_lead_where_each_leads_alone(
    effect: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Moments and choices, which no fit moves, are of each start its own; what has a memory is run
    by itself.
    """
    law = named(effect)
    superset = SupersetModel.of(WAM_V, [law])
    base = fit_base(superset, Model.of(WAM_V), [sailed()], DiagnoseSettings())
    look = Screening.of(superset, base, base.problem.thinned(200))
    starts = superset.starts(law, Model.of(WAM_V), base.problem.trials)[:5]
    begins = [look.at(law, start) for start in starts]
    assert len({r.unknowns.model.theta.tobytes() for r in begins}) > 1 or effect == "thruster_lag"
    together = look._stepped(begins, 2)
    monkeypatch.setattr(thresholds, "STARTS_TOGETHER", 1)
    alone = look._stepped(begins, 2)
    assert len(alone) == len(begins)
    for one, other in zip(together, alone, strict=True):
        assert one.added == other.added
        assert one.cost == pytest.approx(other.cost)
        assert one.z == pytest.approx(other.z)


def test_a_look_at_all_effects_tells_how_many_are_left() -> None:
    laws = [named("heading_offset"), named("steady_current")]
    superset = SupersetModel.of(WAM_V, laws)
    base = fit_base(superset, Model.of(WAM_V), [sailed()], DiagnoseSettings())
    lines: list[str] = []
    screening.screen(superset, Model.of(WAM_V), laws, base, lines.append)
    counted = [line for line in lines if isinstance(line, CountedStep)]
    assert [(line.done, line.total) for line in counted] == [(1, 2), (2, 2)]
    assert counted[0] == "1 of 2 effects looked at, last heading_offset"


@pytest.mark.slow
def test_a_table_that_begins_filled_is_fitted_from_there() -> None:
    """What is known of its knots beforehand, that they are nothing, is no place to begin at."""
    spot = named("learned_spot")
    superset = SupersetModel.of(WAM_V, [spot])
    base = fit_base(superset, Model.of(WAM_V), [sailed()], DiagnoseSettings())
    look = Screening.of(superset, base, base.problem)
    filled = {**spot.example, "acts": learned_spot.PUSH, "f0": 0.5, "f1": 0.3}  # type: ignore[dict-item]
    start = look.at(spot, filled)
    by_name = {u.name: (u.start, z) for u, z in zip(start.unknowns.each, start.z, strict=True)}
    assert by_name["learned_spot.f0"] == (0.0, 0.5)
    assert by_name["learned_spot.f1"] == (0.0, 0.3)
    assert by_name["learned_spot.north"][1] == filled["north"]
    assert look.own_cost == pytest.approx(look.cost_of(base))
