"""GPS lost, EKF unhealthy, compass jump, frozen sensor: data that cannot judge never judge.

Faults are injected into a simulated boat whose vessel is right: whatever blames it is wrong.
"""

import math
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
from gateway.shadow import FilterInputs
from gateway.shadow.sensor_checks import (
    CONFIRMED_S,
    FROZEN_S,
    JUMP_HELD_S,
    SETTLE_S,
    STATUS_CONFIRMED_S,
    WORDS,
    SensorFault,
    SensorMemory,
    reported_well,
    unfit_text,
)
from gateway.simulated_boat.telemetry import (
    FROZEN,
    WELL,
    CompassError,
    Frozen,
    SensorFaults,
    Span,
)
from tests.gateway.pipelines.aboard import Deck, Heard, datagrams, played

BEGIN, END, SECONDS = 66.0, 80.0, 104.0
SPAN = Span(BEGIN, END)
# the fault, what is said of it, and how soon [s]
FAULTS: dict[str, tuple[SensorFaults, str, float]] = {
    "gps": (SensorFaults(gps_lost=(SPAN,)), "the GPS has no fix", 2.0),
    "ekf": (SensorFaults(ekf_holds=(SPAN,)), "the autopilot's EKF has no velocity and no position",
            3.0),
    "compass": (SensorFaults(compass=(CompassError(SPAN, 0.6),)), "the heading jumped", 1.0),
    "heading": (SensorFaults(frozen=(Frozen("heading", SPAN),)), "the heading is frozen", 4.0),
    "turn": (SensorFaults(frozen=(Frozen("turn", SPAN),)), "the gyro is frozen", 4.0),
    "velocity": (SensorFaults(frozen=(Frozen("velocity", SPAN),)), "the velocity is frozen", 4.0),
    "position": (SensorFaults(frozen=(Frozen("position", SPAN),)), "the position is frozen", 8.0),
}  # fmt: skip
SURE = round(10 * STATUS_CONFIRMED_S) + 1  # rows at 10 Hz until fix and EKF are believed
BLAME = ("model_wrong", "model_explained", "residual_unusual")


@cache
def heard(name: str) -> tuple[Heard, list[str]]:
    """What goes out and what is printed of a voyage with that fault, or none."""
    faults = FAULTS[name][0] if name in FAULTS else SensorFaults()
    with Deck() as deck:
        deck.hear(datagrams(played(SECONDS, sensor_faults=faults)), SECONDS)
        return deck.heard(), deck.told


def events(found: Heard, kind: str) -> list[tuple[float, str]]:
    return [
        (m["vehicle_time_ns"] * 1e-9 - 1.7e9, m["says"])
        for m in found.messages("event")
        if m["kind"] == kind
    ]


@pytest.mark.parametrize("name", FAULTS)
def test_what_failed_is_said_with_its_begin_and_end_and_the_model_is_not_blamed(name: str) -> None:
    found, told = heard(name)
    began, text = events(found, "sensor_failed")[0]
    assert len(events(found, "sensor_failed")) == 1 + (name == "gps")  # the EKF follows
    assert text.startswith(FAULTS[name][1])
    assert BEGIN < began < BEGIN + FAULTS[name][2]
    ((ended, over),) = events(found, "sensor_restored")
    assert END + SETTLE_S - 0.5 < ended < END + SETTLE_S + 2.0
    assert over.endswith("the model is judged again")
    assert not [m["says"] for m in found.messages("event") if m["kind"] in BLAME]
    assert any(line.endswith(text) for line in told)
    assert any(line.endswith(over) for line in told)


def test_what_was_not_there_at_first_does_not_come_again() -> None:
    """An EKF that needs a while after boot, and one that loses later what it had by then."""
    late = SensorFaults(ekf_holds=(Span(0.0, 20.0), Span(40.0, 50.0)))
    with Deck() as deck:
        found = deck.hear(datagrams(played(65.0, sensor_faults=late))).heard()
    (_, first), (_, second) = events(found, "sensor_restored")
    assert first.startswith("the autopilot's EKF has its velocity and its position, after ")
    assert first.endswith("the model is judged from now on")
    assert second.startswith("the autopilot's EKF has its velocity again and its position again")
    assert second.endswith("the model is judged again")


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


@pytest.mark.parametrize("name", FAULTS)
def test_health_says_what_failed_and_since_when_while_it_lasts(name: str) -> None:
    rows = heard(name)[0].messages("health")
    times = np.array([row["receive_time_ns"] * 1e-9 - 1.7e9 for row in rows])
    unfit = np.array([row["unfit_s"] for row in rows])
    assert (unfit[times < BEGIN] == 0.0).all()
    assert (unfit[(times > BEGIN + FAULTS[name][2] + 1.0) & (times < END)] > 0.0).all()
    assert (unfit[times > END + SETTLE_S + 3.0] == 0.0).all()
    texts = [
        row["unfit"] for row in rows if BEGIN + 9.0 < row["receive_time_ns"] * 1e-9 - 1.7e9 < END
    ]
    assert all(FAULTS[name][1].partition(" and ")[0] in text for text in texts)
    assert all(" since 22:14:" in text for text in texts)  # 22:13:20 and what the voyage took


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_judge_is_withheld(name: str) -> None:
    times = np.array(heard(name)[0].column("residual", "receive_time_ns")) * 1e-9 - 1.7e9
    inside = (times > BEGIN + FAULTS[name][2]) & (times < END)
    assert not inside.any()
    assert (times > END + SETTLE_S + 3.0).sum() > 500


def test_without_the_checks_the_model_would_be_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        SensorMemory, "check", lambda self, given: (self, np.zeros(len(given), np.int64))
    )
    played_fault = played(90.0, sensor_faults=FAULTS["velocity"][0])
    with Deck() as deck:
        found = deck.hear(datagrams(played_fault)).heard()
    assert {m["kind"] for m in found.messages("event")} & set(BLAME)


def test_a_boat_whose_sensors_are_well_is_never_unfit() -> None:
    found, told = heard("none")
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
    pulses = np.full((3 * count, CHANNELS), 1600.0 if armed else np.nan)
    one = np.ones(3 * count)
    return FilterInputs(
        Events(time, np.tile([int(k) for k in kinds], count), z, np.ones((3 * count, 2))),
        np.arange(3 * count), one > 0.0, ns, ns, pulses, one, np.ones((3 * count, 2)),
        np.repeat(np.broadcast_to(fix, count), 3) * 1.0,
        np.repeat(np.broadcast_to(ekf, count), 3) * 1.0,
    )  # fmt: skip


def faults(given: FilterInputs) -> Any:
    """Bits after each round of three, (K,)."""
    return SensorMemory().check(given)[1][2::3]


def turning(count: int, rate: float = 0.3, seed: int = 0) -> tuple[Any, Any]:
    dice = np.random.default_rng(seed)
    yaw = rate * np.arange(count) / 10.0 + 1e-3 * dice.standard_normal(count)
    return yaw, rate + 1e-3 * dice.standard_normal(count)


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


@pytest.mark.parametrize(("flags", "ratio", "bits"), [(831, 0.3, 0), (1, 0.3, 6), (831, 0.9, 16)])
def test_flags_of_px4s_filter(flags: int, ratio: float, bits: int) -> None:
    message = dialect.MAVLink_estimator_status_message(0, flags, ratio, ratio, 0, 0, 0, 0, 0, 0)
    assert float(estimator_status(message)[0][1][0]) == bits


def test_each_fault_has_words_of_its_own_and_every_freeze_can_be_played() -> None:
    texts = [text for pair in WORDS.values() for text in pair]
    assert len(set(texts)) == 2 * (len(SensorFault) - 1)
    assert unfit_text(int(SensorFault.SETTLING), {}) == "all is well, settling"
    assert unfit_text(0, {}) == ""
    assert {one.what for fault, _, _ in FAULTS.values() for one in fault.frozen} == set(FROZEN)
