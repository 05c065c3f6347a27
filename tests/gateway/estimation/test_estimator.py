"""What the filter does with chunks, late events, outliers, discontinuities and silence."""

import dataclasses
import itertools
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from gateway.estimation import FilterSettings, Flag, MeasurementKind, State
from gateway.estimation.events import Events, join, make_events, ticks
from gateway.estimation.filter import Estimator
from tests.gateway.estimation.boat import telemetry, weaving_boat

ESTIMATOR = Estimator()


def voyage(seed=0, seconds=20.0):
    rng = np.random.default_rng(seed)
    truth = weaving_boat(rng, seconds)
    return truth, telemetry(rng, truth, ESTIMATOR.settings)


def run(events, covariance=False):
    return ESTIMATOR.advance(ESTIMATOR.start(), events, covariance)[1]


def shifted(events, kind, after, by):
    """The same events, readings of one kind after a time moved by a vector."""
    z = events.z.copy()
    z[(events.kind == kind) & (events.time_s >= after)] += by
    return dataclasses.replace(events, z=z)


def test_cutting_into_chunks_changes_no_bit():
    _, events = voyage(seconds=6.0)
    whole = run(events, covariance=True)
    state, done, parts = ESTIMATOR.start(), 0, []
    for size in np.random.default_rng(1).integers(1, 40, 10_000):
        if done >= len(events):
            break
        state, rows = ESTIMATOR.advance(state, events[done : done + size], covariance=True)
        parts.append(rows)
        done += size
    for name in ("time_s", "motion", "std", "covariance", "nis", "used", "flags"):
        together = np.concatenate([getattr(rows, name) for rows in parts])
        np.testing.assert_array_equal(together, getattr(whole, name))


def test_a_state_is_a_value():
    _, events = voyage()
    state, _ = ESTIMATOR.advance(ESTIMATOR.start(), events[:200])
    _, first = ESTIMATOR.advance(state, events[200:400])
    _, again = ESTIMATOR.advance(state, events[200:400])
    np.testing.assert_array_equal(first.motion, again.motion)


def test_late_events_end_where_ordered_ones_do():
    _, events = voyage(seconds=6.0)
    times = events.time_s
    delay = np.random.default_rng(2).exponential(0.05, len(events)).clip(0, 0.5)
    delay[:10] = delay[-10:] = 0.0
    delay[-1] = 10.0
    late = run(events[np.argsort(times + delay, kind="stable")], covariance=True)
    ordered = run(events, covariance=True)
    assert late.has(Flag.LATE).sum() > 150
    assert not late.has(Flag.REFUSED).any()
    assert late.time_s[-1] == ordered.time_s[-1]
    np.testing.assert_allclose(late.motion[-1], ordered.motion[-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(late.covariance[-1], ordered.covariance[-1], rtol=0, atol=1e-9)


def test_too_late_is_refused_and_changes_nothing():
    _, events = voyage()
    state, before = ESTIMATOR.advance(ESTIMATOR.start(), events[:1000])
    old = make_events(
        MeasurementKind.YAW, np.array([before.time_s[-1] - 1.01]), np.array([2.0]), 0.01
    )
    state, rows = ESTIMATOR.advance(state, old)
    assert rows.flags[0] == Flag.REFUSED | Flag.VALID
    np.testing.assert_array_equal(rows.motion[0], before.motion[-1])
    np.testing.assert_array_equal(rows.std[0], before.std[-1])


def test_late_beyond_the_history_is_refused():
    estimator = Estimator(FilterSettings(history_events=8))
    _, events = voyage()
    state, rows = estimator.advance(estimator.start(), events[:1000])
    assert not rows.has(Flag.REFUSED).any()
    late = make_events(MeasurementKind.YAW, rows.time_s[-1:] - 0.5, np.array([2.0]), 0.01)
    assert estimator.advance(state, late)[1].has(Flag.REFUSED).all()


def test_not_valid_before_yaw_and_velocity_or_position():
    _, events = voyage()
    without_yaw = events[events.kind != MeasurementKind.YAW]
    rows = run(without_yaw[:200])
    assert rows.has(Flag.WAITING).all()
    assert not rows.has(Flag.VALID).any()
    assert not run(events[events.kind <= MeasurementKind.YAW_RATE][:200]).has(Flag.VALID).any()
    assert run(events[:200]).has(Flag.VALID)[10:].all()


@cache
def clean():
    """A shorter voyage, and what the filter makes of it."""
    _, events = voyage(seconds=6.0)
    return events, run(events)


@pytest.mark.parametrize("kind", list(MeasurementKind)[1:])
def test_no_number_is_gated(kind):
    """As the first words of all, and on the way; as many in a row as would be a discontinuity."""
    events, rows_without = clean()
    values = np.tile([np.nan, np.inf, -np.inf, 1e30], 3)
    heads, parts, bad = (0, 300, len(events)), [], []
    for head, end in itertools.pairwise(heads):
        time = np.full(len(values), events.time_s[head])
        wild = make_events(kind, time, np.stack([values, values], axis=1), 0.1)
        bad.extend(range(sum(map(len, parts)), sum(map(len, parts)) + len(values)))
        parts += [wild, events[head:end]]
    rows = run(join(parts))
    assert set(rows.flags[bad] & ~Flag.VALID) == {Flag.GATED}
    assert not rows.has(Flag.JUMP).any()
    np.testing.assert_array_equal(rows.motion[-1], rows_without.motion[-1])


@pytest.mark.parametrize("std", [np.nan, 0.0, -1.0])
def test_a_reading_without_uncertainty_is_gated(std):
    _, events = voyage()
    bad = make_events(MeasurementKind.YAW, np.array([0.0]), np.array([0.3]), std)
    assert run(join([bad, events[:9]])).flags[0] == Flag.GATED


@pytest.mark.parametrize("time", [np.nan, np.inf])
def test_no_time_is_refused(time):
    events, rows_without = clean()
    bad = make_events(MeasurementKind.YAW, np.array([time]), np.array([0.3]), 0.1)
    rows = run(join([events[:500], bad, events[500:]]))
    assert rows.has(Flag.REFUSED).sum() == 1
    np.testing.assert_array_equal(rows.motion[-1], rows_without.motion[-1])


@pytest.mark.parametrize(
    ("kind", "by", "where"),
    [
        (MeasurementKind.YAW, [0.5, 0.0], State.YAW),
        (MeasurementKind.POSITION, [40.0, -30.0], State.NORTH),
    ],
)
def test_a_discontinuity_is_not_motion(kind, by, where):
    truth, events = voyage()
    rows = run(shifted(events, kind, 10.0, by))
    jumps = np.flatnonzero(rows.has(Flag.JUMP))
    assert len(jumps) == 1
    assert 11.0 <= events.time_s[jumps[0]] < 11.2
    late = slice(jumps[0], jumps[0] + 20)
    error = rows.motion[late] - truth.at(rows.time_s[late])
    assert error[-1, where] == pytest.approx(by[0], abs=6 * rows.std[late][-1, where])
    # Neither speed nor turn rate takes part in the jump.
    assert np.abs(error[:, State.R]).max() < 0.1
    if kind == MeasurementKind.POSITION:
        assert np.abs(error[:, State.U]).max() < 0.3


def test_a_spike_is_gated_and_leaves_no_trace():
    _, events = voyage()
    yaw = np.flatnonzero(events.kind == MeasurementKind.YAW)[500:509]
    z = events.z.copy()
    z[yaw] += 0.7
    rows = run(dataclasses.replace(events, z=z))
    assert rows.has(Flag.GATED)[yaw].all()
    assert not rows.has(Flag.JUMP).any()
    assert np.abs(rows.motion[-1] - run(events).motion[-1]).max() < 1e-3


def test_the_gate_stands_where_its_share_of_good_readings_says():
    """Headings spoilt a little more from one to the next: refused from the bound on, no earlier."""
    _, events = voyage()
    yaw = np.flatnonzero(events.kind == MeasurementKind.YAW)[300:700:10]
    z = events.z.copy()
    z[yaw, 0] += np.linspace(0.0, 0.01, len(yaw))
    rows = run(dataclasses.replace(events, z=z))
    bound = chi2.ppf(ESTIMATOR.settings.gate_probability, 1)
    nis, gated = rows.nis[yaw], rows.has(Flag.GATED)[yaw]
    assert bound / 1.5 < nis[nis <= bound].max()  # both sides of it are met, closely
    assert nis[nis > bound].min() < 1.5 * bound
    np.testing.assert_array_equal(gated, nis > bound)


def test_in_an_outage_uncertainty_grows_and_stays_true():
    truth, events = voyage(3, 40.0)
    gap = (events.time_s > 15.0) & (events.time_s < 21.0)
    moments = ticks(np.arange(15.1, 21.0, 0.1))
    events = join([events[~gap], moments])
    events = events[np.argsort(events.time_s, kind="stable")]
    rows = run(events)
    silent = rows.std[events.kind == MeasurementKind.TICK]
    assert (np.diff(silent[:, : State.U_DOT], axis=0) > 0).all()
    error = np.abs(rows.motion - truth.at(rows.time_s))
    assert (error[events.kind == MeasurementKind.TICK] < 3 * silent).all()
    after = rows.time_s > 23.0
    assert np.abs(error[after, State.U]).max() < 0.3
    assert not rows.has(Flag.RESTART).any()


@pytest.mark.parametrize("step", [61.0, -61.0])
def test_after_a_long_gap_or_a_step_of_the_clock_the_filter_starts_afresh(step):
    events, rows_without = clean()
    moved = dataclasses.replace(events, time_s=events.time_s + events.time_s[-1] + step)
    rows = run(join([events, moved]))
    assert np.flatnonzero(rows.has(Flag.RESTART)).tolist() == [len(events)]
    np.testing.assert_allclose(rows.motion[-1], rows_without.motion[-1], rtol=0, atol=1e-9)


def test_a_clock_that_stays_back_is_believed_in_the_end():
    _, events = voyage()
    back = dataclasses.replace(events, time_s=events.time_s - 30.0 + events.time_s[-1])
    rows = run(join([events, back]))
    restarts = np.flatnonzero(rows.has(Flag.RESTART))
    assert len(restarts) == 1
    assert restarts[0] - len(events) == ESTIMATOR.settings.refused_in_a_row - 1
    assert rows.has(Flag.VALID)[-1]


def test_yaw_runs_on_through_half_a_turn():
    time = np.arange(0.0, 16.0, 0.02)
    yaw = 0.5 * time
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    events = join(
        [
            make_events(MeasurementKind.YAW, time, wrapped, 0.01),
            make_events(MeasurementKind.VELOCITY, time, np.zeros((len(time), 2)), 0.01),
        ]
    )
    rows = run(events[np.argsort(events.time_s, kind="stable")])
    assert rows.motion[-1, State.YAW] == pytest.approx(yaw[-1], abs=0.01)
    assert not rows.has(Flag.GATED).any()


def test_arrays_that_do_not_belong_together_are_refused():
    with pytest.raises(ValueError, match="belong together"):
        Events(np.zeros(3), np.zeros(2, np.int64), np.zeros((3, 2)), np.zeros((3, 2)))


def test_no_events_no_rows():
    _, rows = ESTIMATOR.advance(ESTIMATOR.start(), ticks(np.zeros(0)))
    assert len(rows) == 0


def test_a_turn_sharper_than_assumed_is_motion():
    time = np.arange(0.0, 20.0, 0.02)
    rate = np.where(time < 10.0, 0.0, 2.0)
    yaw = np.concatenate([[0.0], np.cumsum(rate[:-1] * 0.02)])
    events = join(
        [
            make_events(MeasurementKind.YAW, time, (yaw + np.pi) % (2 * np.pi) - np.pi, 0.001),
            make_events(MeasurementKind.YAW_RATE, time, rate, 0.006),
            make_events(MeasurementKind.VELOCITY, time, np.zeros((len(time), 2)), 0.02),
        ]
    )
    rows = run(events[np.lexsort((events.kind, events.time_s))])
    after = rows.time_s > 10.5
    assert np.abs(rows.motion[after, State.R] - 2.0).max() < 0.1
    assert np.abs(rows.motion[-1, State.YAW] - yaw[-1]) < 0.01
