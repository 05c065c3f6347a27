"""The lookout aboard: surroundings go out once a second, and a current is told in words."""

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.shadow.model_monitor import FIRST_S, ModelMonitor
from gateway.shadow.path import ShadowRows
from gateway.shadow.residuals import ModelResiduals
from gateway.shadow.sensor_checks import clock_text
from gateway.simulated_boat import FAST, SimulatedBoatSettings, TimedFrame
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.hull import program_of
from gateway.topics import TOPICS
from sim.effects.catalogue import EFFECTS
from sim.model import Model
from sim.vessel import AddedEffect
from tests.gateway.json_schema import validator_of
from tests.gateway.pipelines.aboard import Deck, datagrams
from tests.sim.vessels import WAMV

CURRENT = next(effect for effect in EFFECTS if effect.name == "steady_current")
SPEED, TOWARDS = 0.4, 1.2
ADRIFT = WAMV.with_effects(AddedEffect(CURRENT, {"speed": SPEED, "direction": TOWARDS}))


def path_rows(seconds: float, seed: int = 1, **changed: Any) -> ShadowRows:
    """Rows at 10 Hz of a boat that turns slowly and lacks nothing but noise."""
    count, rng = round(10 * seconds), np.random.default_rng(seed)
    number, times = np.arange(count), 0.1 * np.arange(count)
    estimate = np.zeros((count, 9))
    estimate[:, 2], estimate[:, 3], estimate[:, 5] = 0.1 * times, 1.0, 0.1
    missing = 3.0 * rng.standard_normal((count, 3))
    errors = np.repeat(0.02 * rng.standard_normal((-(-count // 10), 9)), 10, axis=0)[:count]
    yes, force = np.ones(count, bool), np.ones((count, 3))
    values = {
        "row": number, "time_s": times, "vehicle_time_ns": (times * 1e9).astype(np.int64),
        "receive_time_ns": (times * 1e9).astype(np.int64), "estimate": estimate,
        "std": np.full((count, 9), 0.03), "fresh": yes, "jumped": ~yes, "reference": estimate,
        "from_model": ~yes, "shadow": estimate, "control": force, "limited": ~yes, "diverged": ~yes,
        "reset": ~yes,
        "residuals": ModelResiduals(missing, 10.0 * force, force, errors),
        "commands": np.full((count, 2), 0.3), "fit": changed.get("fresh", yes),
    }  # fmt: skip
    return ShadowRows(**{**values, **changed})


def cut(out: ShadowRows, part: slice) -> ShadowRows:
    residuals = ModelResiduals(**{name: value[part] for name, value in vars(out.residuals).items()})
    rest = {name: value[part] for name, value in vars(out).items() if name != "residuals"}
    return ShadowRows(**rest, residuals=residuals)


def told(out: ShadowRows, ends: list[int], vessel: Any = WAMV) -> list[Any]:
    lookout, found = ModelMonitor.of(Model.of(vessel)), list[Any]()
    for start, end in zip([0, *ends], [*ends, len(out)], strict=True):
        lookout, rows, said = lookout.observe(cut(out, slice(start, end)))
        found += [(r.topic, payload) for r in rows for payload in r.payloads] + list(said)
    return found


def by_topic(found: list[Any]) -> list[Any]:
    """Each topic in its own order: a chunk gives one topic after another."""
    return sorted(found, key=lambda one: one[0] if isinstance(one[0], str) else "event")


def test_how_rows_are_cut_into_chunks_makes_no_difference() -> None:
    out = path_rows(60.0)
    whole = by_topic(told(out, []))
    assert len(whole) > 40
    assert by_topic(told(out, [1, 2, 3, 10, 11, 307, 399])) == whole
    assert by_topic(told(out, list(range(1, len(out))))) == whole


def test_it_is_withheld_at_first_then_complete_and_once_a_second() -> None:
    found = [json.loads(p) for topic, p in told(path_rows(90.0), []) if topic == "surroundings"]
    times = np.array([m["vehicle_time_ns"] for m in found]) * 1e-9
    assert times[0] >= FIRST_S
    assert np.diff(times) == pytest.approx(1.0, abs=0.11)
    schema = validator_of(json.dumps(TOPICS["surroundings"].json_schema()))
    for message in found:
        schema.validate(message)
    assert {m["explains"] for m in found} == {"none"}


def test_a_vessel_without_wind_areas_tells_no_wind() -> None:
    assert any(topic == "wind" for topic, _ in told(path_rows(60.0), []))
    bare = replace(WAMV, hull=replace(WAMV.hull, wind_area=(0.0, 0.0)))
    assert {topic for topic, _ in told(path_rows(60.0), [], bare)} == {"surroundings"}


def test_seconds_with_a_jump_or_without_telemetry_are_left_out() -> None:
    calm = path_rows(60.0)
    silent = np.ones(600, bool)
    silent[400:450] = False
    jumped = np.zeros(600, bool)
    jumped[500] = True
    lost = len(told(calm, [])) - len(told(path_rows(60.0, fresh=silent, jumped=jumped), []))
    assert 2 * 5 <= lost <= 2 * 8  # both topics


def test_a_silence_is_no_second() -> None:
    times = 0.1 * np.arange(600)
    times[300:] += 20.0
    found = told(path_rows(60.0, time_s=times), [])
    assert len(found) >= 2 * 27
    assert len(found) < len(told(path_rows(60.0), []))


def test_a_clock_shows_the_time_of_day() -> None:
    assert clock_text(1_700_000_000 * 10**9) == "22:13:20 UTC"


def frames(*legs: tuple[Any, float]) -> list[TimedFrame]:
    """Vessels that take over from each other; each plays until its time."""
    boats = [
        SimulatedBoat(v, SimulatedBoatSettings(rates=FAST), 0, program_of(WAMV, "steps", 0))
        for v, _ in legs
    ]
    state, out = boats[0].start(), list[TimedFrame]()
    for boat, (_, until_s) in zip(boats, legs, strict=True):
        state, arrived = boat.advance(state, until_s)
        out += arrived
    return out


@pytest.mark.slow
def test_a_current_that_sets_in_is_told_and_published() -> None:
    with Deck() as deck:
        heard = deck.hear(datagrams(frames((WAMV, 40.0), (ADRIFT, 130.0)))).heard()
    events = [m for m in heard.messages("event") if m["kind"].startswith("model_")]
    began = events[0]["vehicle_time_ns"] * 1e-9 - 1.7e9
    assert events[0]["kind"] == "model_wrong"
    assert 40.0 < began < 60.0
    assert re.match(r"since \d\d:\d\d:\d\d UTC the model is wrong", events[0]["says"])
    assert any("of current towards" in m["says"] for m in events[1:])
    last = heard.messages("surroundings")[-1]
    found = np.array([last["current_north_mps"], last["current_east_mps"]])
    truth = SPEED * np.array([np.cos(TOWARDS), np.sin(TOWARDS)])
    assert np.hypot(*(found - truth)) < 0.1
    assert last["explains"] == "current"
