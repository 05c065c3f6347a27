"""Recordings become trials: motion as it was, commands as they were, stretches with a reason."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import join, make_events
from gateway.estimation.smoother import smooth
from gateway.fleet.analysis import summary_of
from gateway.ingest.open import open_log
from gateway.ingest.ulog.log import ulog_from_bytes
from gateway.offline import usable_time
from gateway.offline.trials import (
    AS_REPORTED,
    DEFAULT_TRIALS,
    TrialOptions,
    date_of,
    load_trials,
    source_of,
    trials_of,
)
from gateway.simulated_boat.play import write_log
from gateway.vessel_file import load_vessel
from sim.diagnosis.thresholds import MIN_RATE_HZ
from sim.effects.catalogue import named
from sim.identification.identify import held_out
from sim.state import Eta, Nu
from sim.trial import Stretch, Trial
from sim.vessel import AddedEffect
from tests.conftest import ROOT
from tests.gateway.estimation.boat import gauss_markov, weaving_boat
from tests.gateway.ingest.scripted import (
    Script,
    attitude,
    ekf_status,
    gps,
    gps2,
    heartbeat,
    local_position,
    servo,
    vfr_hud,
)
from tests.gateway.ingest.test_parameters import parameter
from tests.gateway.ingest.ulog_writer import as_ulog
from tests.sim.voyages import WAM_V, simulated

SPEED, RATE = 1.5, 0.1  # m/s, rad/s


def circle(
    script: Script, boot_s: float, receipt_s: float, seconds: float, armed: bool = True
) -> None:
    """A steady turn to starboard, told at 10 Hz, that goes on where an earlier one ended; velocity
    from VFR_HUD contradicts it."""
    for t in np.arange(0.0, seconds, 0.1):
        boot, receipt, yaw = boot_s + t, receipt_s + t, RATE * (receipt_s + t)
        script.send(receipt, attitude(boot, (yaw + np.pi) % (2 * np.pi) - np.pi, RATE))
        north, east = SPEED / RATE * np.sin(yaw), SPEED / RATE * (1.0 - np.cos(yaw))
        script.send(
            receipt,
            local_position(boot, north, east, SPEED * np.cos(yaw), SPEED * np.sin(yaw)),
        )
        script.send(receipt, servo(boot, 1700, 0, 1600))
        script.send(receipt, vfr_hud(speed=9.0))
        if round(t * 10) % 10 == 0:
            script.send(receipt, heartbeat(armed))


def one(script: Script, options: TrialOptions = DEFAULT_TRIALS) -> Trial:
    (trial,) = trials_of(script.log(), options=options)
    return trial


def test_the_velocities_of_a_ulog_are_of_a_filter_too() -> None:
    """Of the real firmware's an exact mass lay outside an interval as narrow as without one."""
    log = ulog_from_bytes(as_ulog(ROOT / "recordings" / "otter_piece.tlog").bytes())
    trial = trials_of(log)[0]
    assert trial.sources["velocity"] == "vehicle_local_position"
    assert trial.filtered


def test_a_steady_turn_is_found_as_it_was() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 80.0)
    trial = one(script)
    inside = slice(50, -50)
    assert trial.dt == pytest.approx(0.1)
    assert trial.nu[inside] == pytest.approx(
        np.tile([SPEED, 0.0, RATE], (len(trial) - 100, 1)), abs=0.01
    )
    assert trial.eta[-1, Eta.YAW] - trial.eta[0, Eta.YAW] == pytest.approx(
        RATE * trial.time[-1], abs=0.02
    )
    assert trial.channels == (1, 3)
    assert np.nanmin(trial.pwm, axis=0) == pytest.approx([1700.0, 1600.0])
    assert trial.sources["velocity"] == "LOCAL_POSITION_NED"
    assert trial.filtered
    assert trial.usable[20:-20].all()


def test_the_yaw_rate_is_taken_as_reported_where_no_parameter_tells_its_delay() -> None:
    """A live filter doubts it; a smoothed one would be four times as uncertain for it."""
    script = Script()
    circle(script, 100.0, 0.0, 20.0)
    before = one(script)
    script.send(20.0, parameter("INS_GYRO_FILTER", 0.0))
    told = one(script)
    assert np.array_equal(before.nu, told.nu)
    assert np.array_equal(before.covariance, told.covariance)


def test_disarmed_means_no_pulse_and_a_listed_stretch() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 20.0, armed=False)
    circle(script, 120.0, 20.0, 40.0, armed=True)
    trial = one(script)
    before = trial.time < 19.0
    assert not trial.usable[before].any()
    assert np.isnan(trial.pwm[before]).all()
    stretch = next(s for s in trial.excluded if s.why == usable_time.DISARMED)
    assert (stretch.start, stretch.end) == pytest.approx((0.0, 20.0), abs=0.2)


def test_what_excludes_can_be_kept() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 20.0, armed=False)
    kept = TrialOptions(keep=(usable_time.DISARMED, usable_time.NO_COMMANDS))
    assert one(script, kept).usable[20:-20].all()
    with pytest.raises(BadInput, match="nothing usable in it: disarmed"):
        trials_of(script.log())
    with pytest.raises(BadInput, match="cannot keep"):
        TrialOptions(keep=("the good parts",))


def test_a_gap_of_telemetry_is_excluded_and_a_long_one_splits() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 20.0)
    circle(script, 125.0, 25.0, 20.0)
    trial = one(script)
    gap = next(s for s in trial.excluded if s.why == usable_time.GAP)
    assert (gap.start, gap.end) == pytest.approx((19.9, 25.0), abs=0.21)
    circle(script, 245.0, 145.0, 20.0)
    assert [t.name for t in trials_of(script.log())] == ["scripted #1", "scripted #2"]


def test_a_reboot_starts_a_trial_of_its_own() -> None:
    script = Script()
    circle(script, 600.0, 0.0, 20.0)
    circle(script, 10.0, 22.0, 20.0)
    first, second = trials_of(script.log())
    assert second.start_time_ns > first.start_time_ns + 20_000_000_000
    assert second.nu[30:-30, Nu.U] == pytest.approx(SPEED, abs=0.01)


def test_lying_still_without_thrust_is_not_under_way() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 20.0)
    yaw = (20.0 * RATE + np.pi) % (2 * np.pi) - np.pi
    for t in np.arange(120.0, 150.0, 0.1):
        script.send(t - 100.0, attitude(t, yaw))
        script.send(t - 100.0, local_position(t))
        script.send(t - 100.0, servo(t, 1500, 0, 1500))
    assert any(s.why == usable_time.IDLE and s.end - s.start > 20.0 for s in one(script).excluded)


def test_a_spin_that_a_coarse_grid_cannot_follow_is_left_out_of_it() -> None:
    """4 rad/s: 0.8 rad from sample to sample at 5 Hz, 0.4 at 10 Hz."""
    script = Script()
    circle(script, 100.0, 0.0, 30.0)
    for t in np.arange(130.0, 135.0, 0.02):
        yaw = 30.0 * RATE + 4.0 * (t - 130.0)
        script.send(t - 100.0, attitude(t, (yaw + np.pi) % (2 * np.pi) - np.pi, 4.0))
        script.send(t - 100.0, local_position(t))
        script.send(t - 100.0, servo(t, 1700, 0, 1300))
    coarse, fine = (one(script, TrialOptions(rate_hz=hz)) for hz in (5.0, 10.0))
    (spin,) = (s for s in coarse.excluded if s.why == usable_time.SPINNING)
    assert (spin.start, spin.end) == pytest.approx((30.0, 35.0), abs=0.5)
    assert not any(s.why == usable_time.SPINNING for s in fine.excluded)


def test_without_a_fix_nothing_is_usable() -> None:
    script = Script()
    for start, fix in ((0.0, 2), (20.0, 3)):
        script.send(start, gps(100.0 + start, fix))
        circle(script, 100.0 + start, start, 20.0)
    stretches = [s for s in one(script).excluded if s.why == usable_time.NO_FIX]
    assert [(s.start, s.end) for s in stretches] == [pytest.approx((0.0, 20.0), abs=0.2)]


def test_a_fix_of_the_second_receiver_is_one() -> None:
    script = Script()
    script.send(0.0, gps(100.0, 0))
    script.send(0.0, gps2(100.0, 3))
    circle(script, 100.0, 0.0, 20.0)
    script.send(20.0, gps2(120.0, 1))
    circle(script, 120.0, 20.0, 20.0)
    stretches = [s for s in one(script).excluded if s.why == usable_time.NO_FIX]
    assert [(s.start, s.end) for s in stretches] == [pytest.approx((20.0, 40.0), abs=0.2)]


@pytest.mark.parametrize(("fix_then", "left_out"), [(1, []), (3, [(40.0, 60.0)])])
def test_an_ekf_that_never_had_a_fix_does_without(
    fix_then: int, left_out: list[tuple[float, float]]
) -> None:
    """By motion capture or a DVL; as live, where only a fix that was lost is missed."""
    script = Script()
    for start, fix in ((0.0, 1), (20.0, fix_then), (40.0, 1)):
        script.send(start, ekf_status())
        script.send(start, gps(100.0 + start, fix))
        circle(script, 100.0 + start, start, 20.0)
    stretches = [s for s in one(script).excluded if s.why == usable_time.NO_FIX]
    found = [(s.start, s.end) for s in stretches]
    assert found == [pytest.approx(span, abs=0.2) for span in left_out]


def test_what_an_ill_filter_reports_judges_no_model() -> None:
    """From 20 to 30 s it has no velocity and says so: what it reports then is half of the truth."""
    script = Script()
    circle(script, 100.0, 0.0, 20.0)
    for t in np.arange(20.0, 30.0, 0.1):
        yaw = RATE * t
        script.send(t, attitude(100.0 + t, (yaw + np.pi) % (2 * np.pi) - np.pi, RATE))
        north, east = SPEED / RATE * np.sin(yaw), SPEED / RATE * (1.0 - np.cos(yaw))
        slow = 0.5 * SPEED
        wrong = local_position(100.0 + t, north, east, slow * np.cos(yaw), slow * np.sin(yaw))
        script.send(t, wrong)
        script.send(t, servo(100.0 + t, 1700, 0, 1600))
    for t in np.arange(0.0, 30.0, 0.5):
        alone = t == 5.0  # one damaged report is no illness
        script.send(t + 0.01, ekf_status(ill=alone or t >= 20.0))
    trial, blind = one(script), one(script, TrialOptions(keep=(usable_time.EKF_ILL,)))
    (stretch,) = (s for s in trial.excluded if s.why == usable_time.EKF_ILL)
    assert (stretch.start, stretch.end) == pytest.approx((20.0, 30.0), abs=0.2)
    off, taken = (np.abs(t.nu[t.usable, Nu.U] - SPEED).max() for t in (trial, blind))
    assert off < 0.2 < 0.5 < taken


def test_outputs_that_are_set_otherwise_midway_are_known_with_their_time() -> None:
    script = Script()
    names = ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
    for name, value in zip(names, (73.0, 1100.0, 1500.0, 1900.0, 0.0), strict=True):
        script.send(0.0, parameter(f"SERVO1_{name}", value))
    circle(script, 100.0, 0.0, 20.0)
    script.send(20.0, parameter("SERVO1_REVERSED", 1.0))
    circle(script, 120.0, 20.0, 20.0)
    trial = one(script)
    assert [servo.reversed for servo in trial.outputs] == [False]
    (later,) = trial.outputs_set
    assert later.start == pytest.approx(20.0, abs=0.1)
    assert [servo.reversed for servo in later.outputs] == [True]


def test_a_heading_that_stays_frozen_judges_no_model() -> None:
    script = Script()
    circle(script, 100.0, 0.0, 20.0)
    for t in np.arange(20.0, 30.0, 0.1):
        yaw = RATE * t
        script.send(t, attitude(100.0 + t, RATE * 20.0, RATE))
        north, east = SPEED / RATE * np.sin(yaw), SPEED / RATE * (1.0 - np.cos(yaw))
        velocity = (SPEED * np.cos(yaw), SPEED * np.sin(yaw))
        script.send(t, local_position(100.0 + t, north, east, *velocity))
        script.send(t, servo(100.0 + t, 1700, 0, 1600))
    trial, blind = one(script), one(script, TrialOptions(keep=(usable_time.FROZEN,)))
    (stretch,) = (s for s in trial.excluded if s.why == usable_time.FROZEN)
    assert (stretch.start, stretch.end) == pytest.approx((20.0, 30.0), abs=0.2)
    off, taken = (np.abs(t.nu[t.usable, Nu.U] - SPEED).max() for t in (trial, blind))
    assert off < 0.2 < 0.5 < taken


def test_what_is_missing_is_said() -> None:
    script = Script()
    for t in np.arange(0.0, 20.0, 0.1):
        script.send(t, heartbeat())
        script.send(t, local_position(100.0 + t))
    with pytest.raises(BadInput, match="no heading in it"):
        trials_of(script.log())
    for t in np.arange(20.0, 40.0, 0.1):
        script.send(t, attitude(100.0 + t))
        script.send(t, local_position(100.0 + t))
    with pytest.raises(BadInput, match="no servo outputs in it"):
        trials_of(script.log())
    assert len(trials_of(script.log(), options=TrialOptions(motion_only=True))) == 1


def test_positions_in_degrees_become_metres_about_their_origin(tmp_path: Path) -> None:
    rows = [f"{t:.1f},0,{50.0 + 1e-5 * t:.9f},8.0,1600" for t in np.arange(0.0, 30.0, 0.1)]
    (tmp_path / "run.csv").write_text("t,yaw,lat,lon,left\n" + "\n".join(rows))
    (tmp_path / "names.toml").write_text(
        'time = { column = "t", unit = "s" }\n[columns]\n'
        'yaw = { column = "yaw", unit = "deg" }\n'
        'latitude = { column = "lat", unit = "deg" }\n'
        'longitude = { column = "lon", unit = "deg" }\n'
        'channel_1 = { column = "left", unit = "us" }\n'
    )
    (trial,) = load_trials(tmp_path / "run.csv", mapping=tmp_path / "names.toml")
    assert trial.origin_deg == pytest.approx((50.0, 8.0))
    assert trial.nu[100:-100, Nu.U] == pytest.approx(1.1123, abs=0.02)


def boot_aligned(shared_data: Path, name: str) -> Trial:
    (trial,) = trials_of(open_log(shared_data / "sitl" / name), options=TrialOptions(rate_hz=20.0))
    return trial


@pytest.mark.slow
def test_both_logs_of_one_run_give_the_same_velocities(shared_data: Path) -> None:
    radio, board = (boot_aligned(shared_data, f"otter_calm.{kind}") for kind in ("tlog", "BIN"))
    first_ms = open_log(shared_data / "sitl" / "otter_calm.tlog").table("LOCAL_POSITION_NED")
    first_us = open_log(shared_data / "sitl" / "otter_calm.BIN").table("XKF1")
    starts = first_ms.columns["time_boot_ms"][0] * 1e-3, first_us.columns["TimeUS"][0] * 1e-6
    moments = board.time + (starts[1] - starts[0])
    inside = board.usable & (board.time > 5.0) & (board.time < 540.0)
    for component, limit in ((Nu.U, 0.003), (Nu.V, 0.003), (Nu.R, 0.001)):
        there = np.interp(moments, radio.time, radio.nu[:, component])
        apart = (there - board.nu[:, component])[inside]
        assert np.sqrt(np.mean(apart**2)) < limit, component.name
        allowed = 3.0 * np.hypot(*(t.std()[:, 3 + component].mean() for t in (radio, board)))
        assert np.percentile(np.abs(apart), 99) < allowed, component.name


USABLE = {
    "bluerov.tlog": "",
    "three-sessions-zero-holes-clock-back.tlog": "",
    # Its EKF reports stay in constant-position mode: no GPS was ever used.
    "zero-tail.tlog": "nothing usable in it: disarmed 16 s, the autopilot's EKF unhealthy",
    "mavlink1-cut-tail.tlog": "",
    "mixed-mavlink-1-and-2-one-signed.tlog": "nothing usable in it: disarmed",
    "cut-inside-a-frame.tlog": "nothing usable in it: disarmed",
    "bluerov.BIN": "nothing usable in it",
    "dataflash-dropped-messages.bin": "no servo outputs in it",
}


DATED = 1_777_600_000 * 10**9  # ns


@pytest.mark.parametrize(("start_ns", "day"), [(DATED, "2026-05-01"), (10 * 10**9, ""), (0, "")])
def test_a_clock_that_counts_from_its_own_start_tells_no_date(start_ns, day) -> None:
    trial = replace(simulated(WAM_V, 8.0), start_time_ns=start_ns)
    assert date_of(trial) == day
    started = summary_of([trial])["started"]
    assert (started or "")[:10] == day
    assert summary_of([trial], DATED * 1e-9)["started"] is not None  # the boat's own clock has one


@pytest.mark.parametrize(
    ("seconds", "told"),
    [((16.0, 0.2), "disarmed 16 s"), ((0.3,), "disarmed 0 s"), ((), ""), ((2.0, 0.6),
     "disarmed 2 s, no 3-D fix 1 s")],
)  # fmt: skip
def test_what_excluded_less_than_half_a_second_is_told_only_alone(seconds, told) -> None:
    reasons = zip(seconds, ("disarmed", "no 3-D fix"), strict=False)
    stretches = tuple(Stretch(0.0, length, why) for length, why in reasons)
    assert usable_time.excluded_summary([SimpleNamespace(excluded=stretches)]) == told


@pytest.mark.parametrize("name", USABLE)
def test_every_odd_log_gives_trials_or_says_what_is_missing(shared_data: Path, name: str) -> None:
    path = shared_data / "odd-logs" / name
    motion = load_trials(path, options=TrialOptions(motion_only=True, anyway=True))
    assert all(np.isfinite(trial.nu).all() and np.isfinite(trial.std()).all() for trial in motion)
    if USABLE[name]:
        with pytest.raises(BadInput, match=f"{name}: {USABLE[name]}"):
            load_trials(path, options=TrialOptions(anyway=True))
    else:
        trials = load_trials(path, options=TrialOptions(anyway=True))
        assert any(trial.usable.any() for trial in trials)


@pytest.mark.parametrize("name", ["bluerov.tlog", "bluerov.BIN"])
def test_a_log_of_a_submarine_is_said_to_be_one(shared_data: Path, name: str) -> None:
    with pytest.raises(BadInput, match=r"says that it is a submarine: .*--anyway"):
        load_trials(shared_data / "odd-logs" / name)


LOG = ROOT / "recordings" / "voyage_1.tlog"


def test_beyond_the_guard_held_out_data_move_the_motion_by_3_percent_of_its_error():
    """So that a fit moves by 3 % of its standard deviation: smoothing twice would gain nothing."""
    options = TrialOptions()
    source = source_of(open_log(LOG), options)
    (span,) = source.spans()
    whole = source.trial("whole", span, options)
    cut = held_out(whole)
    assert cut is not None
    fit, judge = cut
    row = np.floor((source.events.time_s - span[0]) / whole.dt).astype(int)
    inside = (row >= 0) & (row < len(whole))
    kept = ~(inside & judge[np.clip(row, 0, len(whole) - 1)])
    alone = replace(source, events=source.events[kept]).trial("alone", span, options)
    std = whole.std()[:, 3:6]
    judged = np.sqrt(np.mean((alone.nu - whole.nu)[judge] ** 2 / std[judge] ** 2, axis=0))
    moved = np.sqrt(np.mean((alone.nu - whole.nu)[fit] ** 2 / std[fit] ** 2, axis=0))
    assert np.all(judged > 1.0)  # they are really left out
    assert np.all(moved < 0.03)


FAST, SLOW = 0.02, 0.04  # s between messages
LIVE = FilterSettings(heading_error_rad=1e-3)


def yaw_rate_error(settings: FilterSettings, seed: int) -> float:
    """Root mean square of means over 0.4 s [rad/s], a compass that wanders by 0.7° in a minute."""
    rng = np.random.default_rng(seed)
    truth = weaving_boat(rng, 80.0)
    fast, slow = np.arange(0.5, 79.0, FAST), np.arange(0.5, 79.0, SLOW)
    now, then = truth.at(fast), truth.at(slow)
    yaw = now[:, 2] + gauss_markov(rng, 0.012, 60.0, fast)
    c, s = np.cos(then[:, 2]), np.sin(then[:, 2])
    velocity = np.stack([c * then[:, 3] - s * then[:, 4], s * then[:, 3] + c * then[:, 4]], 1)
    rate = now[:, 5] + rng.normal(0.0, 0.002, len(fast))
    yaw_std = settings.white_std(MeasurementKind.YAW, "ATTITUDE")
    rate_std = settings.white_std(MeasurementKind.YAW_RATE, "ATTITUDE")
    velocity_std = settings.white_std(MeasurementKind.VELOCITY, "LOCAL_POSITION_NED")
    velocity += rng.normal(0.0, 0.02, velocity.shape)
    events = join([
        make_events(MeasurementKind.YAW, fast, yaw, yaw_std),
        make_events(MeasurementKind.YAW_RATE, fast, rate, rate_std),
        make_events(MeasurementKind.VELOCITY, slow, velocity, velocity_std),
    ])  # fmt: skip
    grid = np.arange(5.0, 74.99, 0.1)
    found = smooth(events[np.argsort(events.time_s, kind="stable")], grid, settings)
    error = (found.nu[:, 2] - truth.at(grid)[:, 5])[:696].reshape(-1, 4).mean(axis=1)
    return float(np.sqrt(np.mean(error**2)))


def test_a_wandering_compass_hardly_touches_the_yaw_rate():
    ours = np.mean([yaw_rate_error(AS_REPORTED, seed) for seed in range(3)])
    taken_as_white = np.mean([yaw_rate_error(LIVE, seed) for seed in range(3)])
    assert ours < 0.001
    assert ours < 0.5 * taken_as_white


def test_a_compass_that_deviates_is_followed_also_where_the_boat_spins(tmp_path: Path) -> None:
    """Its turn is not the gyro's by 0.3 rad/s: the trial's heading is what was reported, what is
    ahead and abeam goes by that, and the yaw rate is the gyro's.
    """
    plain, b, c = load_vessel(ROOT / "configs" / "vessels" / "blueboat.toml"), 0.12, -0.08
    iron = AddedEffect(named("compass_deviation"), {"b": b, "c": c})
    trials = []
    for name, vessel in (("plain", plain), ("iron", plain.with_effects(iron))):
        write_log(vessel, tmp_path / f"{name}.tlog", fast=True, seed=1, seconds=150.0)
        trials += load_trials(tmp_path / f"{name}.tlog", options=TrialOptions(rate_hz=5.0))
    yaw, reported = (trial.eta[:, Eta.YAW] for trial in trials)
    d = b * np.sin(yaw) + c * np.cos(yaw)
    off = np.angle(np.exp(1j * (reported - yaw - d)))
    (u, v, r), (ahead, abeam, turn) = (trial.nu.T for trial in trials)
    assert np.abs(r).max() > 1.5
    assert np.sqrt(np.mean(off**2)) < np.radians(0.5)
    assert np.sqrt(np.mean((ahead - np.cos(d) * u - np.sin(d) * v) ** 2)) < 0.02
    assert np.sqrt(np.mean((abeam + np.sin(d) * u - np.cos(d) * v) ** 2)) < 0.02
    assert np.sqrt(np.mean((turn - r) ** 2)) < 0.01


@pytest.mark.parametrize(("hz", "told"), [(0.49, True), (1.0, True), (2.0, False), (0.0, False)])
def test_outputs_that_are_told_too_seldom_are_a_notice(hz: float, told: bool) -> None:
    """Of a right model "something is missing that the catalogue does not hold" was all that was
    said.
    """
    found = usable_time.told_too_seldom({"commands": SimpleNamespace(rate_hz=hz)})  # type: ignore[dict-item]
    assert [f"outputs are told at {hz:.2g} Hz: " in text for text in found] == [True] * told
    assert all(f"({MIN_RATE_HZ:g} Hz are enough)" in text for text in found)  # for lags too
    assert usable_time.told_too_seldom({}) == []
