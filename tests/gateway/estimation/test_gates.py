"""The rules of gates, of order and of what is admitted, one by one, on a few events each."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.estimation import (
    GATE_RECORDS,
    KINDS,
    STATES,
    FilterSettings,
    Flag,
    GateRecord,
    MeasurementKind,
    State,
)
from gateway.estimation import events as rules
from gateway.estimation.events import NO_GRID, Events, join, make_events, ticks, timelines
from gateway.estimation.filter import Estimator
from gateway.estimation.model import Event

ESTIMATOR = Estimator()
YAW, RATE, VELOCITY, POSITION = (
    MeasurementKind.YAW,
    MeasurementKind.YAW_RATE,
    MeasurementKind.VELOCITY,
    MeasurementKind.POSITION,
)


def in_python(function):
    """The function as it is written, where it would be compiled for this test alone."""
    return getattr(function, "py_func", function)


def one(kind, time, *z, std=0.1):
    """A measurement."""
    return make_events(kind, np.array([time]), np.array([z], float), std)


def run(*parts, settings=None):
    estimator = Estimator(settings) if settings else ESTIMATOR
    return estimator.advance(estimator.start(), join(parts), covariance=True)[1]


def flags(rows):
    """Without whether the estimate can be used."""
    return [Flag(int(f)) & ~Flag.VALID for f in rows.flags]


def at_rest(until, rate=10.0, yaw=0.4):
    """Yaw, velocity and position of a boat that lies still, in order of time."""
    time = np.arange(0.0, until, 1.0 / rate)
    parts = [
        make_events(YAW, time, np.full(len(time), yaw), 0.01),
        make_events(VELOCITY, time, np.zeros((len(time), 2)), 0.05),
        make_events(POSITION, time, np.tile([3.0, -4.0], (len(time), 1)), 0.2),
    ]
    events = join(parts)
    return events[np.lexsort((events.kind, events.time_s))]


@pytest.mark.parametrize(
    ("seen", "usable"),
    [
        ((YAW,), False),
        ((VELOCITY, POSITION, MeasurementKind.BODY_VELOCITY), False),
        ((YAW, RATE), False),
        ((YAW, VELOCITY), True),
        ((YAW, POSITION), True),
        ((YAW, MeasurementKind.BODY_VELOCITY), True),
        ((YAW, VELOCITY, POSITION), True),
    ],
)
def test_an_estimate_rests_on_yaw_and_one_of_velocity_and_position(seen, usable):
    gates = np.zeros((KINDS, GATE_RECORDS))
    gates[list(seen), GateRecord.SEEN] = 1.0
    assert bool(in_python(rules.valid)(gates)) is usable


LARGEST = {  # of a boat, in the unit of the kind
    YAW: (1e4, 1), RATE: (50.0, 1), VELOCITY: (100.0, 2), POSITION: (1e7, 2),
    MeasurementKind.BODY_VELOCITY: (100.0, 2),
}  # fmt: skip


@pytest.mark.parametrize("kind", LARGEST, ids=lambda k: k.name.lower())
def test_beyond_what_a_boat_can_do_is_no_measurement_in_either_component(kind):
    largest, components = LARGEST[kind]
    implausible, fine = in_python(rules.implausible), np.full(2, 0.1)
    assert not implausible(Event(0.0, kind, np.full(2, -largest), fine), components)
    for a in range(components):
        for z, std in ((1.001 * largest, 0.1), (np.nan, 0.1), (0.0, np.inf), (0.0, 0.0)):
            event = Event(0.0, kind, np.zeros(2), fine.copy())
            event.z[a], event.std[a] = z, std
            assert implausible(event, components)


JUMPS = {  # variance that a discontinuity of the source adds, gated for two seconds
    YAW: {State.YAW: 3.0**2},
    RATE: {State.R: 2.0**2, State.YAW: 4.0**2},
    VELOCITY: {State.U: 5.0**2, State.V: 5.0**2},
    MeasurementKind.BODY_VELOCITY: {State.U: 5.0**2, State.V: 5.0**2},
    POSITION: {State.NORTH: 1e6, State.EAST: 1e6},
}


@pytest.mark.parametrize("kind", JUMPS, ids=lambda k: k.name.lower())
def test_a_discontinuity_makes_unknown_what_is_measured_and_nothing_else(kind):
    P, expected = np.eye(STATES), np.ones(STATES)
    in_python(rules.inflate_covariance)(kind, 2.0, P)
    for state, variance in JUMPS[kind].items():
        expected[state] += variance
    np.testing.assert_array_equal(P, np.diag(expected))


def test_outliers_are_a_discontinuity_when_there_are_enough_of_them_over_long_enough():
    model, counts = ESTIMATOR.settings.kernel_model(), in_python(rules.is_discontinuity)

    def when(kind, step):
        """How many in a row, at that pace [s], until they are believed."""
        gate = np.zeros(GATE_RECORDS)
        given = (Event(7.0 + step * k, kind, np.zeros(2), np.ones(2)) for k in range(200))
        return 1 + next(k for k, event in enumerate(given) if counts(event, gate, model))

    assert when(YAW, 1.0 / 64.0) == 65  # a second of them, the first at its beginning
    assert when(YAW, 0.5) == 10  # ten of them, however slow
    assert when(RATE, 0.01) == when(RATE, 5.0) == 2  # a turn that begins


def test_each_component_counts_as_much_as_its_own_uncertainty_says():
    start = join([one(YAW, 0.0, 0.0, std=0.01), one(VELOCITY, 0.0, 0.0, 0.0, std=0.5)])
    for fine in (0, 1):
        reading = one(VELOCITY, 0.0, 0.8, 0.8)
        std = np.full((1, 2), 50.0)
        std[0, fine] = 0.01
        rows = run(start, replace(reading, std=std))
        moved = rows.motion[-1, [State.U, State.V]]
        assert moved[fine] == pytest.approx(0.8, abs=0.05)
        assert abs(moved[1 - fine]) < 0.05


def test_the_stated_uncertainty_is_that_of_the_covariance():
    rows = run(at_rest(2.0), one(VELOCITY, 2.0, 0.3, 0.2))
    for std, covariance in zip(rows.std, rows.covariance, strict=True):
        np.testing.assert_allclose(std**2, np.diag(covariance), rtol=1e-12)
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-15)


def test_a_heading_that_was_lost_makes_all_that_turns_with_it_wait():
    """After a silence of half a minute the heading may be anywhere, until a compass tells it."""
    back = 35.0
    rows = run(at_rest(5.0), one(VELOCITY, back, 0.0, 0.0), one(YAW, back, 0.4, std=0.01),
               one(VELOCITY, back, 0.0, 0.0))  # fmt: skip
    assert flags(rows)[-3] == Flag.WAITING
    assert flags(rows)[-2] == Flag.USED
    assert flags(rows)[-1] == Flag.USED
    soon = run(at_rest(5.0), one(VELOCITY, 5.5, 0.0, 0.0))
    assert flags(soon)[-1] == Flag.USED


@pytest.mark.parametrize("kind", [-1, KINDS])
def test_a_kind_that_there_is_not_is_refused(kind):
    events = at_rest(1.0)
    strange = Events(np.array([1.0]), np.array([kind]), np.zeros((1, 2)), np.ones((1, 2)))
    rows = run(events, strange, one(YAW, 1.0, 0.4))
    assert flags(rows)[-2:] == [Flag.REFUSED, Flag.USED]
    np.testing.assert_array_equal(rows.motion[-2], rows.motion[-3])


@pytest.mark.parametrize(("late", "what"), [(0.99, Flag.USED | Flag.LATE), (1.01, Flag.REFUSED)])
def test_a_measurement_may_be_a_second_late(late, what):
    rows = run(at_rest(3.0), one(YAW, 2.9 - late, 0.4, std=0.01))
    assert flags(rows)[-1] == what
    assert rows.time_s[-1] == pytest.approx(2.9)  # the estimate is of the newest event


@pytest.mark.parametrize(("silence", "what"), [(59.9, Flag(0)), (60.1, Flag.RESTART)])
def test_after_a_minute_of_silence_everything_is_forgotten(silence, what):
    rows = run(at_rest(3.0), one(YAW, 2.9 + silence, 0.4, std=0.01))
    assert flags(rows)[-1] & Flag.RESTART == what
    rows = run(at_rest(3.0), one(YAW, 2.9 - silence, 0.4, std=0.01))
    assert flags(rows)[-1] & Flag.RESTART == what


def test_refused_events_count_only_in_a_row():
    """Twice as many late ones as make a clock wrong, with a good one between."""
    few = ESTIMATOR.settings.refused_in_a_row - 1
    old = make_events(YAW, np.full(few, 0.5), np.full(few, 0.4), 0.01)
    rows = run(at_rest(3.0), old, one(YAW, 3.0, 0.4), old)
    assert not rows.has(Flag.RESTART).any()
    rows = run(at_rest(3.0), old, old[:1])
    assert flags(rows)[-2:] == [Flag.REFUSED, Flag.RESTART | Flag.USED]
    assert rows.time_s[-1] == 0.5


@pytest.mark.parametrize("kept", [4, 5, 9])
def test_a_late_event_needs_the_one_before_it_to_be_kept_still(kept):
    """Of a history of M events: what comes before all but M − 2 of them comes too late."""
    settings = FilterSettings(history_events=kept)
    time = 0.1 * np.arange(20)
    events = make_events(YAW, time, np.full(20, 0.4), 0.01)
    for back in range(1, kept + 2):
        rows = run(events, one(YAW, time[-back] - 0.05, 0.4, std=0.01), settings=settings)
        late = Flag.USED | Flag.LATE
        assert flags(rows)[-1] == (late if back <= kept - 2 else Flag.REFUSED)
        if back <= kept - 2:
            order = np.argsort([*time, time[-back] - 0.05], kind="stable")
            ordered = run(join([events, one(YAW, time[-back] - 0.05, 0.4, std=0.01)])[order])
            np.testing.assert_allclose(rows.covariance[-1], ordered.covariance[-1], rtol=1e-9)


def test_of_one_moment_the_kind_decides_the_order_whichever_came_first():
    start, later = at_rest(1.0), [one(YAW, 1.0, 0.5), one(VELOCITY, 1.0, 0.2, 0.1)]
    here, there = run(start, *later), run(start, *later[::-1])
    np.testing.assert_allclose(here.motion[-1], there.motion[-1], rtol=0, atol=1e-12)
    assert not there.has(Flag.LATE).any()


def test_a_timeline_is_cut_at_gaps_and_has_no_step_too_long_to_be_linear():
    settings = FilterSettings(max_step_s=0.1, gap_s=2.0)
    time = np.array([0.0, 0.05, 0.35, 1.3, 5.0, 5.25, 9.0])
    wrong = Events(np.array([np.nan, 1.0]), np.array([1, KINDS]), np.zeros((2, 2)), np.ones((2, 2)))
    grid = np.array([-0.5, 0.2, 0.35, 1.0, 3.0, 5.1])
    lines = list(timelines(join([make_events(YAW, time, time, 0.1), wrong]), grid, settings))
    assert [(line.time[0], line.time[-1]) for line in lines] == [
        (0.0, 1.3),
        (5.0, 5.25),
        (9.0, 9.0),
    ]
    for line in lines:
        np.testing.assert_allclose(line.span, np.diff(line.time, prepend=line.time[0]))
        assert line.span.max() <= 0.1 + 1e-9
        assert (line.span >= 0.0).all()
    rows = [line.grid[line.grid != NO_GRID].tolist() for line in lines]
    assert rows == [[1, 2, 3], [5], []]
    first = lines[0]
    np.testing.assert_array_equal(first.time[first.grid == 1], [0.2])
    assert (first.kind[first.grid != NO_GRID] == MeasurementKind.TICK).all()
    assert first.time[first.kind == YAW].tolist() == [0.0, 0.05, 0.35, 1.3]
    exact = next(
        timelines(make_events(YAW, np.array([0.0, 0.3]), np.zeros(2), 0.1), grid[:0], settings)
    )
    np.testing.assert_allclose(exact.time, [0.0, 0.1, 0.2, 0.3])  # as long as it may be, no more
    # 0.35 to 1.0 s takes seven steps, as even as they can be
    between = first.time[(first.time > 0.35) & (first.time < 1.0)]
    np.testing.assert_allclose(between, 0.35 + 0.65 / 7.0 * np.arange(1, 7))


def test_a_prediction_in_one_go_is_that_in_as_many_steps_as_are_linear():
    """A second without a word: the same as with a tick each tenth of it."""
    start = join([at_rest(1.0), one(VELOCITY, 1.0, 0.4, 0.3), one(RATE, 1.0, 0.2, std=0.01)])
    steps = run(start, ticks(1.0 + 0.1 * np.arange(1, 11)))
    whole = run(start, ticks(np.array([2.0])))
    np.testing.assert_allclose(whole.motion[-1], steps.motion[-1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(whole.covariance[-1], steps.covariance[-1], rtol=1e-9, atol=1e-12)


def test_what_was_not_used_has_no_components_and_what_waits_or_is_no_number_no_distance():
    rows = run(
        one(VELOCITY, 0.0, 0.0, 0.0), at_rest(1.0), one(YAW, 0.9, np.nan),
        one(POSITION, 0.9, 9.0, 9e9), one(YAW, 0.9, 2.0, std=0.01),
        one(YAW, -9.0, 0.4), ticks(np.array([1.0])),
        one(YAW, 1.0, 0.402, std=0.01), one(VELOCITY, 1.0, 0.1, 0.0),
    )  # fmt: skip
    last = slice(-7, None)
    refused, gated, used = Flag.REFUSED, Flag.GATED, Flag.USED
    assert flags(rows)[last] == [gated, gated, gated, refused, Flag(0), used, used]
    assert (flags(rows)[0], rows.used[0], rows.nis[0]) == (Flag.WAITING, 0, 0.0)
    assert rows.used[last].tolist() == [0, 0, 0, 0, 0, 1, 2]
    known = rows.nis[last] > 0.0
    assert known.tolist() == [False, False, True, False, False, True, True]


def test_of_the_first_heading_nothing_is_an_error_and_it_is_within_half_a_turn():
    rows = run(one(YAW, 0.0, 5.0, std=0.01))
    assert rows.motion[0, State.YAW] == pytest.approx(5.0 - 2.0 * np.pi)
    assert (rows.nis[0], rows.used[0]) == (0.0, 1)
