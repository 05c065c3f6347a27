"""DataFlash logs of other years and habits: each is read, or says in a line what it lacks."""

from pathlib import Path

import numpy as np
import pytest

from gateway.ingest.log import choose_boat
from gateway.ingest.log_events import log_events
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.offline.trials import load_trials
from gateway.offline.usable_time import EKF_ILL, LANE_SWITCH
from gateway.samples import Quantity
from gateway.vessel_file import dump_vessel
from tests.gateway.command_line import Run, one_line
from tests.gateway.ingest.dataflash_writer import (
    BANNERS,
    CH12,
    FORMATS,
    WEEK,
    WEEK_MS,
    Lanes,
    voyage_log,
)
from tests.sim.vessels import WAMV

YEARS = tuple(FORMATS)
KALMAN = {2014: "EKF1", 2015: "EKF1", 2025: "XKF1"}
FILTERS = ("EKF1", "XKF1")


def written(folder: Path, raw: bytes) -> Path:
    path = folder / "voyage.BIN"
    path.write_bytes(raw)
    return path


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    path = tmp_path / "boat.toml"
    path.write_text(dump_vessel(WAMV), encoding="utf-8")
    return path


@pytest.mark.parametrize("year", YEARS)
def test_every_quantity_of_a_year_is_found(tmp_path: Path, year: int) -> None:
    log = open_log(written(tmp_path, voyage_log(year)))
    decoded = log.decode(choose_boat(log))
    found = {name: choice.source for name, choice in choose(decoded.samples).items()}
    kalman = KALMAN[year]
    assert found["velocity"] == found["position"] == kalman
    assert (found["yaw"], found["yaw rate"], found["commands"]) == ("ATT", "IMU", "RCOU")
    assert decoded.notices == ()
    assert decoded.boat.type == "rover or boat"
    assert log.firmware(decoded.boat) == BANNERS[year]
    voltage = decoded.of(Quantity.VOLTAGE)[0].values
    assert voltage == pytest.approx(12.4, abs=1e-5)


@pytest.mark.parametrize("year", YEARS)
def test_the_trial_of_a_year_is_that_of_today(tmp_path: Path, year: int) -> None:
    mine = load_trials(written(tmp_path, voyage_log(year)))[0]
    today = load_trials(written(tmp_path, voyage_log(2025)))[0]
    count = min(len(mine), len(today))
    assert count > 380
    assert mine.channels == today.channels
    assert np.nanmax(np.abs(mine.pwm[5:count] - today.pwm[5:count])) < 2.0
    assert np.max(np.abs(mine.nu[20:count] - today.nu[20:count])) < 0.02
    unix_s = 315_964_800 + WEEK * 604_800 - 18 + WEEK_MS * 1e-3 + 100.0
    assert mine.start_time_ns * 1e-9 == pytest.approx(unix_s, abs=0.5)


@pytest.mark.parametrize("year", YEARS)
def test_without_parameters_arming_and_texts_a_log_is_compared_and_replayed(
    run: Run, boat: Path, tmp_path: Path, year: int
) -> None:
    path = written(tmp_path, voyage_log(year, without=("PARM", "ARM", "EV", "MSG")))
    assert run("info", path).status == 0
    done = run("compare", path, "-v", boat)
    assert (done.status, "WAM-V" in done.out) == (0, True)
    words = ["replay", path, "-v", boat, "--no-publish", "--out", tmp_path / "out"]
    assert run(*words).status == 0


def test_gps_alone_tells_no_heading(run: Run, boat: Path, tmp_path: Path) -> None:
    only = {"IMU", "ATT", "EKF1", "XKF1", "PARM", "MSG", "RCIN", "ARM", "EV", "BAT", "CURR"}
    path = written(tmp_path, voyage_log(2025, without=only))
    done = run("info", path)
    assert done.status == 0
    assert "no heading" in done.out
    one_line(run("compare", path, "-v", boat), 2, "no heading in it")
    one_line(run("replay", path, "-v", boat, "--no-publish"), 2, "nothing in it tells yaw")


def test_without_outputs_there_is_nothing_to_compare(run: Run, boat: Path, tmp_path: Path) -> None:
    path = written(tmp_path, voyage_log(2015, without=("RCOU",)))
    assert run("info", path).status == 0
    one_line(run("compare", path, "-v", boat), 2, "no servo outputs in it")


def test_the_gps_is_enough_beside_a_compass(tmp_path: Path) -> None:
    path = written(tmp_path, voyage_log(2015, without=FILTERS))
    trial = load_trials(path)[0]
    assert trial.sources["velocity"] == "GPS"
    assert trial.sources["yaw"] == "ATT"


def test_a_receiver_that_never_had_a_fix_gives_no_motion(
    run: Run, boat: Path, tmp_path: Path
) -> None:
    path = written(tmp_path, voyage_log(2014, without=FILTERS, fix=False))
    assert run("info", path).status == 0
    one_line(run("compare", path, "-v", boat), 2, "no velocity or position in it")
    one_line(run("replay", path, "-v", boat, "--no-publish"), 2, "nothing in it tells velocity")


def test_outputs_under_names_that_nobody_knows_are_said_to_be_unreadable(tmp_path: Path) -> None:
    raw = voyage_log(2015).replace(CH12.encode(), CH12.replace("Ch", "Pa").encode())
    log = open_log(written(tmp_path, raw))
    decoded = log.decode(choose_boat(log))
    assert not decoded.of(Quantity.ACTUATORS)
    assert decoded.notices == ("RCOU cannot be read: its fields are not those that RCOU has",)


def happened(path: Path) -> list[str]:
    log = open_log(path)
    return [one.text for one in log_events(log, choose_boat(log)) if "EKF" in one.text]


def test_a_lane_that_went_wrong_and_was_left_is_not_read(tmp_path: Path) -> None:
    """The lane most in use was read throughout: 0.8 m/s wrong while the boat followed another."""
    plain = load_trials(written(tmp_path, voyage_log(2025, 60.0)))[0]
    path = written(tmp_path, voyage_log(2025, 60.0, lanes=Lanes((20.0, 40.0))))
    (trial,) = load_trials(path)
    count = min(len(trial), len(plain))
    assert np.max(np.abs(trial.nu[20:count] - plain.nu[20:count])) < 0.02
    left_out = [(s.start, s.end) for s in trial.excluded if s.why == LANE_SWITCH]
    assert left_out == [pytest.approx((at - 5.0, at + 5.0), abs=0.3) for at in (20.0, 40.0)]
    assert not any(s.why == EKF_ILL for s in trial.excluded)
    text = "the autopilot's EKF switches from lane 0 to lane 1"
    assert any(n.startswith(f"{text} at 20 s of the log, the first of 2") for n in trial.notices)
    assert happened(path) == [text, "the autopilot's EKF switches from lane 1 to lane 0"]


def test_a_lane_that_says_it_is_ill_judges_no_model(tmp_path: Path) -> None:
    """As EKF_STATUS_REPORT does in telemetry."""
    path = written(tmp_path, voyage_log(2025, 60.0, lanes=Lanes((20.0, 40.0), left=False)))
    (trial,) = load_trials(path)
    (ill,) = ((s.start, s.end) for s in trial.excluded if s.why == EKF_ILL)
    assert ill == pytest.approx((20.0, 45.0), abs=0.3)
    assert trial.sources["estimator"] == "XKF4"
    assert happened(path) == [
        "the autopilot's EKF is unhealthy: velocity, position, rejects",
        "the autopilot's EKF is healthy again",
    ]


def test_the_fix_of_the_second_receiver_counts(tmp_path: Path) -> None:
    log = open_log(written(tmp_path, voyage_log(2025, 20.0, fix=False, second_fix=True)))
    fix = choose(log.decode(choose_boat(log)).samples)["fix"].samples.values[:, 0]
    assert fix[1:].min() == 3.0
    assert load_trials(log.path)[0].usable.any()
