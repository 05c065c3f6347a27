"""What a cause adds, by hand; and from scores to a name: the rules, one by one."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.model import Model
from sim.monitoring import SecondMeans, causes
from sim.monitoring.causes import BALANCES, BOAT_ERRORS, DIFFERENCE_STEP, WITH_COMPASS, Hull, Law
from sim.monitoring.disturbances import BOAT, Cause, DisturbanceEstimate, DisturbanceEstimator
from sim.monitoring.explanations import ALL_THRUSTERS, hull_of
from sim.monitoring.filters import ALIKE_S, change_noise, noise_step, white_noise_after
from sim.state import Floats
from sim.wind import AIR_DENSITY
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.vessels import RUDDER_BOAT, STEERED_BOAT
from tests.sim.voyages import WAM_V

HALF_PI = 0.5 * np.pi
BARE = np.array([0.0, 0.0, 5.0, 50.0])  # of the wind: no areas
AREAS = np.array([0.8, 1.6, 5.0, 144.0])
HULL = Hull(np.array([-10.0, -20.0, -30.0, -40.0, -50.0, -60.0]), BARE)


def in_python(function: Any) -> Any:
    """The function as it is written, where it would be compiled for this test alone."""
    return getattr(function, "py_func", function)


@pytest.fixture(scope="module")
def plain() -> DisturbanceEstimator:
    return DisturbanceEstimator.of(Model.of(WAM_V))


# -- what a cause adds --


def test_the_boats_own_errors_are_a_force_scales_and_a_heading() -> None:
    H = np.full((3, BOAT_ERRORS + 2), 9.0)
    in_python(causes.write_boat_errors)(2.0, -1.0, 0.5, np.array([70.0, 3.0, -8.0]), HULL, H)
    expected = [
        [1, 0, 0, 70.0, 0, (-10 - 20 * 2.0) * 2.0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0, (-30 - 40 * 1.0) * -1.0, 0, 2.0, 0],
        [0, 0, 1, 0, -8.0, 0, 0, (-50 - 60 * 0.5) * 0.5, 0, 2.0],
    ]
    np.testing.assert_allclose(H[:, :BOAT_ERRORS], expected)
    assert (H[:, BOAT_ERRORS:] == 9.0).all()  # of the cause


def test_a_boats_own_damping_goes_with_the_velocity_through_the_water(
    plain: DisturbanceEstimator,
) -> None:
    """On a heading to the east, in water that goes east at 0.5 and south at 0.25 m/s."""
    motion = np.array([0.0, 0.0, HALF_PI, 2.0, 0.75, 0.5, 0.0, 0.0, 0.0])
    second = replace(next(seconds(1)), motion=motion)
    still, moving = np.zeros((WITH_COMPASS, 3)), np.array([-0.25, 0.5])
    over, through = (
        plain.linearised(plain.all.which[f], o, second, still).boat
        for f, o in ((0, np.zeros(0)), (1, moving))
    )
    for boat, u, v in ((over, 2.0, 0.75), (through, 1.5, 0.5)):
        expected = np.zeros((3, BOAT_ERRORS))
        in_python(causes.write_boat_errors)(
            u, v, 0.5, second.commanded, hull_of(WAM_V, plain.air), expected
        )
        np.testing.assert_allclose(boat, expected, rtol=1e-9)


def test_what_a_current_adds_is_what_the_balance_in_still_water_lacks(
    plain: DisturbanceEstimator,
) -> None:
    balances = np.zeros((WITH_COMPASS, 3))
    balances[0], balances[1], balances[2] = (7.0, 5.0, 3.0), (1.0, 2.0, 0.5), (9.0, 9.0, 9.0)
    at = plain.all.which[plain.all.laws.index(Law.CURRENT)]
    found = plain.linearised(at, np.array([0.2, 0.1]), next(seconds(1)), balances)
    np.testing.assert_allclose(found.force, [6.0, 3.0, 2.5])


def test_motions_in_water_that_moves_and_a_step_from_it_and_under_a_compass_that_is_off() -> None:
    """East-going water on a heading to the east comes from astern; the boat turns in it."""
    motion = np.array([5.0, 6.0, HALF_PI, 2.0, -1.0, 0.5, 0.1, 0.2, 0.3])
    out = np.empty((WITH_COMPASS, 9))
    in_python(causes.write_motions)(motion, np.array([0.0, 0.4]), HALF_PI, out)
    np.testing.assert_allclose(out[0], motion)
    wet = motion - [0, 0, 0, 0.4, 0.0, 0.0, 0.0, -0.5 * 0.4, 0.0]
    np.testing.assert_allclose(out[1], wet, atol=1e-12)
    np.testing.assert_allclose(
        out[2 : BALANCES - 1] - wet, DIFFERENCE_STEP * np.eye(9)[3:], atol=1e-12
    )  # u, v, r and their rates
    np.testing.assert_allclose(
        out[BALANCES - 1] - wet, DIFFERENCE_STEP * np.eye(9)[2], atol=1e-12
    )  # the heading
    quarter = np.array([5.0, 6.0, HALF_PI, 1.0, 2.0, 0.5, -0.2, 0.1, 0.3])
    np.testing.assert_allclose(out[BALANCES], quarter, atol=1e-12)
    turn = np.array([0, 0, 0, -2.0, 1.0, 0, -0.1, -0.2, 0])  # ∂/∂ of the angle
    np.testing.assert_allclose(out[-1] - quarter, causes.STEP_RAD * turn, atol=2e-6)


def lost(estimator: DisturbanceEstimator, second: SecondMeans, share: float) -> Floats:
    """What a thruster that gives that much too much adds: (3,)."""
    f = estimator.all.laws.index(Law.THRUST)
    estimate = estimator.start()
    estimate.means[f, BOAT_ERRORS] = share
    found = estimator.measured(estimate, second, f)
    np.testing.assert_allclose(found.force, share * found.slope[:, 0])
    return found.force


def test_a_thruster_pushes_along_its_azimuth_where_it_sits(plain: DisturbanceEstimator) -> None:
    """Too much of the port one at 0.4 of its thrust pushes ahead and to starboard."""
    for command, newton in ((0.4, 36.0), (-0.4, -34.0)):
        second = replace(next(seconds(1)), mean_commands=np.array([command, 0.0]))
        for share in (0.5, -0.5, 0.01):
            expected = share * newton * np.array([1.0, 0.0, 0.7])
            np.testing.assert_allclose(lost(plain, second, share), expected, atol=1e-9)


def test_a_motor_that_is_steered_loses_its_thrust_where_it_points() -> None:
    """Quadratic, 120 N at full, a metre behind: at half throttle and 0.3 rad of helm."""
    steered = DisturbanceEstimator.of(Model.of(STEERED_BOAT))
    second = replace(next(seconds(1)), mean_commands=np.array([0.5, 0.5]))
    X, Y = 30.0 * np.cos(0.3), -30.0 * np.sin(0.3)
    np.testing.assert_allclose(lost(steered, second, -0.6), -0.6 * np.array([X, Y, -Y]))


def test_a_rudder_feels_the_stream_that_a_weak_propeller_does_not_make() -> None:
    """The blade at u + slipstream by hand (Yasukawa and Yoshimura), without a drift."""
    estimator = DisturbanceEstimator.of(Model.of(RUDDER_BOAT))
    motion = np.array([0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    second = replace(next(seconds(1)), motion=motion, mean_commands=np.array([0.5, 0.5]))

    def pushed(thrust: float) -> Floats:
        squared = 1.5**2 + 2.0 * thrust / (1000.0 * 0.25 * np.pi * 0.02 * 1.5)
        slope = 6.13 * 1.5 / (1.5 + 2.25)
        normal = 500.0 * 0.02 * slope * np.sin(0.3) * squared
        X, Y = -normal * np.sin(0.3), -normal * np.cos(0.3)
        return np.array([thrust + X, Y, -1.2 * Y])

    np.testing.assert_allclose(lost(estimator, second, -0.6), pushed(12.0) - pushed(30.0))


def test_air_pushes_as_its_areas_say_and_without_them_as_a_force_in_the_world() -> None:
    force = in_python(causes.wind_force)
    motion = np.array([0.0, 0.0, HALF_PI, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # to the east at 1 m/s
    np.testing.assert_allclose(force(7.0, 9.0, motion, BARE), (9.0, -7.0, 0.0), atol=1e-9)
    for areas in (AREAS * [0.0, 1.0, 1.0, 1.0], AREAS * [1.0, 0.0, 1.0, 1.0]):
        np.testing.assert_allclose(force(7.0, 9.0, motion, areas), (9.0, -7.0, 0.0), atol=1e-9)
    # 3 m/s to the north, 5 m/s to the east: g = |V| V; through the air u = −4, v = 3
    g = np.hypot(3.0, 5.0) * np.array([3.0, 5.0])
    expected = -AIR_DENSITY * np.array(
        [0.5 * 0.7 * 0.8 * 5.0 * -4.0, 0.5 * 0.825 * 1.6 * 5.0 * 3.0, 0.125 * 1.6 * 5.0 * -12.0]
    )
    np.testing.assert_allclose(force(*g, motion, AREAS), expected, rtol=1e-9)


def test_no_air_has_no_velocity_and_more_of_it_the_root() -> None:
    velocity = in_python(causes.velocity_of_air)
    assert velocity(0.0, 0.0) == (0.0, 0.0)
    np.testing.assert_allclose(velocity(0.0, -25.0), (0.0, -5.0))


def test_the_slope_of_air_is_that_of_a_root_and_of_its_spread_where_there_is_none() -> None:
    slope = in_python(causes.slope_of_air)
    g, nothing = np.array([3.0, -4.0]), np.zeros((2, 2))
    rows = np.array(slope(g, nothing))
    for k, step in enumerate(1e-5 * np.eye(2)):
        above, below = (in_python(causes.velocity_of_air)(*(g + s)) for s in (step, -step))
        np.testing.assert_allclose(rows[:, k], np.subtract(above, below) / 2e-5, rtol=1e-6)
    wide = np.array([[9.0, 2.0], [2.0, 16.0]])  # a size of √(9 + 16)
    np.testing.assert_allclose(slope(np.zeros(2), wide), np.eye(2) / np.sqrt(5.0), atol=1e-12)


# -- priors, noise, silence --


def test_what_a_boat_may_be_off_by_follows_its_size(plain: DisturbanceEstimator) -> None:
    """WAM-V: 180 N ahead, half its beam 1.15 m, 36.4 N s/m of sway damping."""
    lever = 0.5 * WAM_V.hull.beam
    expected = [5.4, 5.4, 5.4 * lever, 0.08, 0.08, 0.1, 0.1, 0.1, 1.092, 1.092 * lever]
    np.testing.assert_allclose(plain.prior, expected)
    start = plain.start()
    widths = {Law.CURRENT: [0.5, 0.5], Law.WIND: [144.0, 144.0], Law.THRUST: [0.6],
              Law.COMPASS: [0.25], Law.DRAG: [0.8], Law.ANYTHING: [45.0, 45.0, 45.0 * lever],
              Law.NOTHING: []}  # fmt: skip
    for f, law in enumerate(plain.all.laws):
        one = start.filter(f)
        np.testing.assert_allclose(one.covariance, np.diag([*np.square(expected + widths[law])]))
        assert not one.mean.any()
    drifting: Any = SimpleNamespace(vessel=replace(WAM_V, thrusters=()))
    still = DisturbanceEstimator.of(drifting)
    assert still.prior[0] == pytest.approx(0.03 * 0.5 * WAM_V.hull.mass)


def test_what_a_hull_is_goes_into_the_laws(plain: DisturbanceEstimator) -> None:
    hull = hull_of(WAM_V, plain.air)
    np.testing.assert_allclose(hull.damping, [-26.6, -35.9, -36.4, -27.4, -99.2, -10.6])


def noise_after(noise: Any, innovations: Any, step: float) -> Floats:
    """`change_noise` of a copy, after normalised innovations (L, 3)."""
    out = np.array(noise, float)
    in_python(change_noise)(out, np.atleast_2d(np.array(innovations, float)), step)
    return out


def test_noise_follows_what_is_left_within_limits() -> None:
    """In steps of a fifth: what is alike changes nothing, a wild second counts as three sigmas."""
    none, one = np.zeros(3), np.ones(3)
    np.testing.assert_allclose(noise_after(one, [1.0, 2.0, 0.0], 0.2), [1.0, 1.6, 0.8])
    np.testing.assert_allclose(noise_after(one, [3.0, -9.0, 99.0], 0.2), [2.6, 2.6, 2.6])
    np.testing.assert_allclose(noise_after(0.02 * one, none, 0.2), 0.02 * one)
    np.testing.assert_allclose(noise_after(9.9 * one, 9.0 * one, 0.2), 10.0 * one)


def test_what_is_alike_from_one_second_to_the_next_counts_as_noise_and_what_alternates_less() -> (
    None
):
    """Of four lags the weights are three, two and one quarter."""
    now, none, before = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, -0.4, -1.0]
    for lag, weight in ((1, 0.75), (2, 0.5), (3, 0.25)):
        innovations = [now, none, none, none]
        innovations[lag] = before
        ratio = np.maximum(1.0 + 2.0 * weight * np.array(before), 0.0)
        got = noise_after(np.ones(3), innovations, 0.1)
        np.testing.assert_allclose(got, 1.0 + 0.1 * (ratio - 1.0))
    np.testing.assert_allclose(noise_after(np.ones(3), [[3.0] * 3] * 4, 0.1), [2.7] * 3)


@pytest.mark.parametrize("width", [1, 2, 4])
def test_noise_that_is_alike_is_worth_as_many_seconds_as_its_mean_says(width: int) -> None:
    """Means of `width` seconds of white noise, of variance 1: the mean of n has `width` / n.

    Up to twice that is found, for no second counts as less than none.
    """
    w = np.random.default_rng(5).standard_normal((20000 + width, 3))
    total = np.cumsum(w, axis=0)
    alike = (total[width:] - total[:-width]) / np.sqrt(width)
    stated, noise, seen = 4.0, np.ones(3), []
    innovations = np.zeros((ALIKE_S, 3))
    for e in np.sqrt(stated) * alike:
        innovations = np.vstack([e / np.sqrt(stated * noise), innovations[:-1]])
        noise = noise_after(noise, innovations, 1.0 / 60.0)
        seen.append(noise)
    found = np.mean(seen[1000:], axis=0)
    assert (width < found).all()
    assert (found < 2.0 * width).all()


@pytest.mark.parametrize(
    ("dt", "count", "step"),
    [(0.0, 0, 0.0), (1.0, 0, 0.2), (1.0, 5, 0.1), (1.0, 45, 0.02), (1.0, 55, 1 / 60),
     (1.0, 900, 1 / 60), (6.0, 900, 0.1), (600.0, 900, 0.2)],
)  # fmt: skip
def test_noise_is_soon_known_and_followed_over_a_minute(dt: float, count: int, step: float) -> None:
    assert in_python(noise_step)(dt, count) == pytest.approx(step)


def test_the_noise_of_a_boat_that_is_as_it_should_be_is_found_in_half_a_minute(
    plain: DisturbanceEstimator,
) -> None:
    """NOISE is two thirds of what is stated: of the variance four ninths."""
    for seed in range(3):
        estimate = plain.start()
        np.testing.assert_array_equal(estimate.noise, [0.2, 0.2, 0.2])
        for second in seconds(30, seed=seed):
            estimate, _ = plain.observe(estimate, second)
        assert 0.2 < float(np.exp(np.log(estimate.noise).mean())) < 0.9


def test_the_noise_of_one_second_alone_follows_within_its_own_limits() -> None:
    """A tenth of what a second is off by, at most; what is alike changes nothing."""
    one = np.ones(3)
    for dt, expected in ((6.0, [1.0, 1.2, 0.9]), (3.0, [1.0, 1.1, 0.95]), (60.0, [1.0, 1.2, 0.9])):
        np.testing.assert_allclose(white_noise_after(one, np.sqrt([1.0, 3.0, 0.0]), dt), expected)
    np.testing.assert_allclose(white_noise_after(one, np.array([3.0, 9.9, 0.0]), 60.0),
                               [1.8, 1.8, 0.9])  # fmt: skip
    low = white_noise_after(0.1 * one, np.zeros(3), 6.0)
    high = white_noise_after(9.9 * one, 3.0 * one, 6.0)
    np.testing.assert_allclose((low, high), (0.1 * one, 10.0 * one))
    assert (one == 1.0).all()


def test_a_missing_force_is_known_as_stated_and_no_estimate_is_perfect(
    plain: DisturbanceEstimator,
) -> None:
    second = replace(next(seconds(1)), missing_std=np.array([4.0, 0.0, 1.0]))
    variance = plain.variance(second, np.array([2.0, 1.0, 0.5]))
    np.testing.assert_allclose(variance, np.array([32.0, 0.0, 0.5]) + (0.01 * plain.prior[:3]) ** 2)


def test_a_silence_widens_what_was_known_and_not_for_ever(plain: DisturbanceEstimator) -> None:
    first, second = seconds(2)
    estimate, _ = plain.observe(plain.start(), first)
    assert (estimate.count, estimate.time, estimate.opened) == (1, 0.0, -np.inf)

    def spread(time: float) -> float:
        after, _ = plain.observe(estimate, replace(second, time=time))
        assert (after.count, after.time) == (2, time)
        return float(np.trace(after.water.disturbance_covariance))

    assert spread(0.0) == spread(-5.0)  # a clock that went back
    assert spread(0.0) < spread(300.0) < spread(600.0)
    assert spread(600.0) == spread(9000.0)
    again, _ = plain.observe(plain.start(), replace(first, time=9000.0))  # no silence before it
    np.testing.assert_array_equal(again.covariances, estimate.covariances)


@pytest.mark.parametrize(("count", "kept"), [(59, False), (60, True)])
def test_trouble_begins_with_the_boat_as_a_minute_has_shown_it(
    plain: DisturbanceEstimator, count: int, kept: bool
) -> None:
    before = plain.start()
    before.means[:] = 0.3
    before.covariances[:] *= 0.5
    before = replace(before, count=count, scores=np.arange(8.0), noise=np.full(3, 2.0))
    after, fresh = plain.reopened(before, 77.0), plain.start()
    assert (after.opened, after.count) == (77.0, count)
    assert not after.scores.any()
    assert (after.noise == 2.0).all()
    for f in range(len(plain.all.laws)):
        now, known = after.filter(f), before.boat if kept else fresh.boat
        np.testing.assert_array_equal(now.mean[:BOAT_ERRORS], known.mean)
        np.testing.assert_array_equal(now.covariance[:BOAT_ERRORS, :BOAT_ERRORS], known.covariance)
        assert not now.disturbance.any()
        np.testing.assert_array_equal(
            now.disturbance_covariance, fresh.filter(f).disturbance_covariance
        )


# -- from scores to a name --


def scored(plain: DisturbanceEstimator, clear: bool = True, **nats: float) -> DisturbanceEstimate:
    """Scores over the boat's own −10 by law; clear: each disturbance ten deviations from none."""
    start = plain.start()
    scores = np.array([-10.0 + nats.get(law.name.lower(), 0.0) for law in plain.all.laws])
    means = start.means.copy()
    if clear:
        means[:, BOAT_ERRORS:] = 10.0 * plain.all.prior[:, BOAT_ERRORS:]
    return replace(start, scores=scores, means=means)


def test_an_explanation_has_to_beat_the_boat_itself(plain: DisturbanceEstimator) -> None:
    assert scored(plain, drag=10.0).cause is Cause.DRAG
    assert scored(plain, drag=9.9).cause is Cause.NOTHING
    assert scored(plain, drag=9.9).likely == ()


def test_of_two_that_do_alike_both_are_told(plain: DisturbanceEstimator) -> None:
    assert scored(plain, drag=20.0, compass=15.1).likely == (Cause.DRAG, Cause.COMPASS)
    assert scored(plain, drag=20.0, compass=15.1).cause is Cause.SEVERAL
    assert scored(plain, drag=20.0, compass=15.0).cause is Cause.DRAG
    assert scored(plain, current=20.0, wind=18.0).cause is Cause.EITHER
    assert scored(plain, thrust=20.0).likely == (Cause.THRUST,)  # two thrusters are one cause


def test_on_few_headings_water_goes_with_air_unless_one_does_far_better(
    plain: DisturbanceEstimator,
) -> None:
    near, far = scored(plain, current=34.9, wind=20.0), scored(plain, current=35.0, wind=20.0)
    assert near.likely_on(False) == far.likely_on(True) == (Cause.CURRENT,)
    assert near.likely_on(True) == (Cause.CURRENT, Cause.WIND)
    assert near.cause_of(near.likely_on(True)) is Cause.EITHER
    assert near.cause_of(near.likely_on(False)) is Cause.CURRENT
    wind = scored(plain, wind=34.9, current=20.0, drag=30.0)
    assert wind.likely_on(True) == (Cause.WIND, Cause.DRAG, Cause.CURRENT)
    assert wind.cause_of(wind.likely_on(True)) is Cause.SEVERAL
    assert scored(plain, drag=30.0, current=10.0, wind=20.0).likely_on(True) == (Cause.DRAG,)
    assert scored(plain).likely_on(True) == ()


def test_a_force_that_wanders_has_to_beat_all_by_far(plain: DisturbanceEstimator) -> None:
    assert scored(plain, drag=20.0, anything=32.0).cause is Cause.OTHER
    assert scored(plain, drag=20.0, anything=31.9).likely == (Cause.DRAG, Cause.OTHER)
    assert scored(plain, drag=20.0, anything=20.1).cause is Cause.SEVERAL
    assert scored(plain, drag=20.0, anything=19.9).cause is Cause.DRAG
    assert scored(plain, anything=11.0).likely[-1] is Cause.OTHER  # no name, yet not nothing
    assert scored(plain, anything=13.0).cause is Cause.OTHER


@pytest.mark.parametrize("law", ["current", "wind", "drag", "compass", "thrust"])
def test_what_may_as_well_be_nothing_is_not_named(plain: DisturbanceEstimator, law: str) -> None:
    """As a current ended it was "current or wind (0.01 m/s of current towards 147°, …)"."""
    assert scored(plain, clear=False, **{law: 30.0}).cause is Cause.NOTHING
    assert scored(plain, **{law: 30.0}).cause is Cause(law)


def test_of_several_one_has_to_be_clearly_more_than_nothing(plain: DisturbanceEstimator) -> None:
    for others in ({"compass": 29.0}, {"current": 29.0}, {"anything": 31.0}):
        nats = {"drag": 30.0, **others}
        assert scored(plain, **nats).cause is Cause.SEVERAL
        unclear = scored(plain, clear=False, **nats)
        assert len(unclear.likely) == 2
        assert unclear.cause is Cause.NOTHING
        drag = plain.all.laws.index(Law.DRAG)
        unclear.means[drag, BOAT_ERRORS] = 10.0 * plain.all.prior[drag, BOAT_ERRORS]
        assert unclear.cause_of(unclear.likely) is Cause.SEVERAL
    assert scored(plain, current=30.0, wind=29.0).cause is Cause.EITHER
    assert scored(plain, clear=False, current=30.0, wind=29.0).cause is Cause.NOTHING
    assert scored(plain, clear=False, drag=20.0, anything=40.0).cause is Cause.OTHER


def test_clear_is_more_than_three_deviations_from_nothing(plain: DisturbanceEstimator) -> None:
    estimate = plain.start()
    f = plain.all.laws.index(Law.DRAG)
    for times, clear in ((2.9, False), (3.1, True), (-3.1, True)):
        estimate.means[f, BOAT_ERRORS] = times * plain.all.prior[f, BOAT_ERRORS]
        assert estimate.filter(f).significant is clear
        assert estimate.filter(f).squared_distance(np.zeros(1)) == pytest.approx(times**2)


def test_the_filter_of_a_cause_is_the_one_that_predicts_best(plain: DisturbanceEstimator) -> None:
    estimate = scored(plain, current=3.0)
    port, starboard, both = (f for f, law in enumerate(plain.all.laws) if law is Law.THRUST)
    assert [plain.all.names[f] for f in (port, starboard, both)] == ["left", "right", ALL_THRUSTERS]
    estimate.scores[starboard] = 5.0
    assert [f for _, kind, f in estimate.named if kind is Cause.THRUST] == [starboard, port, both]
    assert estimate.best(Cause.THRUST).score == 5.0
    assert estimate.named[0][1] is Cause.THRUST
    assert BOAT not in {f for _, _, f in estimate.named}
    assert estimate.finite
    estimate.means[0, 0] = np.nan
    assert not estimate.finite


def test_a_second_is_predicted_by_all_and_the_best_of_them_tells_the_noise(
    plain: DisturbanceEstimator,
) -> None:
    """Each filter against its own step; the noise follows what the best of them left."""
    voyage: list[SecondMeans] = list(seconds(5, drag=3.0))
    estimate = plain.start()
    for k, second in enumerate(voyage):
        dt = 1.0 if k else 0.0
        variance: Floats = plain.variance(second, estimate.noise)
        one_by_one = [
            estimate.filter(f).updated(
                second.missing, variance, plain.measured(estimate, second, f), dt
            )
            for f in range(len(plain.all.laws))
        ]
        after, _ = plain.observe(estimate, second)
        for f, expected in enumerate(one_by_one):
            got = after.filter(f)
            np.testing.assert_allclose(got.mean, expected.mean, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(got.covariance, expected.covariance, rtol=1e-9, atol=1e-12)
            assert got.score == pytest.approx(expected.score)
        f = int(np.argmax([one.score for one in one_by_one]))
        step = in_python(noise_step)(dt, k)
        innovations = [one_by_one[f].innovation, *estimate.innovations[f, :-1]]
        expected_noise = noise_after(estimate.noise, innovations, step)
        np.testing.assert_allclose(after.noise, expected_noise)
        estimate = after


@pytest.mark.parametrize(("growth", "cause"), [(-0.9, Cause.DRAG), (-1.1, Cause.NOTHING)])
def test_no_drag_that_drives_the_boat_is_a_cause(
    plain: DisturbanceEstimator, growth: float, cause: Cause
) -> None:
    """Of motors on another channel "183 % less drag ahead" was told."""
    estimate = scored(plain, drag=30.0)
    f = plain.all.laws.index(Law.DRAG)
    estimate.means[f, BOAT_ERRORS] = growth
    estimate.covariances[f, BOAT_ERRORS, BOAT_ERRORS] = 0.01
    assert estimate.cause is cause
