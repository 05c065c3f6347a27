"""GPS lost, EKF unhealthy, compass jump, frozen sensor: data that cannot judge never judge.

Faults are injected into a simulated boat whose vessel is right: whatever blames it is wrong.
"""

import math
import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.estimation import MeasurementKind
from gateway.estimation.events import Events
from gateway.ingest.mapping import EstimatorFault
from gateway.ingest.mavlink.mapping import ekf_status_report, estimator_status
from gateway.samples import CHANNELS, Quantity
from gateway.shadow import FilterInputs, PulseTable
from gateway.shadow.sensor_checks import (
    CONFIRMED_S,
    FROZEN_S,
    JUMP_HELD_S,
    SETTLE_S,
    SLOW_UNHEARD_S,
    STATUS_CONFIRMED_S,
    UNHEARD_S,
    WORDS,
    SensorFault,
    SensorMemory,
    reported_well,
    unfit_text,
)
from gateway.simulated_boat import FAST
from gateway.simulated_boat.telemetry import (
    FROZEN,
    WELL,
    CompassError,
    Frozen,
    SensorFaults,
    Span,
)
from tests.gateway.pipelines.aboard import UNIX_S, Deck, Heard, datagrams, played

SECONDS = 104.0
FIRST_S, LASTS_S, EVERY_S = 66.0, 14.0, 40.0  # the monitor judges by then; each fault; the next one
# what is said of each fault, and how soon [s]; they happen one after another in one voyage
FAULTS = {
    "gps": ("the GPS has no 3-D fix", 2.0),
    "ekf": ("the autopilot's EKF has no velocity and no position", 3.0),
    "compass": ("the heading jumped", 1.0),
    "heading": ("the heading is frozen", 4.0),
    "turn": ("the gyro is frozen", 4.0),
    "velocity": ("the velocity is frozen", 4.0),
    "position": ("the position is frozen", 8.0),
}


def span_of(name: str) -> Span:
    begin = FIRST_S + EVERY_S * list(FAULTS).index(name)
    return Span(begin, begin + LASTS_S)


ALL = SensorFaults(
    gps_lost=(span_of("gps"),), ekf_holds=(span_of("ekf"),),
    compass=(CompassError(span_of("compass"), 0.6),),
    frozen=tuple(Frozen(n, span_of(n)) for n in ("heading", "turn", "velocity", "position")),
)  # fmt: skip
SURE = round(10 * STATUS_CONFIRMED_S) + 1  # rows at 10 Hz until fix and EKF are believed
BLAME = ("model_wrong", "model_explained", "residual_unusual")


@cache
def heard(faulty: bool = True) -> tuple[Heard, list[str]]:
    """What goes out and what is printed of a voyage with all the faults, or none."""
    seconds = FIRST_S + EVERY_S * len(FAULTS) if faulty else SECONDS
    with Deck() as deck:
        wire = played(seconds, sensor_faults=ALL if faulty else SensorFaults())
        deck.hear(datagrams(wire), seconds)
        return deck.heard(), deck.told


def around(name: str, times: Any) -> Any:
    """Which times [s] belong to a fault: from a while before it to the next one's."""
    begin = span_of(name).from_s
    return (np.asarray(times) > begin - 8.0) & (np.asarray(times) < begin + EVERY_S - 8.0)


def events(found: Heard, kind: str) -> list[tuple[float, str]]:
    return [
        (m["vehicle_time_ns"] * 1e-9 - 1.7e9, m["says"])
        for m in found.messages("event")
        if m["kind"] == kind
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_what_failed_is_said_with_its_begin_and_end_and_the_model_is_not_blamed(name: str) -> None:
    found, told = heard()
    says, soon = FAULTS[name]
    failed, restored = (
        [(at, text) for at, text in events(found, kind) if around(name, at)]
        for kind in ("sensor_failed", "sensor_restored")
    )
    began, text = failed[0]
    assert len(failed) == 1 + (name == "gps")  # the EKF follows
    assert text.startswith(says)
    begin, end = span_of(name)
    assert begin < began < begin + soon
    ((ended, over),) = restored
    assert end + SETTLE_S - 0.5 < ended < end + SETTLE_S + 2.0
    assert over.endswith("the model is judged again")
    assert not [m["says"] for m in found.messages("event") if m["kind"] in BLAME]
    assert any(line.endswith(text) for line in told)
    assert any(line.endswith(over) for line in told)


LATE, LOST = Span(0.0, 10.0), Span(22.0, 29.0)


@cache
def heard_late() -> tuple[Heard, list[str]]:
    """An EKF that needs a while after boot, and loses later what it had by then: 40 s."""
    with Deck() as deck:
        wire = played(40.0, sensor_faults=SensorFaults(ekf_holds=(LATE, LOST)))
        return deck.hear(datagrams(wire), 40.0).heard(), deck.told


def test_what_is_lost_is_said_at_its_begin_and_its_end_and_withheld_between() -> None:
    """In the small: all faults, each by itself and until the model is judged, are slow."""
    found, told = heard_late()
    ((began, text),) = [(at, says) for at, says in events(found, "sensor_failed") if at > LATE[1]]
    assert text.startswith(FAULTS["ekf"][0])
    assert LOST.from_s < began < LOST.from_s + FAULTS["ekf"][1]
    *_, (ended, over) = events(found, "sensor_restored")
    assert LOST.to_s + SETTLE_S - 0.5 < ended < LOST.to_s + SETTLE_S + 2.0
    assert any(line.endswith(text) for line in told)
    assert any(line.endswith(over) for line in told)
    rows = found.messages("health")
    times = np.array([row["receive_time_ns"] * 1e-9 - 1.7e9 for row in rows])
    unfit = np.array([row["unfit_s"] for row in rows])
    inside = (times > LOST.from_s + FAULTS["ekf"][1] + 1.0) & (times < LOST.to_s)
    assert inside.sum() >= 3
    assert (unfit[inside] > 0.0).all()
    assert (unfit[(times > LOST.from_s - 1.5) & (times < LOST.from_s)] == 0.0).all()
    assert (unfit[times > LOST.to_s + SETTLE_S + 3.0] == 0.0).all()
    judged = np.array(found.column("residual", "receive_time_ns")) * 1e-9 - 1.7e9
    assert not ((judged > LOST.from_s + FAULTS["ekf"][1]) & (judged < LOST.to_s)).any()


def heard_without(gone: Span, *kinds: str, **rates: float) -> list[tuple[float, str, str]]:
    """Events of 40 s in which no message of those kinds comes for a while; all where none named."""
    with Deck() as deck:
        wire = [
            item
            for item in datagrams(played(40.0, rates={**FAST, **rates}))
            if not gone.has(item.receive_time_ns * 1e-9 - UNIX_S)
            or (kinds and item.frames[0].message.get_type() not in kinds)
        ]
        found = deck.hear(wire, 40.0).heard()
    return [
        (m["receive_time_ns"] * 1e-9 - UNIX_S, m["kind"], m["says"])
        for m in found.messages("event")
    ]


def test_outputs_that_are_told_no_more_are_said_and_judge_nothing() -> None:
    """The last pulses hold on, and what the boat does without them would blame the model."""
    happened = heard_without(Span(15.0, 25.0), "SERVO_OUTPUT_RAW")
    ((failed, text),) = [(at, says) for at, kind, says in happened if kind == "sensor_failed"]
    ((over, again),) = [(at, says) for at, kind, says in happened if kind == "sensor_restored"]
    assert text == "nobody tells of the outputs: until that is over the model is not judged"
    assert 15.0 + UNHEARD_S < failed < 15.0 + UNHEARD_S + 0.5
    assert again.startswith("the outputs are told again, after ")
    assert 25.0 + SETTLE_S - 0.5 < over < 25.0 + SETTLE_S + 1.0
    assert not [kind for _, kind, _ in happened if kind in BLAME]


def test_outputs_that_nobody_has_ever_told_of_judge_nothing_and_do_not_come_again() -> None:
    happened = heard_without(Span(0.0, 20.0), "SERVO_OUTPUT_RAW")
    ((failed, text),) = [(at, says) for at, kind, says in happened if kind == "sensor_failed"]
    ((_, there),) = [(at, says) for at, kind, says in happened if kind == "sensor_restored"]
    assert text == "nobody tells of the outputs: until that is over the model is not judged"
    assert SLOW_UNHEARD_S < failed < 3.0 + SLOW_UNHEARD_S
    assert there.startswith("the outputs are told, after ")
    assert there.endswith("the model is judged from now on")


@pytest.mark.parametrize(("hz", "seldom"), [(0.5, True), (1.0, True), (2.0, False)])
def test_outputs_that_are_told_too_seldom_judge_nothing(hz: float, seldom: bool) -> None:
    """Motors that changed between two messages were a weak thruster, a wind, a lift of the hull."""
    happened = heard_without(Span(0.0, 0.0), SERVO_OUTPUT_RAW=hz)
    said = [says for _, kind, says in happened if kind.startswith("sensor_")]
    failed = "the outputs are told too seldom (twice a second is enough)"
    assert said == ([f"{failed}: until that is over the model is not judged"] if seldom else [])


def test_nobody_has_to_tell_of_outputs_while_the_boat_is_disarmed() -> None:
    """Nor does what was missed before come again by that."""
    yaw, rate = turning(400)
    given = inputs(yaw, rate)
    time = given.events.time_s
    table = given.pulse_table
    never = replace(given, pulse_table=table._replace(heard=np.full_like(time, np.nan)))
    assert not faults(never).any()
    silent = np.where(time < 20.0, np.minimum(time, 4.0), np.nan)
    missed = faults(replace(given, pulse_table=table._replace(heard=silent)))
    assert (missed[100:] == SensorFault.UNHEARD).all()


def test_a_link_that_is_silent_as_a_whole_says_nothing_of_outputs() -> None:
    happened = heard_without(Span(15.0, 25.0))
    assert not [says for _, kind, says in happened if kind == "sensor_failed"]


def test_what_was_not_there_at_first_does_not_come_again() -> None:
    (_, first), (_, second) = events(heard_late()[0], "sensor_restored")
    assert first.startswith("the autopilot's EKF has its velocity and its position, after ")
    assert first.endswith("the model is judged from now on")
    assert second.startswith("the autopilot's EKF has its velocity again and its position again")
    assert second.endswith("the model is judged again")


def test_what_the_ekf_has_is_not_said_of_the_gps() -> None:
    with Deck() as deck:
        both = SensorFaults(gps_lost=(LOST,), ekf_holds=(LOST,))
        found = deck.hear(datagrams(played(40.0, sensor_faults=both)), 40.0).heard()
    *_, (_, over) = events(found, "sensor_restored")
    assert over.startswith(
        "the GPS has a 3-D fix again and the autopilot's EKF has its velocity again"
    )


@pytest.mark.parametrize(
    ("fix", "estimator", "well", "unsaid"),
    [
        (3.0, np.nan, SensorFault.GPS, SensorFault.EKF_ATTITUDE),
        (1.0, 0.0, SensorFault.EKF_ATTITUDE, SensorFault.GPS),
        (np.nan, float(EstimatorFault.ATTITUDE), SensorFault.EKF_VELOCITY,
         SensorFault.EKF_ATTITUDE),
    ],
)  # fmt: skip
def test_only_what_the_boat_says_is_well_can_be_lost(
    fix: float, estimator: float, well: SensorFault, unsaid: SensorFault
) -> None:
    said = reported_well(fix, estimator)
    assert said & well
    assert not said & unsaid


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_health_says_what_failed_and_since_when_while_it_lasts(name: str) -> None:
    rows = heard()[0].messages("health")
    times = np.array([row["receive_time_ns"] * 1e-9 - 1.7e9 for row in rows])
    unfit = np.array([row["unfit_s"] for row in rows])
    (begin, end), (says, soon), here = span_of(name), FAULTS[name], around(name, times)
    assert (here & (times < begin)).sum() > 5
    assert (unfit[here & (times < begin)] == 0.0).all()
    assert (unfit[(times > begin + soon + 1.0) & (times < end)] > 0.0).all()
    assert (unfit[here & (times > end + SETTLE_S + 3.0)] == 0.0).all()
    texts = [row["unfit"] for row, t in zip(rows, times, strict=True) if begin + 9.0 < t < end]
    assert all(says.partition(" and ")[0] in text for text in texts)
    since = time.strftime(" since %H:%M:", time.gmtime(UNIX_S + begin))
    assert all(since in text for text in texts)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_judge_is_withheld(name: str) -> None:
    times = np.array(heard()[0].column("residual", "receive_time_ns")) * 1e-9 - 1.7e9
    begin, end = span_of(name)
    assert not ((times > begin + FAULTS[name][1]) & (times < end)).any()
    assert (around(name, times) & (times > end + SETTLE_S + 3.0)).sum() > 300


@pytest.mark.slow
def test_without_the_checks_the_model_would_be_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        SensorMemory, "check", lambda self, given: (self, np.zeros(len(given), np.int64))
    )
    frozen = SensorFaults(frozen=(Frozen("velocity", Span(66.0, 80.0)),))
    played_fault = played(90.0, sensor_faults=frozen)
    with Deck() as deck:
        found = deck.hear(datagrams(played_fault)).heard()
    assert {m["kind"] for m in found.messages("event")} & set(BLAME)


@pytest.mark.slow
def test_a_boat_whose_sensors_are_well_is_never_unfit() -> None:
    found, told = heard(faulty=False)
    assert not events(found, "sensor_failed")
    assert not events(found, "sensor_restored")
    assert {row["unfit"] for row in found.messages("health")} == {""}
    assert {row["unfit_s"] for row in found.messages("health")} == {0.0}
    assert not [line for line in told if "judged" in line]


def inputs(
    yaw: Any, rate: Any, *, speed: Any = 0.123, fix: Any = 3.0, ekf: Any = np.nan, hz: float = 10.0,
    armed: bool = True,
) -> FilterInputs:  # fmt: skip
    """Heading, turn rate and velocity in turn, `hz` times a second: made up."""
    count = len(yaw)
    time = np.repeat(np.arange(count) / hz, 3)
    kinds = (MeasurementKind.YAW, MeasurementKind.YAW_RATE, MeasurementKind.VELOCITY)
    z = np.zeros((3 * count, 2))
    noise = 1e-4 * np.random.default_rng(1).standard_normal(count)
    z[0::3, 0], z[1::3, 0], z[2::3, 0] = yaw, rate, speed + noise
    ns = (time * 1e9).astype(np.int64)
    pulses = PulseTable.of(np.full((3 * count, CHANNELS), 1600.0 if armed else np.nan), time)
    one = np.ones(3 * count)
    return FilterInputs(
        Events(time, np.tile([int(k) for k in kinds], count), z, np.ones((3 * count, 2))),
        np.arange(3 * count), one > 0.0, ns, ns, np.arange(3 * count), one,
        np.ones((3 * count, 2)), np.repeat(np.broadcast_to(fix, count), 3) * 1.0,
        np.repeat(np.broadcast_to(ekf, count), 3) * 1.0, pulses,
    )  # fmt: skip


def faults(given: FilterInputs) -> Any:
    """Bits after each round of three, (K,)."""
    return SensorMemory().check(given)[1][2::3]


def turning(count: int, rate: float = 0.3, seed: int = 0) -> tuple[Any, Any]:
    dice = np.random.default_rng(seed)
    yaw = rate * np.arange(count) / 10.0 + 1e-3 * dice.standard_normal(count)
    return yaw, rate + 1e-3 * dice.standard_normal(count)


def test_outputs_are_missed_though_messages_overtake_one_another() -> None:
    yaw, rate = turning(200)
    given = inputs(yaw, rate)
    table = given.pulse_table
    once = table._replace(heard=np.ones_like(table.heard))
    late = given.events.time_s - 0.15 * (given.events.kind == MeasurementKind.VELOCITY)
    given = replace(given, pulse_table=once, events=replace(given.events, time_s=late))
    bits = faults(given)
    silent = np.arange(200) / 10.0 - 0.15
    assert not bits[silent < SLOW_UNHEARD_S - 0.5].any()
    assert (bits[silent > SLOW_UNHEARD_S + 0.5] == SensorFault.UNHEARD).all()


def test_how_inputs_are_cut_makes_no_difference() -> None:
    yaw, rate = turning(300)
    yaw[100:] += 0.5
    given = inputs(yaw, rate, fix=np.where(np.arange(300) < 200, 3.0, 1.0))
    whole = SensorMemory().check(given)[1]
    for size in (1, 7, 100):
        memory, parts = SensorMemory(), []
        for start in range(0, len(given), size):
            memory, bits = memory.check(given[start : start + size])
            parts.append(bits)
        assert (np.concatenate(parts) == whole).all()


def test_a_sharp_turn_that_the_gyro_saw_is_no_jump_and_one_wild_value_neither() -> None:
    yaw, rate = turning(300, 1.5)
    assert not faults(inputs((yaw + np.pi) % (2 * np.pi) - np.pi, rate)).any()
    yaw[150] += 2.0
    assert not (faults(inputs(yaw, rate)) & SensorFault.COMPASS).any()


def test_a_heading_that_stays_where_it_jumped_is_believed_in_the_end() -> None:
    yaw, rate = turning(2000)
    yaw[100:] += 0.5
    jumped = (faults(inputs(yaw, rate)) & SensorFault.COMPASS) != 0
    assert np.flatnonzero(jumped)[[0, -1]] / 10.0 == pytest.approx(
        [10.0 + CONFIRMED_S, 10.0 + JUMP_HELD_S], abs=0.3
    )


@pytest.mark.parametrize(("hz", "rate_radps"), [(20.0, 7.0), (2.5, 1.4)])
def test_a_turn_that_a_slow_gyro_or_a_thin_stream_blurs_is_no_jump(
    hz: float, rate_radps: float
) -> None:
    """As in real logs: the rate passes a filter of 50 ms, or comes twice and a half a second."""
    time = np.arange(0.0, 60.0, 1.0 / hz)
    turning_now = (time > 20.0) & (time < 24.0) | (time > 40.0)
    yaw = np.interp(time, [0, 20, 24, 40, 60], np.cumsum([0, 0, 4, 0, 20]) * rate_radps)
    delayed = np.interp(time - 0.05, time, turning_now * rate_radps)
    dice = 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    bits = faults(inputs((yaw + np.pi) % (2 * np.pi) - np.pi, delayed + dice, hz=hz))
    assert not (bits & SensorFault.COMPASS).any()


def test_a_turn_that_begins_between_two_headings_half_a_second_apart_is_no_jump() -> None:
    """The rate of that moment is told after the heading; the next heading agrees with it."""
    time = np.arange(0.0, 60.0, 0.5)
    begins = 20.0 + np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    rates = np.interp(time, begins, np.radians([-0.1, -6.7, -50.0, -55.7, -38.5, -10.0]), 0.0, 0.0)
    yaw = np.interp(time, begins, np.radians([0.0, -0.6, -19.5, -47.3, -70.3, -91.0]))
    yaw = yaw + 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    assert not (faults(inputs(yaw, rates, hz=2.0)) & SensorFault.COMPASS).any()
    yaw[time > 40.0] += 0.5  # a compass that jumps is told, if later
    assert (faults(inputs(yaw, rates, hz=2.0)) & SensorFault.COMPASS).any()


@pytest.mark.parametrize("step", [0.05, 0.6])
def test_only_a_jump_that_no_filter_would_make_counts(step: float) -> None:
    yaw, rate = turning(300)
    yaw[100:] += step
    assert bool((faults(inputs(yaw, rate)) & SensorFault.COMPASS).any()) == (step > 0.2)


def test_a_disarmed_boat_or_a_coarse_heading_on_a_straight_leg_is_not_frozen() -> None:
    still = np.full(300, 0.1234567), np.full(300, 0.0)
    assert (faults(inputs(*still)) & SensorFault.FROZEN_HEADING).any()
    assert not faults(inputs(*still, armed=False)).any()
    coarse = np.full(300, math.radians(7.0))  # whole degrees, as in VFR_HUD
    dice = 1e-3 * np.random.default_rng(0).standard_normal(300)
    assert not faults(inputs(coarse, dice)).any()
    assert (faults(inputs(coarse, 0.1 + dice)) & SensorFault.FROZEN_HEADING).any()


def test_a_frozen_heading_is_noticed_after_a_while_and_is_no_jump() -> None:
    yaw, rate = turning(300)
    yaw[100:200] = yaw[100]
    bits = faults(inputs(yaw, rate))
    frozen = np.flatnonzero(bits & SensorFault.FROZEN_HEADING) / 10.0
    assert frozen[[0, -1]] == pytest.approx([10.0 + FROZEN_S, 19.9], abs=0.2)
    assert not (bits & SensorFault.COMPASS).any()


def test_a_boat_without_gps_whose_filter_is_well_is_judged_and_one_that_had_a_fix_is_not() -> None:
    yaw, rate = turning(200)
    assert not faults(inputs(yaw, rate, fix=0.0, ekf=0.0)).any()
    assert (faults(inputs(yaw, rate, fix=0.0))[SURE:] & SensorFault.GPS).all()
    lost = np.where(np.arange(200) < 100, 3.0, 1.0)
    bits = faults(inputs(yaw, rate, fix=lost, ekf=0.0))
    assert not bits[:100].any()
    assert bits[100:].all()
    assert (bits[100 + SURE :] & SensorFault.GPS).all()


def test_one_damaged_report_is_no_fault_but_judges_nothing() -> None:
    yaw, rate = turning(100)
    wild = np.where((np.arange(100) >= 30) & (np.arange(100) < 40), 4.0, 0.0)
    bits = faults(inputs(yaw, rate, ekf=wild))
    assert set(bits[30:95].tolist()) == {0, int(SensorFault.SETTLING)}
    assert (bits[31:40] == SensorFault.SETTLING).all()


def ekf(flags: int, ratio: float = 0.1) -> float:
    message = dialect.MAVLink_ekf_status_report_message(flags, ratio, 0.1, 0.1, 0.1, 0.0)
    ((quantity, (value,)),) = ekf_status_report(message)
    assert quantity is Quantity.ESTIMATOR
    return float(value)


@pytest.mark.parametrize(
    ("flags", "ratio", "fault"),
    [
        (WELL, 0.1, None), (WELL & ~dialect.EKF_ATTITUDE, 0.1, SensorFault.EKF_ATTITUDE),
        (WELL & ~dialect.EKF_VELOCITY_HORIZ, 0.1, SensorFault.EKF_VELOCITY),
        (WELL & ~dialect.EKF_POS_HORIZ_ABS, 0.1, None),  # a relative one is enough
        (WELL | dialect.EKF_CONST_POS_MODE, 0.1, SensorFault.EKF_POSITION),
        (WELL | 1 << 15, 0.1, SensorFault.EKF_GLITCH), (WELL, 0.9, SensorFault.EKF_REJECTS),
    ],
)  # fmt: skip
def test_flags_of_ardupilots_filter(flags: int, ratio: float, fault: SensorFault | None) -> None:
    yaw, rate = turning(40)
    bits = faults(inputs(yaw, rate, ekf=ekf(flags, ratio)))[SURE:]
    assert set(bits.tolist()) == {0 if fault is None else int(fault)}


@pytest.mark.parametrize(
    ("flags", "ratio", "bits"), [(831, 0.3, 0), (1, 0.3, 6), (831, 0.7, 0), (831, 0.9, 16)]
)
def test_flags_of_px4s_filter(flags: int, ratio: float, bits: int) -> None:
    message = dialect.MAVLink_estimator_status_message(0, flags, ratio, ratio, 0, 0, 0, 0, 0, 0)
    assert float(estimator_status(message)[0][1][0]) == bits


def test_a_sensor_that_there_is_not_hides_no_other() -> None:
    message = dialect.MAVLink_estimator_status_message(
        0, 831, float("nan"), 0.9, 0, 0, 0, 0, 0, 0
    )  # fmt: skip
    assert float(estimator_status(message)[0][1][0]) == 16


def test_each_fault_has_words_of_its_own_and_every_freeze_can_be_played() -> None:
    texts = [text for pair in WORDS.values() for text in pair]
    assert len(set(texts)) == 2 * (len(SensorFault) - 1)
    assert unfit_text(int(SensorFault.SETTLING), {}) == "all is well, settling"
    assert unfit_text(0, {}) == ""
    assert {one.what for one in ALL.frozen} == set(FROZEN)
