"""Noise that is larger than assumed is estimated, and nothing else is taken for it.

An exact boat whose velocities scattered by 0.15 m/s had a current after 20 s.
"""

from dataclasses import replace

import numpy as np
import pytest

from gateway.estimation import SOURCES, FilterSettings, Flag, GateRecord, MeasurementKind
from gateway.estimation.events import Events, join, make_events
from gateway.estimation.filter import Estimator
from gateway.estimation.scatter import noise_factor, white_std
from gateway.ingest.sources import Choice
from gateway.offline.noisy import noisy_notices
from gateway.samples import Quantity, Samples
from tests.gateway.estimation.boat import singer_boat, telemetry

NED, VELOCITY = "LOCAL_POSITION_NED", MeasurementKind.VELOCITY
ASSUMED = FilterSettings()
ESTIMATOR = Estimator(ASSUMED)


def noisy(factor: float) -> FilterSettings:
    """Settings of a boat whose velocities scatter that many times as much as is assumed."""
    source = replace(SOURCES[NED], velocity_mps=factor * SOURCES[NED].velocity_mps)
    return replace(ASSUMED, sources={**SOURCES, NED: source})


def as_assumed(events: Events) -> Events:
    """The same measurements with the noise that the filter assumes of their source."""
    std = events.std.copy()
    std[events.kind == VELOCITY] = SOURCES[NED].velocity_mps
    return replace(events, std=std)


def factors(events: Events) -> dict[MeasurementKind, float]:
    """Kind -> R over the assumed one after all events."""
    state, _ = ESTIMATOR.advance(ESTIMATOR.start(), events)
    gates = state.history.gates[(state.history.counts[0] - 1) % len(state.history.time)]
    return {kind: noise_factor(gates[kind]) for kind in MeasurementKind}


@pytest.mark.parametrize("times", [5.0, 10.0, 20.0])
def test_noisy_velocities_are_weighed_by_the_noise_they_have(times):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        truth = singer_boat(rng, 40.0, ASSUMED)
        found = factors(as_assumed(telemetry(rng, truth, noisy(times))))
        assert found.pop(VELOCITY) == pytest.approx(times**2, rel=0.6)
        assert set(found.values()) == {1.0}


def test_the_stated_error_of_a_noisy_boat_is_true():
    squares, loud = [], noisy(10.0)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth = singer_boat(rng, 30.0, ASSUMED)
        _, rows = ESTIMATOR.advance(ESTIMATOR.start(), as_assumed(telemetry(rng, truth, loud)))
        late = rows.time_s > 12.0
        error = (rows.motion[late] - truth.at(rows.time_s[late]))[:, 3:5]
        squares.append(np.mean((error / rows.std[late, 3:5]) ** 2))
        assert np.mean(rows.has(Flag.GATED)[late]) < 0.01  # an eighth was refused
    assert 0.5 < np.mean(squares) < 1.5


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 5.0, 25.0])
def test_a_boat_with_the_assumed_noise_keeps_it(rate_hz):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        truth = singer_boat(rng, 60.0, ASSUMED)
        assert set(factors(telemetry(rng, truth, ASSUMED, 10.0, rate_hz)).values()) == {1.0}


@pytest.mark.parametrize("omega", [0.5, 2.0, 4.0])
def test_waves_are_motion_and_no_noise(omega):
    """Surge of 0.5 m/s, as a boat in waves has it, reported ten times a second."""
    time = np.arange(0.0, 60.0, 0.1)
    velocity = np.column_stack([1.0 + 0.5 * np.sin(omega * time), 0.3 * np.cos(omega * time)])
    found = factors(boat_of(time, velocity))
    assert found[VELOCITY] == 1.0


def boat_of(time: np.ndarray, velocity: np.ndarray) -> Events:
    """A boat that heads north."""
    parts = [
        make_events(MeasurementKind.YAW, time, np.zeros(len(time)), 0.01),
        make_events(VELOCITY, time, velocity, 0.015),
    ]
    events = join(parts)
    return events[np.lexsort((events.kind, events.time_s))]


def test_a_jump_and_a_single_outlier_are_no_noise():
    time = np.arange(0.0, 30.0, 0.1)
    velocity = np.zeros((len(time), 2))
    velocity[time >= 20.0] = (2.0, -1.0)  # a source that jumps
    velocity[100] = (9.0, 9.0)
    rows = ESTIMATOR.advance(ESTIMATOR.start(), boat_of(time, velocity))[1]
    assert factors(boat_of(time, velocity))[VELOCITY] == 1.0
    assert np.count_nonzero(rows.has(Flag.JUMP)) == 1


def test_noise_that_is_over_is_forgotten():
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 60.0, 0.1)
    velocity = np.where(time < 20.0, 0.2, 0.015)[:, np.newaxis] * rng.standard_normal((600, 2))
    assert factors(boat_of(time[:200], velocity[:200]))[VELOCITY] > 50.0
    assert factors(boat_of(time, velocity))[VELOCITY] == 1.0


def test_records_hold_what_their_names_say():
    gate = np.zeros(max(GateRecord) + 2)
    assert noise_factor(gate) == 1.0
    gate[GateRecord.COUNT], gate[GateRecord.SCATTER] = 60.0, 9.0
    assert noise_factor(gate) == 9.0
    gate[GateRecord.COUNT] = 3.0
    assert noise_factor(gate) == 1.0  # too few


def test_what_is_told_of_scatter_is_what_there_is():
    rng, time = np.random.default_rng(2), np.arange(0.0, 120.0, 0.2)
    motion = np.column_stack([np.sin(0.8 * time), np.cos(0.3 * time)])
    noise = 0.12 * rng.standard_normal(motion.shape)
    noise[77] = 30.0  # an outlier
    assert white_std(time, motion + noise) == pytest.approx(0.12, rel=0.15)
    assert white_std(time, motion) < 0.01
    assert np.isnan(white_std(5.0 * time, motion + noise))  # a report a second


@pytest.mark.parametrize(("std", "told"), [(0.02, False), (0.15, True)])
def test_noisy_velocities_are_told(std, told):
    rng, count = np.random.default_rng(3), 600
    time_ns = np.arange(count) * 100_000_000
    values = std * rng.standard_normal((count, 2))
    samples = Samples(Quantity.VELOCITY, NED, np.arange(count), time_ns, time_ns, values)
    notices = noisy_notices({"velocity": Choice("velocity", samples, 10.0, 0.1, "")}, ASSUMED, 0)
    expected = "scatters by 0.15 m/s from one report to the next, 10 times what is usual"
    assert [expected in one for one in notices] == [True] * told
