"""Sensors that contradict one another are told with size and sign; those that agree are not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.ingest.agreement import (
    RateAgreement,
    Reconciled,
    Turns,
    rate_agreement,
    reconciled,
)
from gateway.ingest.sources import Choice, choose
from gateway.ingest.stretches import metres, over_ground
from gateway.offline import trials
from gateway.offline.trials import load_trials
from gateway.samples import Quantity, Samples
from sim.state import Floats
from sim.trial import Trial
from tests.gateway.ingest.made_table import Traps, written

RATE_HZ, SECONDS = 20.0, 300.0
T = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
YAW = 2.0 * np.sin(2.0 * np.pi * T / 37.0) + T / 20.0  # rad: to both sides, and all around
YAW_RATE = np.gradient(YAW, T)
SPEED = 1.0 + 0.5 * np.sin(2.0 * np.pi * T / 61.0)
VELOCITY = np.stack([SPEED * np.cos(YAW), SPEED * np.sin(YAW)], axis=1)
PLACE = np.cumsum(VELOCITY, axis=0) / RATE_HZ
rng = np.random.default_rng(8)


def choice(name: str, values: Floats, quantity: Quantity, time: Floats = T) -> Choice:
    """A source of one quantity as a log gives it."""
    at = np.round(time * 1e9).astype(np.int64) + 10**9
    columns = values.reshape(len(time), -1)
    samples = Samples(quantity, name.upper(), np.arange(len(at)), at, at, columns)
    return Choice(name, samples, RATE_HZ, 0.1, "preferred")


def of_a_boat(
    yaw: Floats = YAW, yaw_rate: Floats = YAW_RATE, velocity: Floats = VELOCITY,
    place: Floats = PLACE, body: bool = False,
) -> dict[str, Choice]:  # fmt: skip
    """These sensors, each with a little noise."""
    wrapped = np.angle(np.exp(1j * (yaw + rng.normal(0.0, 0.01, len(T)))))
    kind = Quantity.BODY_VELOCITY if body else Quantity.VELOCITY
    return {
        "yaw": choice("yaw", wrapped, Quantity.YAW),
        "yaw rate": choice("yaw rate", yaw_rate + rng.normal(0.0, 0.01, len(T)), Quantity.YAW_RATE),
        "velocity": choice("velocity", velocity + rng.normal(0.0, 0.03, (len(T), 2)), kind),
        "position": choice("position", place + rng.normal(0.0, 0.3, (len(T), 2)),
                           Quantity.POSITION),
    }  # fmt: skip


def said(**change: Any) -> tuple[str, ...]:
    """What is told of these sensors."""
    return reconciled(of_a_boat(**change)).contradictions


def test_sensors_that_agree_contradict_nothing() -> None:
    given = of_a_boat()
    assert reconciled(given) == (given, (), ())
    ahead = np.stack([SPEED, np.zeros_like(SPEED)], axis=1)
    np.testing.assert_allclose(over_ground(ahead, YAW), VELOCITY)
    assert said(velocity=ahead, body=True) == ()


def test_what_the_catalogue_holds_is_no_contradiction() -> None:
    assert said(yaw_rate=YAW_RATE + 0.05) == ()  # a gyro's bias
    assert said(yaw=YAW + 0.2 * np.sin(YAW) - 0.1 * np.cos(YAW)) == ()  # iron near the compass
    assert said(yaw=YAW + 0.3) == ()  # a compass that is mounted askew


@pytest.mark.parametrize("scale", [0.88, 1.15])
def test_a_scale_is_told_with_its_size(scale: float) -> None:
    (turn,) = said(yaw_rate=scale * YAW_RATE)
    assert turn.startswith(f"yaw rate (YAW RATE) is {scale:.2f}")
    lies = "a wrong scale, or a gyro that lies over by 28°"
    wrong = lies if scale < 1.0 else "one of the two has a wrong scale"
    assert f"times the turn of the heading (YAW): {wrong}" in turn
    (move,) = said(velocity=scale * VELOCITY)
    assert "times the change of position (POSITION)" in move
    found = rate_agreement(T, PLACE, T, scale * VELOCITY, 4.0, 1.5)
    assert found is not None
    assert found.scale == pytest.approx(scale, abs=0.01)


@pytest.mark.parametrize(
    ("change", "mistake"),
    [
        ({"yaw_rate": np.degrees(YAW_RATE)}, "degrees taken for radians?"),
        ({"velocity": 1.9438 * VELOCITY}, "knots taken for m/s?"),
        ({"velocity": VELOCITY / 3.6}, "m/s taken for km/h?"),
        ({"yaw_rate": -YAW_RATE}, "the sign of one of the two is turned round"),
    ],
)
def test_the_usual_mistakes_are_named(change: dict[str, Floats], mistake: str) -> None:
    (text,) = said(**change)
    assert text.endswith(mistake)


def test_a_compass_that_lags_is_told_with_its_time() -> None:
    late = np.interp(T - 0.4, T, YAW)
    (text,) = said(yaw=late)
    late_s = float(text.removeprefix("yaw (YAW) comes ").split()[0])
    assert late_s == pytest.approx(0.4, abs=0.02)
    assert "s after yaw rate (YAW RATE)" in text
    assert text.endswith(": comparisons and fits take yaw that much earlier")
    assert said(yaw=np.interp(T - 0.1, T, YAW)) == ()  # a gyro's filter does that
    (early,) = said(yaw_rate=np.interp(T - 0.4, T, YAW_RATE))
    assert (
        "s before yaw rate (YAW RATE): comparisons and fits take yaw rate that much earlier"
        in early
    )


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"yaw_rate": 0.88 * YAW_RATE}, "yaw rate"),
        ({"velocity": 1.15 * VELOCITY}, "velocity"),
        ({"yaw": np.interp(T - 0.4, T, YAW)}, "yaw"),
        ({"yaw_rate": np.interp(T - 0.4, T, YAW_RATE)}, "yaw rate"),
    ],
)
def test_which_is_plainly_wrong_is_set_right_and_nothing_else(
    change: dict[str, Floats], name: str
) -> None:
    given = of_a_boat(**change)
    right, (text,), _ = reconciled(given)
    assert "comparisons and fits take" in text
    assert [n for n, choice in right.items() if choice is not given[n]] == [name]
    assert reconciled(right).contradictions == ()
    true = of_a_boat()[name].samples
    at = right[name].samples.seconds()
    own = [np.interp(at, true.seconds(), column) for column in np.unwrap(true.values, axis=0).T]
    off = np.unwrap(right[name].samples.values, axis=0) - np.stack(own, axis=1)
    assert np.sqrt(np.mean(off[20:-20] ** 2)) < 0.05  # as their noise


def lagged(x: Floats, tau: float) -> Floats:
    """A first-order filter of time constant tau [s]."""
    out = x.copy()
    for k in range(1, len(x)):
        out[k] = out[k - 1] + (x[k] - out[k - 1]) / (1.0 + tau * RATE_HZ)
    return out


ZIGZAG = 0.8 * np.sin(0.9 * T) + 0.02 * T


@pytest.mark.parametrize("tau", [0.5, 0.8])
def test_a_filtered_compass_on_a_zigzag_is_no_fault_of_the_gyro(tau: float) -> None:
    """It lacks what is fast, so that the gyro seems to turn too far."""
    given = of_a_boat(yaw=lagged(ZIGZAG, tau), yaw_rate=np.gradient(ZIGZAG, T))
    right, told, _ = reconciled(given)
    assert right["yaw rate"] is given["yaw rate"]
    assert any(text.startswith("yaw (YAW) comes ") for text in told)


@pytest.mark.parametrize("seconds", [1.0, 1.5, 2.0])
def test_nor_is_a_heading_that_is_smoothed_to_both_sides(seconds: float) -> None:
    wide = np.ones(int(seconds * RATE_HZ)) / int(seconds * RATE_HZ)
    smooth = np.convolve(np.pad(ZIGZAG, 40, mode="edge"), wide, mode="same")[40:-40]
    right, *_ = reconciled(given := of_a_boat(yaw=smooth, yaw_rate=np.gradient(ZIGZAG, T)))
    assert right["yaw rate"] is given["yaw rate"]


def test_a_scale_and_a_time_are_both_told_and_neither_is_set_right() -> None:
    given = of_a_boat(yaw=np.interp(T - 0.4, T, YAW), yaw_rate=0.85 * YAW_RATE)
    right, told, _ = reconciled(given)
    assert right == given
    assert [text.split(" (")[0] for text in told] == ["yaw rate", "yaw"]


def test_a_velocity_on_board_is_turned_by_the_heading_that_was_set_right() -> None:
    ahead = np.stack([SPEED, np.zeros_like(SPEED)], axis=1)
    (text,) = said(yaw=np.interp(T - 0.9, T, YAW), velocity=ahead, body=True)
    assert text.startswith("yaw (YAW) comes 0.9")


@pytest.mark.parametrize(
    ("name", "scale", "late_s"),
    [("yaw rate", 0.85, 0.0), ("velocity", 0.9, 0.0), ("yaw", 1.0, 0.5), ("yaw rate", 1.0, 0.4)],
)
def test_a_log_of_the_firmware_whose_sensor_was_spoilt_is_nearly_as_it_was(
    name: str, scale: float, late_s: float, shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motion of a boat that was not made here; its gyro is filtered, 0.06 s late as it is."""

    def motion(chosen: Callable[..., Any], right: bool = True) -> Trial:
        monkeypatch.setattr(trials, "choose", chosen)
        monkeypatch.setattr(
            trials, "reconciled", reconciled if right else lambda c: Reconciled(c, ())
        )
        return load_trials(shared_data / "sitl" / "otter_calm.tlog")[0]

    def spoilt(samples: Any) -> dict[str, Choice]:
        out = dict(choose(samples))
        given = out[name].samples
        time = given.vehicle_time_ns + round(late_s * 1e9)
        changed = replace(given, values=scale * given.values, vehicle_time_ns=time)
        return out | {name: replace(out[name], samples=changed)}

    true = motion(choose)
    assert true.contradictions == ()

    def off(trial: Trial) -> float:
        at = true.time + 1e-9 * (true.start_time_ns - trial.start_time_ns)
        nu = np.stack([np.interp(at, trial.time, x) for x in trial.nu.T], axis=1)
        return float(np.sqrt(np.mean((nu - true.nu)[true.usable][20:-20] ** 2)))

    mended, left = motion(spoilt), motion(spoilt, right=False)
    (text,) = mended.contradictions
    assert f"comparisons and fits take {name}" in text
    assert off(mended) < 0.25 * off(left)


@pytest.mark.parametrize(
    "change",
    [
        {"velocity": 1.9438 * VELOCITY},  # a unit is for its owner to set right
        {"yaw_rate": -YAW_RATE},
        {"velocity": VELOCITY[:, ::-1]},
        {"place": np.stack([np.interp(T - 0.6, T, x) for x in PLACE.T], axis=1)},  # which is late?
    ],
)
def test_where_it_is_not_plain_which_is_wrong_all_stay(change: dict[str, Floats]) -> None:
    given = of_a_boat(**change)
    right, told, _ = reconciled(given)
    assert told
    assert not any("fits take" in text for text in told)
    assert all(choice is given[name] for name, choice in right.items())


def test_a_heading_that_is_set_anew_now_and_then_is_no_scale() -> None:
    jumps = 0.4 * (T > 100.0) - 0.6 * (T > 200.0)
    assert said(yaw=YAW + jumps) == ()


def test_where_little_moves_nothing_is_told() -> None:
    still = np.zeros_like(T)
    of_still = Turns(T, still, True)
    assert rate_agreement(T, still[:, None], T, still[:, None], 2.0, 0.1, of_still) is None
    moored = rng.normal(0.0, 0.3, (len(T), 2))
    assert said(yaw=still, yaw_rate=still, velocity=0.0 * VELOCITY, place=moored) == ()
    once = np.where((T > 50.0) & (T < 60.0), 0.3, 0.0)  # one turn tells too little
    turned = np.cumsum(once) / RATE_HZ
    of_once = Turns(T, turned, True)
    assert rate_agreement(T, turned[:, None], T, 0.8 * once[:, None], 2.0, 0.1, of_once) is None


@pytest.mark.parametrize("scale", [1.0, 0.9])
def test_a_steady_circle_tells_no_scale_from_a_bias(scale: float) -> None:
    """What the gyro varies by there is its noise: that would be a scale of many times one."""
    rate = np.full_like(T, 0.3)
    assert said(yaw=0.3 * T, yaw_rate=scale * rate) == ()
    slow = 0.3 + 0.01 * np.sin(2.0 * np.pi * T / 20.0)
    assert said(yaw=np.cumsum(slow) / RATE_HZ, yaw_rate=scale * slow) == ()
    (sign,) = said(yaw=0.3 * T, yaw_rate=-rate)  # no bias does that
    assert sign.endswith("the sign of one of the two is turned round")


def lawnmower(seconds: float = 600.0) -> Floats:
    """Headings of a boat that sails legs of 20 s and turns by 180°, to either side in turn."""
    time = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    turning = time % 26.0 > 20.0
    side = np.where(time // 26.0 % 2 == 0, 1.0, -1.0)
    return np.asarray(np.cumsum(turning * side * np.pi / 6.0) / RATE_HZ)


@pytest.mark.parametrize("soft", [0.05, 0.1])
def test_iron_on_board_is_no_scale_where_the_same_half_circle_is_turned_again(soft: float) -> None:
    yaw = lawnmower()
    time = np.arange(len(yaw)) / RATE_HZ
    off = yaw + soft * np.sin(2.0 * yaw + 0.3) + rng.normal(0.0, 0.01, len(yaw))
    rate = np.gradient(yaw, time) + rng.normal(0.0, 0.01, len(yaw))
    sensors = {
        "yaw": choice("yaw", np.angle(np.exp(1j * off)), Quantity.YAW, time),
        "yaw rate": choice("yaw rate", rate, Quantity.YAW_RATE, time),
    }
    assert reconciled(sensors).contradictions == ()
    sensors["yaw rate"] = choice("yaw rate", np.degrees(rate), Quantity.YAW_RATE, time)
    assert reconciled(sensors).contradictions[0].endswith("degrees taken for radians?")


def test_an_antenna_elsewhere_is_no_lateness_and_no_scale() -> None:
    for x, y in ((0.8, 0.0), (0.0, 0.5)):
        c, s = np.cos(YAW), np.sin(YAW)
        arm = np.stack([x * c - y * s, x * s + y * c], axis=1)
        assert said(place=PLACE + arm) == ()


def test_a_compass_mounted_askew_is_no_scale_of_a_speed_on_board() -> None:
    ahead = np.stack([SPEED, np.zeros_like(SPEED)], axis=1)
    assert said(yaw=YAW + 0.4, velocity=ahead, body=True) == ()
    (knots,) = said(yaw=YAW + 0.4, velocity=1.9438 * ahead, body=True)
    assert knots.endswith("knots taken for m/s?")


def test_a_boat_at_anchor_and_spikes_are_no_scale() -> None:
    wander = rng.normal(0.0, 0.3, (len(T), 2)).cumsum(axis=0) * 0.05
    assert said(velocity=0.0 * VELOCITY, place=wander) == ()
    spike = YAW_RATE.copy()
    spike[700] = 1000.0
    assert said(yaw_rate=spike) == ()


def test_a_position_that_comes_far_too_late_is_late_and_no_scale() -> None:
    late = np.stack([np.interp(T - 1.5, T, PLACE[:, i]) for i in (0, 1)], axis=1)
    (text,) = said(place=late)
    assert text.startswith("position (POSITION) comes 1.")
    assert "times" not in text


def test_the_first_fix_of_a_log_may_be_anywhere() -> None:
    degrees = np.stack([52.0 + PLACE[:, 0] / 111_120.0, 11.0 + PLACE[:, 1] / 68_400.0], axis=1)
    degrees[0] = 0.0
    sensors = {
        "yaw": choice("yaw", YAW, Quantity.YAW),
        "velocity": choice("velocity", VELOCITY, Quantity.VELOCITY),
        "position": choice("position", degrees, Quantity.GLOBAL_POSITION),
    }
    assert reconciled(sensors).contradictions == ()


def test_a_silence_of_one_sensor_is_no_contradiction() -> None:
    silent = (T > 80.0) & (T < 140.0)
    found = rate_agreement(
        T[~silent], YAW[~silent, None], T, YAW_RATE[:, None], 2.0, 0.1, Turns(T, YAW, True)
    )  # fmt: skip
    assert found is not None
    assert found.scale == pytest.approx(1.0, abs=0.01)
    assert rate_agreement(T[::20], YAW[::20, None], T, YAW_RATE[:, None], 2.0, 0.1) is None


def test_damaged_values_and_times_are_no_contradiction() -> None:
    wild = PLACE.copy()
    wild[320] = 1e300
    assert rate_agreement(T, wild, T, VELOCITY, 4.0, 1.5) is None
    fast = VELOCITY.copy()
    fast[320] = 1e300
    assert rate_agreement(T, PLACE, T, fast, 4.0, 1.5) is None
    late = T.copy()
    late[-1] = 1e9
    assert rate_agreement(late, PLACE, late, VELOCITY, 4.0, 1.5) is None
    lost = PLACE.copy()
    lost[300] = np.nan
    assert said(place=lost, velocity=np.where(T[:, None] == 7.0, np.inf, VELOCITY)) == ()
    once = {"yaw": choice("yaw", YAW[:1], Quantity.YAW, T[:1])}
    assert reconciled(once) == (once, (), ())
    assert reconciled({}) == ({}, (), ())


def test_what_is_not_sure_is_not_told() -> None:
    sure = RateAgreement(0.9, 0.01, 0.0, 0.01)
    assert sure.contradicts
    assert not sure._replace(scale_std=0.03).contradicts
    assert not sure._replace(scale=0.95).contradicts
    assert sure._replace(late_s=-0.3).is_late
    assert not sure._replace(late_s=-0.3, late_std=0.1).is_late


def test_a_trial_holds_what_its_sensors_contradict(tmp_path: Path) -> None:
    path, _ = written(tmp_path, Traps())
    (honest,) = load_trials(path)
    assert honest.contradictions == ()
    mapping = path.with_suffix(".toml")
    text = mapping.read_text(encoding="utf-8")
    mapping.write_text(text.replace("rad/s", "deg/s"), encoding="utf-8")
    (wrong,) = load_trials(path)
    assert "radians taken for degrees?" in wrong.contradictions[0]
    assert wrong.notices[0] == wrong.contradictions[0]


@pytest.mark.parametrize(
    ("factor", "mistake"),
    [
        (np.pi / 180.0, "57.3 times: radians taken for degrees?"),
        (180.0 / np.pi, "0.0175 times: degrees taken for radians?"),
    ],
)
def test_headings_in_the_other_unit_are_told(factor: float, mistake: str) -> None:
    """They hardly turn, or wrap elsewhere than at a full circle: their scale does not show it."""
    wrapped = factor * (YAW % (2.0 * np.pi))
    sensors = {
        "yaw": choice("yaw", wrapped, Quantity.YAW),
        "yaw rate": choice("yaw rate", YAW_RATE + rng.normal(0.0, 0.01, len(T)), Quantity.YAW_RATE),
    }
    (text,) = reconciled(sensors).contradictions
    assert text.endswith(mistake)
    sensors["yaw"] = choice("yaw", 0.02 * np.sin(YAW), Quantity.YAW)  # another heading at all
    assert reconciled(sensors).contradictions == ()


def test_positions_are_metres_about_where_most_of_them_lie() -> None:
    """A first fix on the equator would stretch the boat's way east to twice its length."""
    fixes = np.array([[0.0, 0.0], *([60.0, 10.0 + 1e-5 * k] for k in range(9))])
    local = metres(fixes, Quantity.GLOBAL_POSITION)
    a_step = 1e-5 * np.radians(6378137.0) * np.cos(np.radians(60.0))
    assert np.diff(local[1:, 1]) == pytest.approx(a_step, rel=0.01)
    assert np.array_equal(metres(fixes, Quantity.POSITION), fixes)


@pytest.mark.parametrize(
    "change",
    [
        {"velocity": VELOCITY[:, ::-1]},
        {"place": PLACE[:, ::-1]},
        {"velocity": VELOCITY * [1.0, -1.0]},
        {"velocity": VELOCITY * [-1.0, 1.0]},
    ],
)
def test_north_and_east_exchanged_are_told(change: dict[str, Floats]) -> None:
    (one,) = said(**change)
    assert "mirror images: north and east of one are exchanged" in one


def test_what_may_be_a_mirror_image_and_need_not_is_not_told() -> None:
    """Straight to the north-east nothing tells the two apart; both turned round is a sign."""
    ahead = np.stack([SPEED, SPEED], axis=1)
    way = np.cumsum(ahead, axis=0) / RATE_HZ
    assert said(velocity=ahead, place=way) == ()
    (one,) = said(velocity=-VELOCITY)
    assert "mirror" not in one


def test_what_a_compass_deviates_by_is_told_by_the_gyro() -> None:
    """By headings as they are shown; of an offset, a bias, a scale or lateness nothing is."""
    shown = YAW.copy()
    for _ in range(8):
        shown = YAW + 0.2 * np.sin(shown) - 0.1 * np.cos(shown)
    deviation = reconciled(of_a_boat(yaw=shown)).deviation
    assert deviation[:2] == pytest.approx((0.2, -0.1), abs=0.01)
    assert deviation[2:] == (0.0, 0.0)
    soft = reconciled(of_a_boat(yaw=YAW + 0.08 * np.sin(2.0 * YAW))).deviation
    assert soft[2] == pytest.approx(0.08, abs=0.02)
    for other in (
        {"yaw": YAW + 0.3}, {"yaw_rate": YAW_RATE + 0.05}, {"yaw_rate": 1.15 * YAW_RATE},
        {"yaw": np.interp(T - 0.4, T, YAW)}, {"yaw": YAW + 0.01 * np.sin(YAW)},
    ):  # fmt: skip
        assert reconciled(of_a_boat(**other)).deviation == ()
