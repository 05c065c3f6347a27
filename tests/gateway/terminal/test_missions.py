"""Words about two passages: each is said where its numbers are so, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.terminal.comparison import mission_sentences
from sim.comparison.missions import MissionComparison, Parting, Passage

ALONG = np.linspace(0.0, 100.0, 801)


def straight(name: str, pulse: float = 1600.0) -> Passage:
    pulses = np.where(np.arange(801) % 2, pulse, pulse + 20.0)
    return Passage(name, ALONG, ALONG, 0.0 * ALONG, 0.0 * ALONG, {1: pulses})


SAME = MissionComparison(
    straight("boat"), straight("loop"), ALONG, ALONG, 0.0 * ALONG, 0.0 * ALONG, 2.0, ()
)


def said(**changes: object) -> str:
    return "\n".join(mission_sentences(replace(SAME, **changes)))  # type: ignore[arg-type]


def test_nothing_is_said_to_differ_where_nothing_does():
    text = said()
    assert "they do not part: never more than 2.0 m" in text
    assert "never more than 1 s from one another at the same place" in text
    assert "hardly the same mission" not in text
    assert "output" not in text


def test_a_parting_is_told_with_place_side_and_turn():
    parting = Parting(30.0, 45.0, 31.0, 3.5, 0.0)
    text = said(partings=(parting,))
    assert "they part 30 m from the start, after 31 s, on a straight leg: over 15 m" in text
    assert "more than 2.0 m to starboard, at most 3.5 m" in text
    assert "do not part" not in text
    assert "to port, at most 3.5 m" in said(partings=(replace(parting, gap=-3.5),))
    assert "in a turn to port" in said(partings=(replace(parting, turning=-0.2),))
    assert "and 2 more times" in said(partings=(parting,) * 5)


@pytest.mark.parametrize(
    ("lag", "expected"),
    [
        (0.05 * ALONG, "5.0 s later; at most 5.0 s apart at the same place"),
        (-0.05 * ALONG, "5.0 s earlier"),
        (np.interp(ALONG, [0, 40, 50, 100], [0, 0, 6, 6]), "it loses 6.0 s between 38 and 50 m"),
        (np.interp(ALONG, [0, 50, 100], [0, 4, 0]), "both come to the end within a second"),
    ],
)
def test_a_lag_is_told_with_where_it_came_from(lag, expected):
    assert expected in said(lag=lag)


def test_a_steady_lag_comes_from_no_one_stretch():
    assert "it loses" not in said(lag=0.05 * ALONG)


def test_outputs_and_another_mission():
    assert "output 1: 1610 µs in the mean on the boat, 1660 µs in the loop" in said(
        second=straight("loop", 1650.0)
    )
    assert "hardly the same mission: half of the track lies more than 40 m" in said(
        gap=0.0 * ALONG + 40.0
    )
