"""The table of wear in words."""

import pytest

from gateway.terminal.fleet import scatter_text


@pytest.mark.parametrize(
    ("scatter", "says"), [(0.0, "none"), (1.8e-6, "none"), (0.0024, "none"), (0.013, "0.013")]
)
def test_a_scatter_of_nothing_is_told_as_none(scatter: float, says: str) -> None:
    """1.8e-06 N of 2.6 N was told of a course that its intervals explain."""
    assert scatter_text(scatter, 2.6) == says
