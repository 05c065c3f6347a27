"""The filter that ties short runs: against the covariance of all errors, written out whole."""

import numpy as np
import pytest

from sim.identification.innovations import (
    START_SIGMAS,
    Chain,
    chain_of,
    estimate_chain_noise,
    follows_of,
)
from sim.identification.noise import Noise, RunErrors
from sim.state import Floats

COUNT = np.array([3, 2, 3, 1, 3])  # means in each run
FOLLOWS = np.array([1.0, 1.0, 0.0, 1.0, 0.0])
NOISE = Noise(np.array([0.02, 0.03, 0.004]), np.array([0.7, 0.5, 0.2]))
PROCESS = np.array([0.01, 0.02, 0.003])
MEAN_S = 0.4


def runs(timing: bool) -> RunErrors:
    """Five runs of up to three means; the last entry of each is the gap to the next."""
    draw = np.random.default_rng(4)
    within = (np.arange(3) < COUNT[:, None]).astype(float)
    counted = np.concatenate([within, FOLLOWS[:, None]], axis=1)[..., None]
    error = draw.normal(size=(5, 4, 3)) * 0.03 * counted
    phi = (np.eye(3) + 0.4 * draw.normal(size=(5, 4, 3, 3))) * counted[..., None]
    root = draw.normal(size=(5, 12, 12)) * 0.01
    return RunErrors(error, phi, within, root @ np.swapaxes(root, 1, 2) if timing else None)


def dense(e: RunErrors, noise: Noise) -> tuple[Floats, Floats]:
    """Errors less their mean (N,) and their covariance (N, N), all runs at once."""
    sources: list[Floats] = []  # each independent cause: what it does to every error (S, n, 3)
    mean = np.zeros((5, 3, 3))
    m = np.zeros(3)
    for k in range(5):
        mean[k] = e.phi[k, :3] @ m
        m = e.phi[k, 3] @ m - e.error[k, 3] if FOLLOWS[k] else np.zeros(3)

    def from_start(k: int, d: Floats) -> Floats:
        out = np.zeros((5, 3, 3))
        while True:
            out[k] = e.phi[k, :3] @ d
            if not FOLLOWS[k] or k == 4:
                return out
            d, k = e.phi[k, 3] @ d, k + 1

    for k in range(5):
        for i in range(3):
            unit = np.eye(3)[i]
            if k == 0 or not FOLLOWS[k - 1]:
                sources.append(from_start(k, START_SIGMAS * noise.sigma[i] * unit))
            if FOLLOWS[k]:
                w = PROCESS[i] * np.sqrt(MEAN_S * COUNT[k]) * unit
                sources.append(from_start(k + 1, w))
        if e.timing_covariance is not None:
            U = noise.command_timing**2 * e.timing_covariance[k].reshape(4, 3, 4, 3)
            kept = [*range(COUNT[k]), COUNT[k]]
            U = U[kept][:, :, kept].reshape(3 * len(kept), -1)
            for column in np.linalg.cholesky(U + 1e-16 * np.eye(len(U))).T:
                push = column.reshape(-1, 3)
                out = from_start(k + 1, push[-1]) if FOLLOWS[k] else np.zeros((5, 3, 3))
                out[k, : COUNT[k]] += push[:-1]
                sources.append(out)
    C = sum(np.einsum("kji,lmn->kjilmn", s, s) for s in sources)
    chain, step = 0, 0
    places = {}
    for k in range(5):
        for j in range(COUNT[k]):
            places[k, j] = chain, step
            step += 1
        chain += not FOLLOWS[k]
    for (k, j), (a, s) in places.items():
        for (q, i), (b, t) in places.items():
            if a == b:
                C[k, j, :, q, i] += np.diag(noise.sigma**2 * noise.rho ** abs(s - t))
    counted = np.repeat(e.within, 3, axis=1).reshape(-1) > 0
    return ((e.error[:, :3] - mean).reshape(-1)[counted], C.reshape(45, 45)[counted][:, counted])


@pytest.mark.parametrize("timing", [0.0, 0.7])
def test_innovations_are_the_likelihood_of_all_errors(timing: float) -> None:
    """Squares and determinant are those of the whole covariance."""
    noise, e = NOISE._replace(command_timing=timing), runs(timing > 0.0)
    left, C = dense(e, noise)
    chain = Chain.of(e, noise, FOLLOWS, PROCESS, MEAN_S)
    white = chain.whitened(e.error[None])[0]
    assert np.sum(white**2) == pytest.approx(left @ np.linalg.solve(C, left), rel=1e-6)
    clipped = np.sum(np.clip(white, -5.0, 5.0) ** 2)
    assert chain.deviance - clipped == pytest.approx(np.linalg.slogdet(C)[1], rel=1e-6)


def test_the_likelihood_of_the_noise_found_is_that_of_its_filter() -> None:
    """The recursion runs over the same arrays for each noise that is tried: nothing is left in."""
    e = runs(True)
    noise, deviance = estimate_chain_noise(e, FOLLOWS, NOISE.sigma, MEAN_S)
    assert chain_of(e, noise, FOLLOWS, NOISE.sigma, MEAN_S).deviance == deviance


def test_innovations_are_linear_in_the_errors() -> None:
    """Several errors at once, and their sum."""
    e = runs(True)
    chain = Chain.of(e, NOISE._replace(command_timing=1.0), FOLLOWS, PROCESS, MEAN_S)
    other = np.random.default_rng(1).normal(size=e.error.shape)
    each = chain.whitened(np.stack([e.error, other, e.error + 2.0 * other]))
    assert each[2] == pytest.approx(each[0] + 2.0 * each[1])


def test_an_outlier_in_one_run_does_not_reach_far() -> None:
    """What a free run would carry on, the filter forgets within a few runs."""
    S, n = 60, 3
    A = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.8], [0.0, 0.8, 1.0]])  # unstable: 1.8 a run
    phi = np.broadcast_to(A, (S, n + 1, 3, 3)).copy()
    follows = np.append(np.ones(S - 1), 0.0)
    errors = RunErrors(np.zeros((S, n + 1, 3)), phi, np.ones((S, n)))
    chain = Chain.of(errors, NOISE, follows, PROCESS, 0.2)
    pushed = np.zeros((1, S, n + 1, 3))
    pushed[0, 10, n] = 0.5
    white = np.abs(chain.whitened(pushed)[0]).max(axis=(1, 2))
    assert white[:11].max() == 0.0
    assert white[11] > 5.0
    assert white[25:].max() < 0.01 * white[11]


def test_runs_follow_each_other_where_no_row_lies_between() -> None:
    """The last run has none to follow it."""
    first, size = np.array([0, 8, 20, 24]), np.array([8, 10, 4, 4])
    assert follows_of(first, size).tolist() == [1.0, 0.0, 1.0, 0.0]


def test_what_swings_is_white_once_its_colour_is_out() -> None:
    """Innovations of a resonance, in two stretches: its two numbers are found, and its spread."""
    S, n, mean_s = 2000, 5, 0.4
    follows = np.ones(S)
    follows[[S // 2, S - 1]] = 0.0
    errors = RunErrors(np.zeros((S, n + 1, 3)), np.zeros((S, n + 1, 3, 3)), np.ones((S, n)))
    chain = Chain.of(errors, NOISE, follows, PROCESS, mean_s)
    new = np.random.default_rng(3).normal(0.0, 0.5, (S * n, 3))
    swinging = new.copy()
    for k in range(2, S * n):
        swinging[k] += 1.2 * swinging[k - 1] - 0.9 * swinging[k - 2]
    coloured = chain.coloured(swinging, mean_s)
    assert coloured.colour is not None
    assert coloured.colour.a[:2] == pytest.approx(np.tile([[1.2], [-0.9]], 3), abs=0.06)
    assert coloured.colour.a[2:] == pytest.approx(np.zeros((4, 3)), abs=0.06)
    assert coloured.colour.scale == pytest.approx(0.5 * np.ones(3), rel=0.05)
    pushed = np.random.default_rng(4).normal(size=(2, S, n + 1, 3))
    plain, left = chain.whitened(pushed).reshape(2, -1, 3), coloured.whitened(pushed)
    left = left.reshape(2, -1, 3) * coloured.colour.scale
    first = (S // 2 + 1) * n  # of the second stretch: nothing before it tells of it
    assert left[:, first] == pytest.approx(plain[:, first])
    assert left[:, first + 1] == pytest.approx(
        plain[:, first + 1] - coloured.colour.a[0] * plain[:, first]
    )


def test_a_colour_is_worth_what_the_likelihood_says() -> None:
    """Of a resonance that turns a standard deviation of 0.5 into that of the innovations; of white
    innovations no more than its eighteen numbers fit by chance.
    """
    S, n, mean_s = 2000, 5, 0.4
    errors = RunErrors(np.zeros((S, n + 1, 3)), np.zeros((S, n + 1, 3, 3)), np.ones((S, n)))
    chain = Chain.of(errors, NOISE, np.append(np.ones(S - 1), 0.0), PROCESS, mean_s)
    white = np.random.default_rng(3).normal(0.0, 1.0, (S * n, 3))
    assert -60.0 < chain.won_by_colour(white, mean_s) < 60.0
    swinging = 0.3 * white
    for k in range(2, S * n):
        swinging[k] += 1.2 * swinging[k - 1] - 0.9 * swinging[k - 2]
    expected = white.size * (1.0 + 2.0 * np.log(0.3)) - np.sum(swinging**2)
    assert chain.won_by_colour(swinging, mean_s) == pytest.approx(expected, rel=0.02)


def test_errors_without_a_covariance_are_an_error_and_no_numbers() -> None:
    """What command timing is said to add may be no covariance at all; NaN would go on unseen."""
    e = runs(True)
    assert e.timing_covariance is not None
    none = e._replace(timing_covariance=-e.timing_covariance * 1e6)
    with pytest.raises(np.linalg.LinAlgError):
        Chain.of(none, NOISE._replace(command_timing=1.0), FOLLOWS, PROCESS, MEAN_S)
