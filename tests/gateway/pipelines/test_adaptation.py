"""Numbers followed while sailing: told in words, taken over by the shadow only where asked."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from gateway.cli import _with_defaults
from gateway.estimation import FilterSettings
from gateway.offline.replay import _chunk_ends
from gateway.shadow.model_monitor import (
    APPLY_EVERY_NS,
    APPLY_STEP,
    Adaptation,
    ModelMonitor,
    taken_over,
)
from gateway.shadow.path import ShadowPath
from sim.following.follower import FollowerOptions, ReferenceMode
from sim.model import Model
from sim.monitoring.causes import BOAT_ERRORS
from sim.plants import OWN_VESSEL, PlantChoice
from sim.vessel import Vessel
from tests.gateway.pipelines.test_lookout import path_rows
from tests.sim.monitoring import live_seconds
from tests.sim.vessels import IACQUABOT, WAMV

seconds = partial(
    live_seconds.seconds, vessel=WAMV, leg_s=6, steer=0.25, thrust=np.array([-0.2, 0.0])
)


@pytest.fixture(scope="module")
def weak() -> Adaptation:
    """After six minutes with a port thruster that gives a fifth less."""
    now, out = Adaptation.of(Model.of(WAMV)), path_rows(1.0)
    for second in seconds(360):
        now, _, _ = now.observe(out, 0, second)
    return now


def path(plant: PlantChoice = OWN_VESSEL) -> ShadowPath:
    return ShadowPath.of(
        WAMV, plant, FilterSettings(), reference=ReferenceMode.AUTO, follower=FollowerOptions(),
        rate_hz=50.0,
    )  # fmt: skip


def test_a_number_that_leaves_is_told_once_with_its_size() -> None:
    now, out, told = Adaptation.of(Model.of(WAMV)), path_rows(1.0), []
    for second in seconds(360):
        now, _, events = now.observe(out, 0, second)
        told += events
    (event,) = told
    assert (event.kind, event.severity) == ("parameter_changed", "warning")
    assert event.text.startswith("the thrust of left is ")
    assert " % less than in the vessel file (95 %: " in event.text
    share, low, high = (float(s) for s in event.text.replace("%:", "%: ").split() if s.isdigit())
    assert low < share < high
    assert low <= 20.0 <= high


def told(vessel: Vessel, count: int, **causes: Any) -> list[str]:
    now, out, texts = Adaptation.of(Model.of(vessel)), path_rows(1.0), list[str]()
    for second in live_seconds.seconds(count, vessel=vessel, leg_s=6, steer=0.25, **causes):
        now, _, events = now.observe(out, 0, second)
        texts += [e.text for e in events if e.kind == "parameter_inseparable"]
    return texts


def test_thrusters_one_behind_the_other_are_said_to_be_told_together() -> None:
    assert sorted(told(IACQUABOT, 300)) == [
        f"the thrust of front_{side} is told only together with the thrust of rear_{side}: this "
        "motion does not tell them apart"
        for side in ("left", "right")
    ]


def test_what_is_told_apart_is_not_said_to_be_told_together() -> None:
    assert told(WAMV, 300) == []
    assert told(WAMV, 300, thrust=np.array([-0.2, 0.0]), drag=0.3) == []


def test_the_shadow_takes_numbers_over_a_little_at_a_time(weak: Adaptation) -> None:
    share = weak.estimates.shares[0]
    given, now = path(), weak
    now, first = now.taken_over(given, APPLY_EVERY_NS)
    assert now.applied[0] == pytest.approx(-APPLY_STEP)
    same, again = now.taken_over(first, APPLY_EVERY_NS + 1)
    assert again is first
    assert same is now
    for k in range(2, 8):
        now, first = now.taken_over(first, k * APPLY_EVERY_NS)
    assert now.applied[0] == pytest.approx(share, abs=0.01)
    astern, ahead = WAMV.thrusters[0].thrust
    moved = first.reference.model.vessel.thrusters[0].thrust
    assert moved == pytest.approx(((1.0 + now.applied[0]) * astern, (1.0 + now.applied[0]) * ahead))
    assert first.follower.model.vessel == first.reference.model.vessel
    assert first.model.vessel == first.residuals.model.vessel == WAMV
    assert given.reference.model.vessel == WAMV


def test_another_plant_keeps_its_own_numbers(weak: Adaptation) -> None:
    _, after = weak.taken_over(path(PlantChoice(vessel=IACQUABOT)), APPLY_EVERY_NS)
    assert after.follower.model.vessel == IACQUABOT
    assert after.reference.model.vessel != WAMV


def test_what_is_not_valid_is_not_taken_over(weak: Adaptation) -> None:
    mean = weak.estimates.filter.mean.copy()
    mean[BOAT_ERRORS + 5 :] = -0.65
    wild = replace(weak.estimates, filter=replace(weak.estimates.filter, mean=mean))
    unsure = replace(wild, excited_s=np.zeros(4))
    given = path()
    now, after = replace(weak, estimates=unsure).taken_over(given, APPLY_EVERY_NS)
    assert after is given
    assert not now.applied.any()


def test_a_monitor_that_follows_nothing_leaves_the_path() -> None:
    given, monitor = path(), ModelMonitor.of(Model.of(WAMV))
    assert monitor.adaptation is None
    assert taken_over(monitor, given, APPLY_EVERY_NS) == (monitor, given)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["live", "--adapt", "udpin:1:2"], ["live", "--adapt", "watch", "udpin:1:2"]),
        (["replay", "a.tlog", "--adapt"], ["replay", "a.tlog", "--adapt", "watch"]),
        (["live", "--adapt", "apply", "-v", "otter"], ["live", "--adapt", "apply", "-v", "otter"]),
    ],
)  # fmt: skip
def test_adapt_alone_watches(typed: list[str], meant: list[str]) -> None:
    assert _with_defaults(typed) == meant


class Received(NamedTuple):
    """Stands in for filter inputs, of which only the receipts matter."""

    receive_time_ns: np.ndarray

    def __len__(self) -> int:  # type: ignore[override]
        return len(self.receive_time_ns)


def test_the_moments_of_taking_over_do_not_depend_on_the_speed_of_a_replay() -> None:
    feed = Received(np.arange(0, 47_000_000_000, 130_000_000) + 3_000_000_000)
    period = feed.receive_time_ns // APPLY_EVERY_NS
    first_of_each = set((np.flatnonzero(np.diff(period)) + 1).tolist())
    for chunk_s in (0.02, 5.0, 100.0):
        ends = list(_chunk_ends(feed, [], chunk_s, None, APPLY_EVERY_NS))  # type: ignore[arg-type]
        assert first_of_each <= set(ends)
        assert ends[-1] == len(feed)
    assert list(_chunk_ends(feed, [], 100.0, None, None)) == [len(feed)]  # type: ignore[arg-type]
