"""Command timing: its covariance, its whitening, and shifts by part of a row that stay sharp."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification.noise import (
    Noise,
    RunErrors,
    apply_whitener,
    command_timing_covariance,
    estimate_noise,
    sharpened_commands,
    sharpening_factor,
    timing_whitener,
    whitened,
)
from sim.model import InputTable, Model
from sim.prediction import measured_motion
from tests.sim.voyages import WAM_V, simulated

DT, EVERY, MEANS = 0.1, 4, 12
MESSAGE_S = 0.04  # between messages


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
        nu_dot=reports[0, :-1, 6:9], pwm=1500.0 + 400.0 * drive,
        rates_hz={"commands": 1.0 / MESSAGE_S},
    )  # fmt: skip
    first, motion = np.array([0]), measured_motion(trial)
    covariance = command_timing_covariance(trial, model, first, EVERY, MEANS, motion)
    assert covariance is not None
    return covariance[0].reshape(MEANS, 3, MEANS, 3)


def test_the_covariance_is_that_of_jumps_at_random_times():
    model, rng = Model.of(WAM_V), np.random.default_rng(2)
    late = rng.uniform(-0.5 * MESSAGE_S, 0.5 * MESSAGE_S, (300, 20))
    drives = [stepped(one) for one in late]
    means = np.array([
        model.simulate(drive, DT)[1][0, :-1, 3:6].reshape(MEANS, EVERY, 3).mean(axis=1)
        for drive in drives
    ])  # fmt: skip
    seen = means.std(axis=0)
    expected = np.sqrt(np.einsum("iaia->ia", covariance_of(stepped(np.zeros(20)))))
    for channel in (0, 2):  # sway is not pushed by these motors
        share = expected[2:, channel].mean() / seen[2:, channel].mean()
        assert 0.5 < share < 1.3


def test_nothing_is_added_where_commands_stand_still_or_their_rate_is_not_known():
    constant = np.full((EVERY * MEANS, 2), 0.4)
    assert covariance_of(constant)[1:].max() < 1e-8
    trial, model = simulated(WAM_V, 20.0, DT), Model.of(WAM_V)
    first, motion = np.array([0]), measured_motion(trial)
    assert command_timing_covariance(trial, model, first, EVERY, MEANS, motion) is None


def drawn(timing: float, runs: int = 60, seed: int = 3) -> tuple[RunErrors, Noise]:
    """Errors of known noise, and command timing of known size."""
    rng = np.random.default_rng(seed)
    noise = Noise(np.array([0.02, 0.02, 0.001]), np.array([0.8, 0.8, 0.4]), timing)
    U = covariance_of(stepped(np.zeros(20))).reshape(3 * MEANS, 3 * MEANS)
    shocks = rng.normal(size=(runs, MEANS, 3))
    error = shocks.copy()
    for k in range(1, MEANS):
        error[:, k] = noise.rho * error[:, k - 1] + np.sqrt(1.0 - noise.rho**2) * shocks[:, k]
    error *= noise.sigma
    values, vectors = np.linalg.eigh(U)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    error += timing * (rng.normal(size=(runs, 3 * MEANS)) @ root.T).reshape(runs, MEANS, 3)
    phi = np.exp(-0.5 * np.arange(MEANS))[None, :, None, None] * np.eye(3)
    within = np.ones((runs, MEANS))
    return RunErrors(error, np.tile(phi, (runs, 1, 1, 1)), within, np.tile(U, (runs, 1, 1))), noise


def test_whitened_rows_are_independent_and_of_unit_size():
    e, noise = drawn(2.0, runs=4000)
    rows = apply_whitener(whitened(e.error, noise), timing_whitener(e, noise)[0]).reshape(4000, -1)
    covariance = rows.T @ rows / 4000
    np.testing.assert_allclose(covariance, np.eye(3 * MEANS), atol=0.12)


@pytest.mark.slow
def test_likelihood_tells_command_timing_from_a_noisy_gyro():
    for timing in (0.0, 1.0):
        e, noise = drawn(timing)
        start = Noise(np.array([0.02, 0.02, 0.003]), np.full(3, 0.5))
        found = start
        for _ in range(25):  # a round of shooting each
            found = estimate_noise(e, EVERY * DT, found)
        assert abs(found.command_timing - timing) <= 0.3
        assert abs(found.sigma[2] / noise.sigma[2] - 1.0) < 0.25


def shifted(total: np.ndarray, rows: float) -> np.ndarray:
    """Means of each row of commands that act so much later, as a model takes them."""
    grid = np.arange(len(total), dtype=float)
    return np.diff(np.interp(grid - rows, grid, total))[: len(total) - 5]  # the end is cut


def spread(commands: np.ndarray) -> float:
    """Variance in time of where a step happens [rows²]."""
    change = np.diff(commands)
    row = np.arange(len(change))
    return float(np.sum(change * row**2) - np.sum(change * row) ** 2)


@pytest.mark.parametrize("shift", [-0.029, 0.02, 0.05, 0.13])
def test_a_shifted_step_is_no_wider_than_it_was(shift):
    step = np.repeat([0.0, 1.0], 20)[None, :, None]
    table = InputTable.of(step, DT)
    sharp = sharpened_commands(table, sharpening_factor(shift, DT))
    moved = shifted(sharp.total[0, :, 0], shift / DT)
    assert spread(shifted(table.total[0, :, 0], shift / DT)) > 0.1
    assert spread(moved) == pytest.approx(0.0, abs=1e-9)
    row = np.sum(np.diff(moved) * np.arange(len(moved) - 1))
    assert row == pytest.approx(19.0 + shift / DT)


def test_without_a_shift_nothing_changes():
    table = InputTable.of(np.random.default_rng(1).normal(size=(1, 30, 2)), DT)
    for shift, tolerance in ((0.0, 0.0), (DT, 1e-9)):
        sharp = sharpened_commands(table, sharpening_factor(shift, DT))
        np.testing.assert_allclose(sharp.total, table.total, atol=tolerance)
