"""Current and wind online: found, told apart by headings, silent where there is nothing."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from sim.effects.steady_current import EFFECT as STEADY_CURRENT
from sim.effects.steady_wind import EFFECT as STEADY_WIND
from sim.model import Model
from sim.monitoring import (
    NO_CURRENT,
    Balance,
    SecondMeans,
    WindModel,
    air_velocity,
    air_velocity_covariance,
    balances_at,
)
from sim.monitoring.causes import BOAT_ERRORS, WIND_STEP, Law
from sim.monitoring.disturbances import BOAT, Cause, DisturbanceEstimate, DisturbanceEstimator
from sim.monitoring.filters import (
    BOAT_DRIFT_S,
    SCORE_MEMORY_S,
    SECONDS_PER_INDEPENDENT_SECOND,
    DisturbanceFilter,
    MeasurementModel,
)
from sim.vessel import AddedEffect
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.vessels import SHAPES
from tests.sim.vessels import WAMV as WINDY
from tests.sim.voyages import WAM_V

STREAM = np.array([0.1, -0.28])


def after(estimator: DisturbanceEstimator, voyage: Iterable[SecondMeans]) -> DisturbanceEstimate:
    estimate = estimator.start()
    for second in voyage:
        estimate, _ = estimator.observe(estimate, second)
    return estimate


@pytest.fixture(scope="module")
def plain() -> DisturbanceEstimator:
    return DisturbanceEstimator.of(Model.of(WAM_V))


def test_a_current_is_found_within_what_it_states(plain: DisturbanceEstimator) -> None:
    estimate = after(plain, seconds(240, stream=STREAM))
    assert estimate.cause is Cause.CURRENT
    off = estimate.water.disturbance - STREAM
    assert np.hypot(*off) < 0.06
    assert off @ np.linalg.solve(estimate.water.stated_covariance, off) < 9.0


def test_the_more_is_seen_the_better_it_is_known(plain: DisturbanceEstimator) -> None:
    short, long = (after(plain, seconds(n, stream=STREAM)).water for n in (60, 300))
    assert np.trace(long.disturbance_covariance) < np.trace(short.disturbance_covariance)


def test_noise_alone_explains_nothing(plain: DisturbanceEstimator) -> None:
    for seed in range(6):
        estimate = after(plain, seconds(200, seed=seed))
        assert estimate.cause is Cause.NOTHING
        assert np.hypot(*estimate.water.disturbance) < 0.08


def test_what_stays_fixed_to_the_boat_is_not_put_down_to_the_world(
    plain: DisturbanceEstimator,
) -> None:
    estimate = after(plain, seconds(240, body=np.array([-12.0, 8.0, 6.0])))
    assert estimate.cause in (Cause.NOTHING, Cause.OTHER)


def test_a_wind_on_a_boat_whose_areas_nobody_knows_is_no_current(
    plain: DisturbanceEstimator,
) -> None:
    """The areas are twice those that are assumed: it is told by how it pushes, as a force."""
    assert not plain.air.has_areas
    real = replace(plain.air, front=2.0 * plain.air.front, side=2.0 * plain.air.side)
    g = np.array([-40.0, 28.0])
    blown = (replace(s, missing=s.missing + real.force(g, s)) for s in seconds(300))
    estimate = after(plain, blown)
    assert estimate.cause is Cause.WIND
    found = estimate.air.disturbance
    assert plain.air.force_abeam(found) == pytest.approx(real.force_abeam(g), rel=0.25)
    assert np.arctan2(*found) == pytest.approx(np.arctan2(*g), abs=0.2)


@pytest.mark.parametrize(
    ("wrong", "cause", "size", "near"),
    [
        ({"thrust": np.array([-0.5, 0.0])}, Cause.THRUST, -0.5, 0.1),
        ({"thrust": np.array([0.0, -0.4])}, Cause.THRUST, -0.4, 0.1),
        ({"compass": 0.2}, Cause.COMPASS, 0.2, 0.04),
        ({"compass": -0.2}, Cause.COMPASS, -0.2, 0.04),
        ({"drag": 0.8}, Cause.DRAG, 0.8, 0.15),
    ],
)
def test_what_is_wrong_with_the_boat_itself_is_named_with_its_size(
    plain: DisturbanceEstimator, wrong: dict[str, Any], cause: Cause, size: float, near: float
) -> None:
    """After two minutes in which all was right."""
    estimate = plain.reopened(after(plain, seconds(120)), 120.0)
    for second in seconds(160, first=120, **wrong):
        estimate, _ = plain.observe(estimate, second)
    assert estimate.cause is cause
    assert estimate.best(cause).disturbance[0] == pytest.approx(size, abs=near)


def test_the_thruster_that_is_named_is_the_one_that_failed(plain: DisturbanceEstimator) -> None:
    for side in (0, 1):
        lost = np.zeros(2)
        lost[side] = -0.5
        estimate = plain.reopened(after(plain, seconds(120)), 120.0)
        for second in seconds(120, first=120, thrust=lost):
            estimate, _ = plain.observe(estimate, second)
        thrusters = [f for f, law in enumerate(estimate.all.laws) if law is Law.THRUST]
        scores = [estimate.filter(f).score for f in thrusters]
        assert int(np.argmax(scores)) == side
        assert abs(scores[0] - scores[1]) > 20.0


def test_a_force_that_comes_and_goes_is_none_of_these(plain: DisturbanceEstimator) -> None:
    estimate = plain.reopened(after(plain, seconds(120)), 120.0)
    for k, second in enumerate(seconds(200, first=120)):
        sway = 60.0 * np.sin(2.0 * np.pi * k / 47.0)
        second = replace(second, missing=second.missing + np.array([0.0, sway, 0.0]))
        estimate, _ = plain.observe(estimate, second)
    assert estimate.cause is Cause.OTHER


@pytest.mark.parametrize("law", [law for law in Law if law is not Law.NOTHING])
def test_the_slope_of_a_cause_is_that_of_its_force(plain: DisturbanceEstimator, law: Law) -> None:
    second = next(seconds(1))
    second = replace(second, motion=second.motion + np.array([0, 0, 1.0, 0, 0.2, 0.3, 0, 0, 0.1]))
    f, start = plain.all.laws.index(law), plain.start()
    n = len(start.filter(f).disturbance)
    at = 0.15 * np.arange(1.0, n + 1.0) * (1.0 if law is not Law.WIND else 100.0)
    step = 1e-4 if law is not Law.WIND else WIND_STEP * plain.air.prior

    def force(o: np.ndarray) -> MeasurementModel:
        means = start.means.copy()
        means[f, BOAT_ERRORS : BOAT_ERRORS + n] = o
        return plain.measured(replace(start, means=means), second, f)

    for k, e in enumerate(step * np.eye(n)):
        differences = (force(at + e).force - force(at - e).force) / (2.0 * step)
        assert np.abs(differences).max() > 0.0
        assert differences == pytest.approx(force(at).slope[:, k], rel=0.01, abs=0.3)


def test_on_one_heading_no_current_is_claimed(plain: DisturbanceEstimator) -> None:
    estimate = after(plain, seconds(240, stream=STREAM, headings=1))
    assert estimate.cause in (Cause.NOTHING, Cause.EITHER, Cause.SEVERAL)
    assert np.sqrt(np.trace(estimate.water.disturbance_covariance)) > 0.06


def test_a_current_that_turns_is_followed(plain: DisturbanceEstimator) -> None:
    estimate = after(plain, seconds(200, stream=STREAM))
    for second in seconds(600, stream=-STREAM, first=200):
        estimate, _ = plain.observe(estimate, second)
    assert np.hypot(*(estimate.water.disturbance + STREAM)) < 0.15


def test_the_slope_of_a_current_is_that_of_the_balance(plain: DisturbanceEstimator) -> None:
    second = next(seconds(1, stream=STREAM))
    second = replace(second, motion=second.motion + np.array([0, 0, 1.0, 0, 0.2, 0.3, 0, 0, 0.1]))

    def force(c: np.ndarray) -> np.ndarray:
        return plain.water_model(second, balances_at(plain.model, second, c), c).force

    step, slope = (
        1e-4,
        plain.water_model(second, balances_at(plain.model, second, STREAM), STREAM).slope,
    )
    for k, e in enumerate(step * np.eye(2)):
        differences = (force(STREAM + e) - force(STREAM - e)) / (2.0 * step)
        assert differences == pytest.approx(slope[:, k], rel=0.01, abs=0.3)


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda vessel: vessel.name)
def test_the_rate_is_that_of_the_model(vessel) -> None:
    """∂ν̇/∂ν by the balance agrees with what a short run does."""
    model, h = Model.of(vessel), 1e-2
    second = next(seconds(1))
    na = model.actuator_count
    second = replace(second, commands=np.zeros(na))
    rate = Balance.of(balances_at(model, second, NO_CURRENT)).system_matrix[:3, :3]
    x0 = np.tile(second.motion[:6], (7, 1))
    x0[1:4, 3:] += 1e-3 * np.eye(3)
    x0[4:, 3:] -= 1e-3 * np.eye(3)
    _, reports = model.simulate(np.zeros((1, na)), h, x0)
    end = reports[:, 1, 3:6]
    numeric = ((end[1:4] - end[4:]).T / 2e-3 - np.eye(3)) / h
    assert numeric == pytest.approx(rate, rel=0.05, abs=0.05)


@pytest.mark.parametrize("speed", [0.0, 0.4])
def test_in_a_current_of_the_file_what_a_boat_does_goes_with_her_heading(speed: float) -> None:
    """An exact file with its current had alarms on 8 of 14 voyages: in turns a heading that is a
    little off is a velocity that is off.
    """
    vessel = WINDY.with_effects(AddedEffect(STEADY_CURRENT, {"speed": speed, "direction": 0.7}))
    model, h, step = Model.of(vessel), 1e-2, 1e-3
    na = model.actuator_count
    second = replace(next(seconds(1)), commands=np.zeros(na))
    matrix = Balance.of(balances_at(model, second, NO_CURRENT)).system_matrix
    x0 = np.tile(second.motion[:6], (2, 1))
    x0[0, 2] += step
    x0[1, 2] -= step
    _, reports = model.simulate(np.zeros((1, na)), h, x0)
    numeric = (reports[0, 1, 3:6] - reports[1, 1, 3:6]) / (2.0 * step * h)
    assert matrix[:3, 3] == pytest.approx(numeric, rel=0.05, abs=0.01)
    assert bool(np.abs(matrix[:3, 3]).max() > 0.02) is (speed > 0.0)
    assert matrix[3].tolist() == [0.0, 0.0, 1.0, 0.0]


def test_the_wind_is_that_of_the_catalogue() -> None:
    """What the air does is what a vessel with `steady_wind` no longer lacks."""
    air, second = WindModel.of(WINDY), next(seconds(1))
    wind = np.array([-6.0, 5.0])
    g = np.hypot(*wind) * wind
    assert air_velocity(g) == pytest.approx(wind)
    values = {"speed": float(np.hypot(*wind)), "direction": float(np.arctan2(-wind[1], -wind[0]))}
    blown = WINDY.with_effects(AddedEffect(STEADY_WIND, values))
    lacks = [balances_at(Model.of(v), second, NO_CURRENT)[0] for v in (WINDY, blown)]
    assert air.force(g, second) == pytest.approx(lacks[0] - lacks[1], rel=1e-9)


@pytest.mark.parametrize("turned", [0.0, 2.1])
def test_what_is_told_of_a_wind_spreads_as_winds_do_that_are_drawn(turned: float) -> None:
    """Its stated standard deviations against those of the force and the velocity of many draws."""
    air, second = WindModel.of(WINDY), next(seconds(1))
    motion = second.motion.copy()
    motion[2] += turned
    second = replace(second, motion=motion)
    g, covariance = np.array([-60.0, 35.0]), np.array([[9.0, -4.0], [-4.0, 25.0]])
    told = air.in_world(g, covariance, second)
    draws = np.random.default_rng(3).multivariate_normal(g, covariance, 4000)
    each = np.array([air.in_world(draw, covariance, second) for draw in draws])
    np.testing.assert_allclose(told[[0, 1, 4, 5]], each[:, [0, 1, 4, 5]].mean(axis=0), rtol=0.03)
    spreads = each[:, [0, 1, 4, 5]].std(axis=0)
    np.testing.assert_allclose(told[2:4], spreads[:2], rtol=0.08)  # a force needs no coefficient
    np.testing.assert_allclose(told[6:], np.hypot(spreads[2:], 0.1 * told[4:6]), rtol=0.08)
    diagonal = np.diag(air_velocity_covariance(g, covariance))
    np.testing.assert_allclose(np.sqrt(diagonal), told[6:], rtol=1e-9)


def test_a_filter_moves_as_kalmans_equations_and_scores_what_it_foresaw() -> None:
    """Against the information form, which shares no line with the gain and Joseph's form."""
    rng = np.random.default_rng(3)
    prior, later = rng.uniform(0.5, 1.0, BOAT_ERRORS), 2.0
    measured = MeasurementModel(rng.normal(size=(3, BOAT_ERRORS)), np.array([0.1, 0.2, -0.1]),
                                np.zeros((3, 0)))  # fmt: skip
    start = replace(DisturbanceFilter.start(prior), score=-4.0)
    force, variance = np.array([1.0, -0.5, 0.3]), np.array([0.5, 1.0, 2.0])
    after = start.updated(force, variance, measured, later)

    P, H = np.diag(prior**2 * (1.0 + later / BOAT_DRIFT_S)), measured.boat
    covariance = np.linalg.inv(np.linalg.inv(P) + H.T @ np.diag(1.0 / variance) @ H)
    mean = covariance @ H.T @ ((force - measured.force) / variance)
    np.testing.assert_allclose(after.covariance, covariance, atol=1e-12)
    np.testing.assert_allclose(after.mean, mean, atol=1e-12)
    S, m = H @ P @ H.T + np.diag(variance), force - measured.force
    seen = multivariate_normal(np.zeros(3), S).logpdf(m) + 1.5 * np.log(2.0 * np.pi)
    kept = -4.0 * np.exp(-later / SCORE_MEMORY_S)
    assert after.score == pytest.approx(kept + seen / SECONDS_PER_INDEPENDENT_SECOND)
    np.testing.assert_allclose(after.innovation, m / np.sqrt(np.diag(S)))


def test_an_outlier_is_a_measurement_with_as_much_more_noise_and_what_is_held_stays() -> None:
    rng = np.random.default_rng(4)
    measured = MeasurementModel(rng.normal(size=(3, BOAT_ERRORS)), np.zeros(3), np.zeros((3, 0)))
    start = replace(
        DisturbanceFilter.start(rng.uniform(0.5, 1.0, BOAT_ERRORS)),
        mean=rng.normal(size=BOAT_ERRORS),
    )
    force, R = np.array([90.0, -40.0, 30.0]), np.array([0.5, 1.0, 2.0])
    held = np.arange(BOAT_ERRORS) % 3 == 0
    after = start.updated(force, R, measured, 0.0, held)

    P, H = start.covariance, measured.boat
    m = force - H @ start.mean
    squared = m @ np.linalg.inv(H @ P @ H.T + np.diag(R)) @ m
    assert squared > 16.0
    wide = np.diag(R * squared / 16.0)
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + wide)
    gain[held] = 0.0
    np.testing.assert_allclose(after.mean, start.mean + gain @ m, rtol=1e-12)
    left = np.eye(BOAT_ERRORS) - gain @ H
    np.testing.assert_allclose(
        after.covariance, left @ P @ left.T + gain @ wide @ gain.T, rtol=1e-9
    )
    np.testing.assert_array_equal(after.mean[held], start.mean[held])
    noise = H @ P @ H.T + wide
    nats = -0.5 * (16.0 + np.log(np.linalg.det(noise))) / SECONDS_PER_INDEPENDENT_SECOND
    assert after.score == pytest.approx(nats)


def test_a_filter_weighs_an_outlier_less() -> None:
    start = DisturbanceFilter.start(np.ones(BOAT_ERRORS))
    plain = DisturbanceEstimator.of(Model.of(WAM_V))
    measured = plain.measured(plain.start(), next(seconds(1)), BOAT)
    R = np.ones(3)
    small = start.updated(np.array([1.0, 0.0, 0.0]), R, measured, 1.0)
    big = start.updated(np.array([1e4, 0.0, 0.0]), R, measured, 1.0)
    assert np.abs(big.mean).max() < 1e4 * np.abs(small.mean).max()
    assert np.linalg.eigvalsh(big.covariance).min() > 0.0
