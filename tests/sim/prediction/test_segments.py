"""Usable time, cut with guards."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.prediction.segments import time_blocks, usable_stretches


def test_stretches_are_the_runs_of_usable_rows():
    assert usable_stretches(np.array([1, 1, 0, 0, 1, 0, 1], bool)) == [(0, 2), (4, 5), (6, 7)]
    assert usable_stretches(np.zeros(4, bool)) == []


@given(
    runs=st.lists(st.integers(1, 900), min_size=1, max_size=8),
    dt=st.sampled_from([0.05, 0.1, 0.25]),
    guard=st.sampled_from([5.0, 7.3]),
)
def test_blocks_are_usable_and_a_guard_apart(runs, dt, guard):
    usable = np.concatenate([np.full(n, i % 2 == 0) for i, n in enumerate(runs)])
    found = time_blocks(usable, dt, length=20.0, guard=guard)
    for block in found:
        assert usable[block.start : block.stop].all()
        assert len(block) * dt >= 10.0 - dt
    for before, after in pairwise(found):
        assert (after.start - before.stop) * dt >= guard - 1e-9


def test_a_long_stretch_is_used_but_for_the_guards():
    found = time_blocks(np.ones(12000, bool), 0.05, length=25.0)
    assert len(found) == 20
    assert sum(map(len, found)) * 0.05 == pytest.approx(600.0 - 19 * 5.0, abs=1.0)


def test_what_is_too_short_gives_no_block():
    assert time_blocks(np.ones(100, bool), 0.05, length=25.0) == []
