"""The small blind set, whole: sailed, diagnosed and scored as the program does it."""

import pytest

from benchmarks.hidden import score
from benchmarks.hidden.__main__ import chosen, main
from benchmarks.hidden.score import SINGLE, rows_of


@pytest.mark.slow
def test_most_of_the_small_set_is_diagnosed_right(tmp_path):
    pytest.importorskip("gateway.offline.diagnose")
    assert main(["--set", "small", "--no-judge", "--out", str(tmp_path)]) == 0
    rows = rows_of(tmp_path, [case.name for case in chosen("small", "", "", 0)])
    by = {family: [r for r in rows if r.truth["family"] == family] for family in (*SINGLE, "none")}
    assert len(rows) == len(chosen("small", "", "", 0))
    assert not [r.truth["name"] for r in rows if r.verdict == "failed"]
    single = [row for family in SINGLE for row in by[family]]
    # few cases: one or two below what is asked for of the whole set
    assert score.share(single, score.with_confounded) >= 0.8
    assert score.share(by["none"], score.alarm) <= 0.2


def test_part_of_a_set_can_be_chosen():
    whole = chosen("reporting", "", "", 0)
    assert chosen("reporting", "mission", "", 0) == [c for c in whole if c.family == "mission"]
    assert len(chosen("reporting", "", "", 5)) == 5
    lag = chosen("reporting", "", "thruster_lag", 0)
    assert lag
    assert all(any("thruster_lag" in h.name for h in c.voyage.hidden) for c in lag)
    assert [c.name for c in chosen("reporting", "", "reporting-007", 0)] == ["reporting-007"]
