"""The cases of the blind test: seeded, disjoint, complete, and silent about their answers."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden import strengths
from benchmarks.hidden.answers import answer, catalogued
from benchmarks.hidden.boats import FLEET
from benchmarks.hidden.cases import (
    LOG,
    MISSIONS,
    OF_A_DAY,
    SEEDS,
    VESSEL,
    cases,
    materialise,
    materialise_twin,
)
from benchmarks.hidden.causes import KNOWN, SEAS, UNKNOWN, UNLISTED, Hidden, causes_of
from benchmarks.hidden.strengths import (
    ARMS,
    CHANGES,
    LATER,
    OF_A_VOYAGE,
    RECIPES,
    SCALES,
    STRANGE,
    boats_for,
    strong,
)
from benchmarks.hidden.unasked import UNASKED
from benchmarks.hidden.unheard import UNHEARD
from benchmarks.hidden.unnamed import UNNAMED
from benchmarks.hidden.untold import UNTOLD
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import Scope
from sim.vessel import AddedEffect


@pytest.fixture(scope="module")
def reporting():
    return cases("reporting")


def test_there_are_recipes_for_all_that_can_be_hidden():
    drawn = (RECIPES, CHANGES, LATER, SCALES, ARMS, strengths.PLAYS, strengths.TRAINS)
    assert {name for recipes in drawn for name in recipes} == set(KNOWN)
    assert set(STRANGE) == set(UNKNOWN)
    strangers = (strengths.UNLISTED, UNHEARD, UNNAMED, UNTOLD, UNASKED)
    assert {name for kinds in strangers for name in kinds} == set(UNLISTED)
    assert set(strengths.SEAS) == set(SEAS)


def test_what_holds_for_one_day_is_what_the_catalogue_says():
    assert {e.name for e in EFFECTS if e.scope is Scope.VOYAGE} == OF_A_VOYAGE


@pytest.mark.parametrize("name", SEEDS)
def test_a_set_is_always_the_same(name):
    assert cases(name) == cases(name)


def test_no_two_voyages_of_any_sets_share_a_seed():
    seeds = [v.seed for name in SEEDS for c in cases(name) for v in (c.voyage, c.twin)]
    assert len(seeds) == len(set(seeds)) > 900


def test_the_reporting_set_holds_what_was_asked_for(reporting):
    by_family = {}
    for case in reporting:
        by_family.setdefault(case.family, []).append(case)
    assert len(reporting) >= 200
    for family in ("excitation", "mission", "base_off"):
        assert {c.voyage.hidden[0].name for c in by_family[family]} == set(RECIPES)
    complete = by_family["none"]
    assert len(complete) >= 60
    assert not any(c.voyage.hidden for c in complete)
    assert 2 * sum(c.voyage.pilot in MISSIONS for c in complete) == len(complete)
    assert {h.name for c in by_family["unknown"] for h in c.voyage.hidden} == set(UNKNOWN)
    families = ("unlisted", "unheard", "unnamed", "untold", "unasked")
    strangers = [c for f in families for c in by_family[f]]
    assert {h.name for c in strangers for h in c.voyage.hidden} == set(UNLISTED)
    assert all(len(c.voyage.hidden) == 2 for c in by_family["pair"])
    assert all(c.misjudged for c in by_family["base_off"])


def test_every_cause_can_be_made_and_stands_in_the_catalogue(reporting):
    for case in reporting:
        causes_of(case.voyage.hidden)
        causes_of(case.twin.hidden)
        for item in answer(case)["values"]:
            if item["type"] in KNOWN:
                effect = named(item.pop("type"))
                added = AddedEffect(effect, item)
                for p in effect.parameters:
                    assert p.lower <= added.values[p.name] <= p.upper


def test_the_twin_has_the_same_boat_and_another_day(reporting):
    for case in reporting:
        assert case.twin.pilot != case.voyage.pilot
        for here, there in zip(case.voyage.hidden, case.twin.hidden, strict=True):
            assert here.name == there.name
            assert (here == there) == (here.name not in OF_A_DAY)


@pytest.mark.parametrize("name", sorted(set(RECIPES) - {"actuator_wiring"}))
def test_less_of_it_is_nearer_to_nothing(name):
    """Each recipe at a tenth of the strength, with the same dice, differs from full strength."""
    boat = FLEET[boats_for((name,))[0]]
    full, tenth = (strong(name, boat, np.random.default_rng(5), k, 600.0) for k in (1.0, 0.1))
    neutral = {p.name: p.neutral for p in named(name).parameters if p.neutral is not None}
    changed = [key for key in full if full[key] != tenth[key]]
    assert changed
    for key in changed:
        if key in neutral:
            assert abs(tenth[key] - neutral[key]) < 0.5 * abs(full[key] - neutral[key])


def test_names_are_translated():
    boat = FLEET["iacquabot"]
    fault = catalogued(Hidden("thruster_fault", {"channel": 3.0, "gain": 0.5, "time": 9.0}), boat)
    assert fault == {"type": "thruster_fault", "thruster": 3.0, "gain": 0.5, "time": 9.0}
    assert catalogued(Hidden("actuator_wiring", {}), boat)["order"] == 4321.0
    assert catalogued(Hidden("actuator_wiring", {}), FLEET["teal"])["order"] == 21.0


def test_what_a_diagnosis_gets_does_not_tell_what_is_hidden(tmp_path):
    case = next(c for c in cases("small") if c.family == "excitation")
    short = {name: replace(getattr(case, name), seconds=5.0) for name in ("voyage", "twin")}
    case = replace(case, **short)
    materialise(case, tmp_path / "questions")
    assert {f.name for f in (tmp_path / "questions").iterdir()} == {LOG, VESSEL}
    materialise_twin(case, tmp_path / "answers")
    told = b"".join(file.read_bytes() for file in (tmp_path / "questions").iterdir())
    for name in (*KNOWN, *UNKNOWN, *UNLISTED, case.family.upper()):
        assert name.encode() not in told
    assert case.family not in case.name
    json.dumps(answer(case), allow_nan=False)
