"""Which name was meant by one that nobody knows."""

import pytest

from sim.near_names import did_you_mean

KNOWN = ("m11", "m22", "X_uu", "left.ahead", "right.ahead", "steady_wind", "steady_current")


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("steady_wnd", "steady_wind"),
        ("lefft.ahead", "left.ahead"),
        ("STEADY_WIND", "steady_wind"),
        ("x_uu", "X_uu"),
        ("m33", ""),
        ("tide", ""),
        ("", ""),
    ],
)
def test_the_name_with_a_letter_wrong_is_named_and_no_other(name: str, meant: str) -> None:
    assert did_you_mean(name, KNOWN) == (f"did you mean {meant}? " if meant else "")


def test_two_that_are_as_near_are_both_named() -> None:
    assert did_you_mean("m12", KNOWN) == "did you mean m11 or m22? "


def test_where_nothing_is_known_nothing_was_meant() -> None:
    assert did_you_mean("tide", ()) == ""
