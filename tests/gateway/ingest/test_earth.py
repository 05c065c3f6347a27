"""Degrees and metres."""

import numpy as np
import pytest

from gateway.ingest.mapping import Origin, to_degrees, to_local


def test_a_minute_of_latitude_is_about_a_mile() -> None:
    north, east = to_local(np.array([45.0 + 1 / 60, 10.0]), Origin(45.0, 10.0))
    assert north == pytest.approx(1852.2, abs=0.5)
    assert east == 0.0


def test_a_degree_of_longitude_as_tables_have_it() -> None:
    _, east = to_local(np.array([60.0, 11.0]), Origin(60.0, 10.0))
    assert east == pytest.approx(55_800.0, abs=1.0)


def test_there_and_back_also_across_the_date_line() -> None:
    origin = Origin(-17.0, 179.999)
    metres = np.array([[100.0, 500.0], [-3.0, 7.0]])
    degrees = to_degrees(metres, origin)
    degrees[:, 1] = (degrees[:, 1] + 180.0) % 360.0 - 180.0
    assert to_local(degrees, origin) == pytest.approx(metres, abs=1e-6)
