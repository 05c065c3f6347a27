"""Commands that a radio samples are taken to change midway between two samples."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.samples import Quantity, Samples
from gateway.shadow import held_inputs


def pulses_at(times: list[float], values: list[float], tabular: bool, moments: list[float]) -> Any:
    """Samples of channel 1 at their times [s] -> what holds at other moments."""
    time_ns = np.array([round(1e9 * t) for t in times])
    pulses = np.tile(np.array(values)[:, np.newaxis], (1, 32))
    samples = Samples(
        Quantity.ACTUATORS, "SERVO_OUTPUT_RAW", np.arange(len(times)), time_ns, time_ns, pulses
    )
    decoded: Any = SimpleNamespace(tabular=tabular, of=lambda quantity: [samples])
    choices: Any = {"commands": SimpleNamespace(samples=samples)}
    return held_inputs(decoded, choices, 0).pulses.at(np.array(moments))[:, 0].tolist()


def test_a_command_changes_midway_between_two_samples() -> None:
    """Held from its own moment on it came late by half the time between them."""
    found = pulses_at([0.0, 0.2, 0.4], [1500.0, 1500.0, 1900.0], False, [0.29, 0.31, 0.5])
    assert found == [1500.0, 1900.0, 1900.0]


def test_after_a_gap_a_command_holds_from_its_own_moment() -> None:
    assert pulses_at([0.0, 5.0], [1500.0, 1900.0], False, [4.9, 5.1]) == [1500.0, 1900.0]


def test_a_row_of_a_table_holds_from_its_time_on() -> None:
    assert pulses_at([0.0, 0.2], [1500.0, 1900.0], True, [0.19, 0.21]) == [1500.0, 1900.0]


def test_steps_of_a_command_are_late_by_nothing_in_the_mean() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 400.0, 0.2)
    changes = np.sort(rng.uniform(5.0, 395.0, 40))
    values = 1500.0 + np.searchsorted(changes, times, side="right")
    fine = np.arange(0.0, 399.0, 0.01)
    found = np.array(pulses_at(times.tolist(), values.tolist(), False, fine.tolist()))
    seen = [fine[np.argmax(found >= 1501.0 + k)] for k in range(40)]
    assert np.mean(seen - changes) == pytest.approx(0.0, abs=0.03)
