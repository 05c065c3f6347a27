"""What open moments of commands do to the motion."""

from dataclasses import replace

import numpy as np

from sim.identification.noise import (
    Noise,
    RunErrors,
    apply_whitener,
    estimate_noise,
    timing_whitener,
    whitened,
)
from sim.identification.runs import RunRows, command_timing_covariance
from sim.model import Model
from sim.prediction.inputs import measured_motion
from tests.sim.voyages import WAM_V, simulated

DT, EVERY, MEANS = 0.1, 4, 12
TOLD = 0.04  # s between messages


def stepped(late: np.ndarray) -> np.ndarray:
    """Commands that jump each 0.8 s, each jump late by so much [s]: means over 0.1 s (T, 2)."""
    fine = 0.001 * np.arange(EVERY * MEANS * 100)
    jumps = np.arange(0.45, fine[-1], 0.8)
    values = np.random.default_rng(1).uniform(-0.5, 0.9, (len(jumps) + 1, 2))
    level = np.searchsorted(jumps + late[: len(jumps)], fine, side="right")
    return values[level].reshape(-1, 100, 2).mean(axis=1)


def covariance_of(drive: np.ndarray) -> np.ndarray:
    model = Model.of(WAM_V)
    _, reports = model.simulate(drive, DT)
    trial = replace(
        simulated(WAM_V, len(drive) * DT, DT), nu=reports[0, :-1, 3:6], eta=reports[0, :-1, :3],
        nu_dot=reports[0, :-1, 6:9], pwm=1500.0 + 400.0 * drive, rates_hz={"commands": 1.0 / TOLD},
    )  # fmt: skip
    tiles = RunRows(np.array([0]), np.array([len(drive)]))
    found = command_timing_covariance(trial, model, tiles, EVERY, MEANS, measured_motion(trial))
    assert found is not None
    return found[0].reshape(MEANS, 3, MEANS, 3)


def test_the_covariance_is_that_of_jumps_at_random_moments():
    model, rng = Model.of(WAM_V), np.random.default_rng(2)
    late = rng.uniform(-0.5 * TOLD, 0.5 * TOLD, (300, 20))
    drives = [stepped(one) for one in late]
    means = np.array([
        model.simulate(drive, DT)[1][0, :-1, 3:6].reshape(MEANS, EVERY, 3).mean(axis=1)
        for drive in drives
    ])  # fmt: skip
    seen = means.std(axis=0)
    told = np.sqrt(np.einsum("iaia->ia", covariance_of(stepped(np.zeros(20)))))
    for channel in (0, 2):  # sway is not pushed by these motors
        share = told[2:, channel].mean() / seen[2:, channel].mean()
        assert 0.5 < share < 1.3


def test_nothing_is_added_where_commands_stand_still_or_their_rate_is_not_known():
    held = np.full((EVERY * MEANS, 2), 0.4)
    assert covariance_of(held)[1:].max() < 1e-8
    trial = simulated(WAM_V, 20.0, DT)
    tiles = RunRows(np.array([0]), np.array([48]))
    assert (
        command_timing_covariance(
            trial, Model.of(WAM_V), tiles, EVERY, MEANS, measured_motion(trial)
        )
        is None
    )


def drawn(jolt: float, runs: int = 60, seed: int = 3) -> tuple[RunErrors, Noise]:
    """Errors of known noise, and jolts of known size."""
    rng = np.random.default_rng(seed)
    noise = Noise(np.array([0.02, 0.02, 0.001]), np.array([0.8, 0.8, 0.4]), jolt)
    U = covariance_of(stepped(np.zeros(20))).reshape(3 * MEANS, 3 * MEANS)
    shocks = rng.normal(size=(runs, MEANS, 3))
    error = shocks.copy()
    for k in range(1, MEANS):
        error[:, k] = noise.rho * error[:, k - 1] + np.sqrt(1.0 - noise.rho**2) * shocks[:, k]
    error *= noise.sigma
    values, vectors = np.linalg.eigh(U)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    error += jolt * (rng.normal(size=(runs, 3 * MEANS)) @ root.T).reshape(runs, MEANS, 3)
    phi = np.exp(-0.5 * np.arange(MEANS))[None, :, None, None] * np.eye(3)
    within = np.ones((runs, MEANS))
    return RunErrors(error, np.tile(phi, (runs, 1, 1, 1)), within, np.tile(U, (runs, 1, 1))), noise


def test_whitened_and_mixed_rows_are_independent_and_of_unit_size():
    e, noise = drawn(2.0, runs=4000)
    rows = apply_whitener(whitened(e.error, noise), timing_whitener(e, noise)[0]).reshape(4000, -1)
    covariance = rows.T @ rows / 4000
    np.testing.assert_allclose(covariance, np.eye(3 * MEANS), atol=0.12)


def test_likelihood_tells_jolts_from_a_noisy_gyro():
    for jolt in (0.0, 1.0):
        e, noise = drawn(jolt)
        start = Noise(np.array([0.02, 0.02, 0.003]), np.full(3, 0.5))
        found = start
        for _ in range(25):  # a round of shooting each
            found = estimate_noise(e, EVERY * DT, found)
        assert abs(found.command_timing - jolt) <= 0.3
        assert abs(found.sigma[2] / noise.sigma[2] - 1.0) < 0.25
