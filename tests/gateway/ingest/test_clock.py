"""Boat time: none of wrap, reboot, late, duplicate and stepping receipt may corrupt it."""

import numpy as np
import pytest

from gateway.ingest.clock import BoatClock, StampStatus
from gateway.ingest.mapping import Counter

START = 1_700_000_000_000_000_000
MS, US, US32, SAMPLE, NONE = (
    Counter.BOOT_MS,
    Counter.BOOT_US,
    Counter.BOOT_US32,
    Counter.SAMPLE_US,
    Counter.RECEIPT,
)


class Link:
    """A clock, and what it says about messages given in seconds."""

    def __init__(self) -> None:
        self.clock = BoatClock(streams=4)

    def say(
        self, boot_s: float, receipt_s: float, counter: Counter = MS, stream: int = 0
    ) -> tuple[float, StampStatus]:
        """Boot time as its counter shows it, and receipt -> vehicle time [s after START]."""
        wrap = {MS: 2**32 * 1000, US32: 2**32}.get(counter, 2**63)
        shown = round(boot_s * 1e6) % wrap if counter is not NONE else 0
        vehicle, verdict = self.clock.stamp(stream, counter, shown, START + round(receipt_s * 1e9))
        return (vehicle - START) * 1e-9, verdict

    def run(self, boot_s: float, receipt_s: float, seconds: float, step: float = 0.1) -> None:
        """A steady stream of timed messages."""
        for t in np.arange(0.0, seconds, step):
            self.say(boot_s + t, receipt_s + t)


def test_vehicle_time_advances_with_boot_time_whatever_the_delay_of_receipt() -> None:
    link = Link()
    delays = [0.05, 0.01, 0.4, 0.02, 5.7, 5.6, 0.01]
    times = [link.say(10.0 + k, k + delay)[0] for k, delay in enumerate(delays)]
    assert np.diff(times) == pytest.approx(np.ones(6), abs=1e-9)


def test_offset_is_the_lower_envelope_not_the_mean() -> None:
    link = Link()
    generator = np.random.default_rng(1)
    delays = 0.2 + generator.exponential(0.5, 200)
    for k, delay in enumerate(delays):
        link.say(5.0 + 0.1 * k, 0.1 * k + delay)
    # Vehicle time started at the first receipt: the offset counts from its delay.
    assert link.clock.offset_ns * 1e-9 == pytest.approx(delays.min() - delays[0], abs=1e-6)
    vehicle, _ = link.say(0.0, 40.0, NONE, stream=1)  # long after: nothing near speaks for it
    assert vehicle == pytest.approx(40.0 - (delays.min() - delays[0]), abs=1e-6)


def test_offset_follows_a_drifting_clock() -> None:
    link = Link()
    for t in np.arange(0.0, 600.0, 0.5):
        link.say(5.0 + t, t * (1.0 + 1e-4))
    assert link.clock.report().offset_s == pytest.approx(0.06, abs=0.01)
    assert link.clock.report().receive_steps == 0


def test_wide_counter_wraps_after_49_days() -> None:
    link = Link()
    wrap = 2**32 / 1000.0
    link.run(wrap - 5.0, 0.0, 10.0)
    vehicle, verdict = link.say(wrap + 5.0, 10.0)
    assert vehicle == pytest.approx(10.0, abs=1e-6)
    assert verdict is StampStatus.FRESH
    assert (link.clock.report().wraps, link.clock.report().reboots) == (1, 0)


def test_packet_from_before_the_wrap_that_comes_after_it_is_late_not_new() -> None:
    link = Link()
    wrap = 2**32 / 1000.0
    link.run(wrap - 5.0, 0.0, 10.0)
    vehicle, verdict = link.say(wrap - 0.05, 10.0)
    assert vehicle == pytest.approx(4.95, abs=1e-6)
    assert verdict is StampStatus.LATE


def test_narrow_counter_wraps_every_71_minutes_and_follows_the_wide_one() -> None:
    link = Link()
    wrap = 2**32 * 1e-6
    for t in np.arange(0.0, 3.0 * wrap, 10.0):
        link.say(100.0 + t, t)
        vehicle, _ = link.say(100.0 + t + 0.02, t + 0.03, US32, stream=1)
        assert vehicle == pytest.approx(t + 0.02, abs=1e-6)
    assert (link.clock.report().wraps, link.clock.report().reboots) == (3, 0)


def test_turns_of_a_counter_from_before_it_was_seen_are_no_wraps() -> None:
    link, wrap = Link(), 2**32 * 1e-6
    link.run(2.5 * wrap, 0.0, 5.0)
    for seconds in (5.0, 6.0):
        vehicle, verdict = link.say(2.5 * wrap + seconds, seconds, US32, stream=1)
        assert vehicle == pytest.approx(seconds, abs=1e-6)
        assert verdict is StampStatus.FRESH
    assert link.clock.report().wraps == 0


def test_reboot_opens_a_session_and_time_goes_on() -> None:
    link = Link()
    link.run(600.0, 0.0, 10.0)
    link.run(20.0, 40.0, 10.0)
    vehicle, verdict = link.say(30.0, 50.0)
    assert vehicle == pytest.approx(50.0, abs=0.2)
    assert verdict is StampStatus.FRESH
    report = link.clock.report()
    assert (report.reboots, report.sessions, link.clock.reboots) == (1, 2, 1)
    assert 0 < report.unplaced <= 11  # only the second that confirms it


def test_reboot_after_a_month_is_no_wrap() -> None:
    link = Link()
    link.run(30 * 86400.0, 0.0, 10.0)
    link.run(20.0, 40.0, 10.0)
    report = link.clock.report()
    assert (report.reboots, report.wraps) == (1, 0)


def test_a_reboot_is_confirmed_by_messages_however_far_apart() -> None:
    """Receipt and the new boot time run on together: the second message shows the same jump."""
    link = Link()
    link.run(600.0, 0.0, 10.0)
    assert link.say(20.0, 40.0)[1] is StampStatus.UNPLACED
    assert link.say(23.0, 43.0)[1] is StampStatus.FRESH
    assert link.clock.report().reboots == 1


def test_two_wild_counters_that_do_not_agree_confirm_nothing() -> None:
    link = Link()
    link.run(600.0, 0.0, 10.0)
    for boot, receipt in ((20.0, 10.0), (80.0, 11.5), (30.0, 13.0)):
        assert link.say(boot, receipt)[1] is StampStatus.UNPLACED
    assert link.say(613.1, 13.1)[1] is StampStatus.FRESH
    assert link.clock.report().reboots == 0


def test_a_counter_of_nothing_is_no_boot_time_and_one_of_a_microsecond_is() -> None:
    for counter_us, sessions in ((0, 0), (1, 1)):
        clock = BoatClock(streams=1)
        clock.stamp(0, US, counter_us, START)
        assert clock.report().sessions == sessions


def test_time_goes_on_when_the_receipt_clock_steps_back_over_a_reboot() -> None:
    link = Link()
    link.run(600.0, 1000.0, 10.0)
    before, _ = link.say(610.0, 1010.0)
    link.run(30.0, 500.0, 10.0)
    after, _ = link.say(40.0, 510.0)
    assert after > before
    assert link.clock.report().reboots == 1


@pytest.mark.parametrize("step", [-300.0, -3.0, 120.0])
def test_step_of_the_receipt_clock_does_not_touch_vehicle_time(step: float) -> None:
    link = Link()
    link.run(10.0, 0.0, 20.0)
    link.run(30.0, 20.0 + step, 20.0)
    vehicle, verdict = link.say(50.0, 40.0 + step)
    assert vehicle == pytest.approx(40.0, abs=1e-6)
    assert verdict is StampStatus.FRESH
    report = link.clock.report()
    assert (report.receive_steps, report.reboots) == (1, 0)
    untimed, _ = link.say(0.0, 45.0 + step, NONE, stream=1)
    assert untimed == pytest.approx(45.0, abs=0.2)


@pytest.mark.parametrize(("late_s", "steps"), [(9.9, 0), (10.1, 1)])
def test_a_receipt_clock_ten_seconds_ahead_for_long_has_been_set(late_s: float, steps: int) -> None:
    link = Link()
    link.run(10.0, 0.0, 20.0)
    link.run(30.0, 20.0 + late_s, 10.0)
    assert link.clock.report().receive_steps == steps


@pytest.mark.parametrize(("seconds", "steps"), [(4.5, 0), (5.5, 1)])
def test_a_link_that_was_stuck_for_a_moment_has_set_no_clock(seconds: float, steps: int) -> None:
    """Messages that come twenty seconds late: for five seconds of boot time they are only late."""
    link = Link()
    link.run(10.0, 0.0, 20.0)
    link.run(30.0, 40.0, seconds)
    link.run(30.0 + seconds, 40.0 + seconds - (0.0 if steps else 20.0), 10.0)
    assert link.clock.report().receive_steps == steps


def test_the_spread_of_delays_is_told_in_seconds() -> None:
    link = Link()
    for k in range(100):
        link.say(10.0 + 0.1 * k, 0.1 * k + (0.3 if k % 2 else 0.0))
    assert link.clock.report().spread_s == pytest.approx(0.3, abs=1e-6)


def test_one_damaged_counter_is_unplaced_and_opens_nothing() -> None:
    link = Link()
    link.run(100.0, 0.0, 10.0)
    for boot in (5.0, 1.0e6):
        _, verdict = link.say(boot, 10.0)
        assert verdict is StampStatus.UNPLACED
        link.run(110.0, 10.05, 2.0)
    assert link.clock.report().reboots == 0
    assert link.clock.report().unplaced == 2


@pytest.mark.parametrize(
    ("moved_s", "placed"), [(-9.9, True), (-10.1, False), (9.9, True), (10.1, False)]
)
def test_a_counter_may_be_ten_seconds_off_before_it_is_a_jump(moved_s: float, placed: bool) -> None:
    link = Link()
    link.run(100.0, 0.0, 30.0)
    newest = 100.0 + 29.9
    _, verdict = link.say(newest + moved_s, 29.9)
    assert (verdict is not StampStatus.UNPLACED) == placed


def test_without_a_receiver_one_wild_counter_is_unplaced_and_a_lasting_one_a_session() -> None:
    clock, day_us = BoatClock(streams=1), 86_400_000_000
    ticks = [1_000_000 + 100_000 * k for k in range(100)]

    def stamped(counter_us: int) -> StampStatus:
        return clock.stamp(0, Counter.BOOT_US, counter_us, counter_us * 1000)[1]

    assert {stamped(tick) for tick in ticks[:50]} == {StampStatus.FRESH}
    assert stamped(ticks[50] + 2 * day_us) is StampStatus.UNPLACED
    assert {stamped(tick) for tick in ticks[51:]} == {StampStatus.FRESH}
    assert clock.report().sessions == 1
    later = [stamped(tick + 9 * day_us) for tick in ticks]
    assert later.count(StampStatus.UNPLACED) == 10  # a second of them
    assert clock.report().sessions == 2


def test_burst_of_old_packets_is_not_a_reboot() -> None:
    link = Link()
    link.run(100.0, 0.0, 30.0)
    for boot in np.arange(105.0, 112.0, 0.1):
        link.say(boot, 30.0)
    assert link.clock.report().reboots == 0
    assert link.say(130.0, 30.1)[1] is StampStatus.FRESH


def test_duplicates_are_told_within_their_stream_only() -> None:
    link = Link()
    assert link.say(10.0, 0.0)[1] is StampStatus.FRESH
    assert link.say(10.0, 0.1)[1] is StampStatus.DUPLICATE
    assert link.say(10.0, 0.1, stream=1)[1] is StampStatus.FRESH
    link.run(10.1, 0.2, 1.0)
    assert link.say(10.5, 1.3)[1] is StampStatus.DUPLICATE
    assert link.clock.report().duplicates == 2
    assert link.say(10.55, 1.4)[1] is StampStatus.LATE  # between two that came
    assert (link.clock.report().late, link.clock.report().duplicates) == (1, 2)


@pytest.mark.parametrize(
    ("back", "status"),
    [(1, StampStatus.DUPLICATE), (32, StampStatus.DUPLICATE), (33, StampStatus.LATE)],
)
def test_a_duplicate_of_any_of_the_last_thirty_two_is_told(back: int, status: StampStatus) -> None:
    for count in (40, 41):
        link = Link()
        for k in range(count):
            link.say(10.0 + 0.1 * k, 0.1 * k)
        assert link.say(10.0 + 0.1 * (count - back), 0.1 * count)[1] is status


def test_untimed_message_shares_the_delay_of_its_neighbours() -> None:
    link = Link()
    link.run(10.0, 0.0, 5.0)
    link.say(15.0, 8.0)  # three seconds late
    vehicle, _ = link.say(0.0, 8.01, NONE, stream=1)
    assert vehicle == pytest.approx(5.01, abs=1e-6)


@pytest.mark.parametrize(("after", "time"), [(0.9, 5.9), (1.1, 9.1)])
def test_a_neighbour_speaks_for_a_second_then_the_best_delay_does(
    after: float, time: float
) -> None:
    link = Link()
    link.run(10.0, 0.0, 5.0)
    link.say(15.0, 8.0)  # three seconds late
    vehicle, _ = link.say(0.0, 8.0 + after, NONE, stream=1)
    assert vehicle == pytest.approx(time, abs=1e-6)


def test_sample_time_of_a_receiver_that_lost_its_fix_moves_nothing() -> None:
    link = Link()
    link.run(100.0, 0.0, 30.0)
    assert link.say(101.0, 30.0, SAMPLE, stream=2)[1] is StampStatus.UNPLACED
    vehicle, verdict = link.say(129.7, 30.0, SAMPLE, stream=2)
    assert vehicle == pytest.approx(29.7, abs=1e-6)
    assert verdict is StampStatus.FRESH


def test_unix_time_in_a_boot_counter_is_not_taken_for_boot_time() -> None:
    link = Link()
    link.run(100.0, 0.0, 10.0)
    vehicle, verdict = link.clock.stamp(1, US, 1_700_000_000_000_000, START + 10_000_000_000)
    assert verdict is StampStatus.FRESH
    assert (vehicle - START) * 1e-9 == pytest.approx(10.0, abs=0.2)


def test_columns_and_single_messages_agree() -> None:
    generator = np.random.default_rng(7)
    count = 4000
    boot = np.cumsum(generator.exponential(0.05, count)) + 4290.0
    boot[2500:] -= 4200.0  # a reboot
    receipt = np.cumsum(generator.exponential(0.05, count)) + generator.exponential(0.3, count)
    receipt[1200:] -= 90.0
    stream = generator.integers(0, 3, count)
    counter = np.array([int(MS), int(US32), int(NONE)])[stream]
    counter_us = np.where(stream == 1, np.round(boot * 1e6) % 2**32, np.round(boot * 1e3) * 1e3)
    counter_us = np.where(stream == 2, 0, counter_us).astype(np.int64)
    receive = START + np.round(receipt * 1e9).astype(np.int64)
    bulk, single = BoatClock(3), BoatClock(3)
    vehicle, verdict, _ = bulk.stamp_all(stream, counter.astype(np.int64), counter_us, receive)
    one = [
        single.stamp(int(s), Counter(int(c)), int(u), int(r))
        for s, c, u, r in zip(stream, counter, counter_us, receive, strict=True)
    ]
    assert [v for v, _ in one] == vehicle.tolist()
    assert [int(w) for _, w in one] == verdict.tolist()
    assert bulk.report() == single.report()
    assert bulk.report().reboots == 1
