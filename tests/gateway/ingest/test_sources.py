"""One source per quantity: preferred, unless full of gaps or slow."""

import numpy as np

from gateway.ingest.sources import PRIORITY, choose, rate_hz
from gateway.samples import Quantity, Samples


def samples(quantity: Quantity, source: str, time_s: np.ndarray) -> Samples:
    time_ns = np.round(time_s * 1e9).astype(np.int64)
    order = np.arange(len(time_s))
    return Samples(quantity, source, order, time_ns, time_ns, np.zeros((len(time_s), 2)))


def steady(source: str, rate: float, seconds: float = 100.0) -> Samples:
    return samples(Quantity.VELOCITY, source, np.arange(0.0, seconds, 1.0 / rate))


def test_the_preferred_source_wins_over_a_faster_one() -> None:
    choice = choose([steady("VFR_HUD", 10.0), steady("LOCAL_POSITION_NED", 3.0)])["velocity"]
    assert choice.source == "LOCAL_POSITION_NED"
    assert round(choice.rate_hz, 3) == 3.0


def test_a_source_that_covers_half_the_log_gives_way_with_its_reason() -> None:
    half = steady("LOCAL_POSITION_NED", 5.0, seconds=50.0)
    choice = choose([half, steady("GLOBAL_POSITION_INT", 5.0)])["velocity"]
    assert choice.source == "GLOBAL_POSITION_INT"
    assert "LOCAL_POSITION_NED covers 50 s of 100 s" in choice.why


def test_a_source_that_is_far_too_slow_gives_way() -> None:
    slow = steady("LOCAL_POSITION_NED", 0.6)
    choice = choose([slow, steady("GLOBAL_POSITION_INT", 5.0)])["velocity"]
    assert choice.source == "GLOBAL_POSITION_INT"
    assert "0.6 Hz only" in choice.why


def test_a_poor_source_is_better_than_none() -> None:
    choice = choose([steady("GPS_RAW_INT", 0.2)])["velocity"]
    assert choice.source == "GPS_RAW_INT"


def test_rate_does_not_count_gaps() -> None:
    time = np.concatenate([np.arange(0.0, 10.0, 0.1), np.arange(60.0, 70.0, 0.1)])
    assert round(rate_hz(samples(Quantity.YAW, "ATTITUDE", time)), 6) == 10.0


def test_rate_of_uneven_steps_is_how_many_come_in_a_second() -> None:
    """As ArduRover sends at 40 Hz what its loop has at 50 Hz: every fifth is left out."""
    loops = np.arange(0.0, 20.0, 0.02)
    sent = loops[np.arange(len(loops)) % 5 != 4]
    assert round(rate_hz(samples(Quantity.YAW, "ATTITUDE", sent)), 1) == 40.0


def test_absent_quantities_have_no_source() -> None:
    assert set(choose([steady("XKF1", 10.0)])) == {"velocity"}


def test_a_quantity_lists_each_source_once() -> None:
    for name, candidates in PRIORITY.items():
        assert len(set(candidates)) == len(candidates), name


def receiver(source: str, order: list[int], fixes: list[float]) -> Samples:
    at = np.array(order)
    return Samples(Quantity.FIX, source, at, at, at, np.array(fixes)[:, None])


def test_the_best_fix_of_all_receivers_counts() -> None:
    """A boat whose first receiver is broken was refused whole: "no 3-D fix"."""
    first = receiver("GPS_RAW_INT", [1, 3, 5, 7], [1.0, 1.0, 1.0, 4.0])
    second = receiver("GPS2_RAW", [2, 4, 6], [3.0, 3.0, 0.0])
    fix = choose([first, second])["fix"]
    assert fix.source == "GPS_RAW_INT"
    assert fix.samples.order.tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert fix.samples.values[:, 0].tolist() == [1.0, 3.0, 3.0, 3.0, 3.0, 1.0, 4.0]
    assert choose([first])["fix"].samples is first
