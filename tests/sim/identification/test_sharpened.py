"""A shift by part of a row must not make commands rounder."""

import numpy as np
import pytest

from sim.identification.runs import sharpened_commands, sharpening_factor
from sim.model import InputTable

DT = 0.1


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
    ours = sharpened_commands(table, sharpening_factor(shift, DT))
    moved = shifted(ours.total[0, :, 0], shift / DT)
    assert spread(shifted(table.total[0, :, 0], shift / DT)) > 0.1
    assert spread(moved) == pytest.approx(0.0, abs=1e-9)
    row = np.sum(np.diff(moved) * np.arange(len(moved) - 1))
    assert row == pytest.approx(19.0 + shift / DT)


def test_without_a_shift_nothing_changes():
    table = InputTable.of(np.random.default_rng(1).normal(size=(1, 30, 2)), DT)
    np.testing.assert_allclose(
        sharpened_commands(table, sharpening_factor(0.0, DT)).total, table.total
    )
    np.testing.assert_allclose(
        sharpened_commands(table, sharpening_factor(DT, DT)).total, table.total, atol=1e-9
    )
