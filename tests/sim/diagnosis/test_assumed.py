"""What was assumed for a finding is told with it, widens its interval, and is told of no other."""

from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis.answer import DOUBT, assumed_numbers, with_assumed_intervals
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.diagnosis.fit_problem import SupersetModel
from sim.effects.catalogue import named
from sim.identification.intervals import Estimate
from sim.trial import Trial
from sim.vessel import AddedEffect, Vessel
from sim.wind import C_N
from tests.sim.diagnosis.sailed import DT, STD, sailed
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V, commands, trial_of

WIND = named("steady_wind")
BLOWING = {"speed": 8.0, "direction": 1.0}
AREAS = (0.8, 1.6)  # of the WAM-V, where its file has them
KNOWN = replace(WAM_V, hull=replace(WAM_V.hull, wind_area=AREAS))


def blown(vessel: Vessel) -> Vessel:
    return vessel.with_effects(AddedEffect(WIND, BLOWING))


def estimates(*, trial: str | None) -> tuple[Estimate, ...]:
    return (
        Estimate("steady_wind.speed", "m/s", 8.0, 8.0, (7.0, 9.0), True, trial),
        Estimate("steady_wind.direction", "rad", 1.0, 1.0, (0.9, 1.1), True, trial),
    )


def measured_in(seconds: float, known: bool = True) -> Trial:
    """A voyage of the WAM-V with its areas in a wind that turns, measured or not."""
    drive = commands(seconds, DT)
    turning = np.linspace(0.0, 2.0, len(drive))
    wind = -9.0 * np.stack([np.cos(turning), np.sin(turning)], axis=1)
    _, reports = on_floats(blown(KNOWN)).simulate(drive, DT, wind=wind)
    motion = reports[0, :-1] + np.random.default_rng(3).normal(0.0, STD, (len(drive), 9))
    parts = motion[:, :3], motion[:, 3:6], motion[:, 6:]
    trial = trial_of(*parts, drive, DT, np.diag(STD**2))
    return replace(trial, wind=wind) if known else trial


def test_each_recording_has_its_own_range_and_the_direction_keeps_its_interval() -> None:
    found = {"steady_wind": (*estimates(trial="a"), *estimates(trial="b"))}
    assumed = assumed_numbers(blown(WAM_V), found)
    assert [one.trial for one in assumed] == ["a", "b"]
    speed, direction, *_ = with_assumed_intervals(found, assumed)["steady_wind"]
    assert speed.ci95 == pytest.approx((7.0 / np.sqrt(2.8), 9.0 * np.sqrt(2.8)))
    assert speed.doubt == DOUBT
    assert direction == found["steady_wind"][1]
    assert assumed[1].description.startswith("steady_wind on b: from 57° with about 93 N ")
    told = assumed[0].to_dict()
    assert told["recording"] == "a"
    assert (told["area_front_m2"], told["area_side_m2"]) == WAM_V.hull.areas


def test_what_is_of_the_boat_does_not_tell_a_days_wind_a_second_time() -> None:
    """How the wind turns her is one number of all recordings: everything was said twice."""
    turns = Estimate("steady_wind.c_n", "1", 0.1, 0.08, (0.06, 0.1), True, None)
    found = {"steady_wind": (turns, *estimates(trial="a"))}
    assumed = assumed_numbers(blown(WAM_V), found)
    assert [one.trial for one in assumed] == ["a"]
    (own,) = assumed_numbers(blown(WAM_V), {"steady_wind": estimates(trial="a")})
    assert assumed[0].assumption.ci95 == own.assumption.ci95
    widened = with_assumed_intervals(found, assumed)["steady_wind"]
    assert widened[0] == turns
    assert widened[1].doubt == DOUBT
    alone = assumed_numbers(blown(WAM_V), {"steady_wind": (turns, *estimates(trial=None))})
    assert [one.trial for one in alone] == [None]


def test_a_vessel_with_areas_and_another_effect_are_told_as_they_are() -> None:
    found = {"steady_wind": estimates(trial=None)}
    assert not assumed_numbers(blown(KNOWN), found)
    assert not assumed_numbers(WAM_V, {})
    assert with_assumed_intervals(found, ()) == found


def test_what_was_measured_is_not_fitted_but_what_it_acts_on() -> None:
    """In all recordings, nearly all the time; else the wind is what nobody knows."""
    whole, none = measured_in(80.0), measured_in(80.0, known=False)
    half = replace(whole, wind=np.where(whole.time[:, None] < 40.0, whole.wind, np.nan))
    own = [f"steady_wind.{key}" for key in ("speed", "direction", "c_x", "c_n", "centre")]
    for trials, expected in (
        ([whole], ["area_front", "area_side", "steady_wind.c_n", "steady_wind.centre"]),
        ([none], own), ([half], own), ([whole, none], own), ([], own),
    ):  # fmt: skip
        assert SupersetModel.of(WAM_V, [WIND], trials).free_names(WIND) == expected
    current = named("steady_current")
    assert SupersetModel.of(WAM_V, [current], [whole]).free_names(current) == [
        "steady_current.speed", "steady_current.direction",
    ]  # fmt: skip


ONLY_WIND = DiagnoseSettings(effects=(WIND, named("steady_current")))


@pytest.mark.slow
def test_areas_are_fitted_to_a_measured_wind() -> None:
    found = diagnose([measured_in(200.0)], WAM_V, ONLY_WIND)
    assert found.effects == ("steady_wind",)
    assert found.vessel.hull.wind_area == pytest.approx(AREAS, rel=0.15)
    assert found.vessel.hull.wind_area != WAM_V.hull.areas
    assert "assumed" not in found.summary
    assert found.to_dict()["assumed"] == []
    numbers = {e.name: e for e in found.ladder[-1].base_parameters}
    low, high = numbers["area_side"].ci95
    assert low < AREAS[1] < high
    wind = {e.name.partition(".")[2]: e for e in found.ladder[-1].parameters["steady_wind"]}
    assert wind["speed"].value == 0.0
    assert "measured" in wind["speed"].doubt
    assert not wind["c_x"].doubt  # it acts on the frontal area, which is fitted
    assert wind["c_n"].value == pytest.approx(C_N, abs=0.03)


@pytest.mark.slow
def test_a_calm_voyage_names_no_wind_and_assumes_nothing() -> None:
    found = diagnose([sailed()], WAM_V, ONLY_WIND)
    assert "steady_wind" not in {r.effect for r in found.refused}
    assert not found.effects
    assert "assumed" not in found.summary
    assert found.to_dict()["assumed"] == []
