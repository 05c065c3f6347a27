"""A log alone: what it does not say is assumed, and every assumption is a sentence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.mapping import OutputFunction
from gateway.offline.from_log import assumed_actuators, begin_vessel, learn_from, split_time
from gateway.offline.report import report_from_log
from gateway.offline.trials import DEFAULT_TRIALS, load_trials
from sim.trial import Trial
from tests.conftest import ROOT
from tests.gateway.ingest.ulog_writer import as_ulog
from tests.sim.voyages import WAM_V, simulated

LOG = ROOT / "recordings/voyage_1.tlog"


@pytest.fixture(scope="module")
def trial() -> Trial:
    (one,) = load_trials(LOG)
    return one


@pytest.fixture(scope="module")
def sailed() -> Trial:
    return simulated(WAM_V, 240.0)


def seconds(one: Trial) -> float:
    return float(one.usable.sum()) * one.dt


def test_no_moment_is_learnt_from_and_judged_on(sailed: Trial) -> None:
    split = split_time(sailed)
    assert not (split.learn.usable & split.judge.usable).any()
    assert (split.learn.usable | split.judge.usable).sum() == sailed.usable.sum()
    assert seconds(split.learn) == pytest.approx(0.6 * seconds(sailed), abs=1.0)
    assert "judged on the 96 s that came after" in split.sentence


def test_time_that_is_too_short_to_be_cut_is_said_to_be_so(sailed: Trial) -> None:
    short = split_time(replace(sailed, usable=sailed.usable & (sailed.time < 80.0)))
    assert short.cut is None
    assert short.learn is short.judge
    assert "too short" in short.sentence
    assert "judged on" not in short.sentence


def test_what_is_given_is_not_said_to_be_assumed(trial: Trial) -> None:
    _, said = begin_vessel(LOG, {}, trial, DEFAULT_TRIALS)
    text = " ".join(said)
    assert "mass 30 kg" in text
    assert "--mass" in text
    assert "in proportion to one another only" in text
    assert "throttle left on output 1, throttle right on output 3" in text
    assert "top speed 1.8" in text
    size = {"length": 2.0, "beam": 1.0, "mass": 80.0, "thrust": 100.0, "top_speed": 2.0}
    file, said = begin_vessel(LOG, size, trial, DEFAULT_TRIALS)
    text = " ".join(said)
    assert "push 75 % of what they push ahead" in text
    for word in ("assumed", "mass", "top speed", "in proportion"):
        assert word not in text
    assert "mass = 80.0" in file


def test_motors_that_px4_names_are_said_to_be_named(trial: Trial, tmp_path: Path) -> None:
    written, path = as_ulog(LOG), tmp_path / "a.ulg"
    written.head = []
    written.parameter("PWM_MAIN_FUNC1", 101.0)
    path.write_bytes(written.bytes())
    _, said = begin_vessel(path, {}, trial, DEFAULT_TRIALS)
    assert "PX4 names motor 1 on output 1 of PWM_MAIN, but not where" in said[-1]
    assert "output 3 is taken for" in said[-1] or "output 3 for" in said[-1]


def test_a_size_that_is_none_is_one_line() -> None:
    with pytest.raises(BadInput, match="--mass -1"):
        learn_from(LOG, {"mass": -1.0}, options=DEFAULT_TRIALS)


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("backwards", [False, True])
def test_outputs_without_parameters_are_found_by_how_the_boat_goes(
    sailed: Trial, swapped: bool, backwards: bool
) -> None:
    pwm = sailed.pwm[:, ::-1] if swapped else sailed.pwm
    pwm = 3000.0 - pwm if backwards else pwm
    found, text = assumed_actuators(replace(sailed, pwm=pwm))
    kinds = {a.kind: a for a in found}
    left = kinds[OutputFunction.THROTTLE_LEFT]
    right = kinds[OutputFunction.THROTTLE_RIGHT]
    port, starboard = sailed.channels[::-1] if swapped else sailed.channels
    assert (left.channel, right.channel) == (port, starboard)
    assert left.reversed == right.reversed == backwards
    assert f"output {port} is taken for the port motor" in text
    assert ("reversed" in text) == backwards


def test_steering_is_told_from_a_second_motor(sailed: Trial) -> None:
    left, right = ((sailed.pwm - 1500.0) / 400.0).T
    steered = np.column_stack([1500.0 + 200.0 * (left - right), 1500.0 + 200.0 * (left + right)])
    found, text = assumed_actuators(replace(sailed, pwm=steered))
    assert [a.kind for a in found] == [OutputFunction.STEERING, OutputFunction.THROTTLE]
    assert not found[1].reversed
    assert "steering" in text


def test_outputs_that_never_change_teach_nothing(sailed: Trial) -> None:
    with pytest.raises(BadInput, match="no output ever changes"):
        assumed_actuators(replace(sailed, pwm=np.full_like(sailed.pwm, 1500.0)))


@pytest.mark.slow
def test_from_a_log_to_a_page_that_names_what_is_wrong(tmp_path: Path) -> None:
    """The recording's compass is turned: nothing but the log was given."""
    done = report_from_log([LOG], tmp_path / "report.html", {})
    text = done.path.read_text(encoding="utf-8")
    first = text[: text.index('id="numbers"')]
    assert "The compass reads" in first
    for words in ("judged on the 12", "mass 30 kg", "What to do", "no more than noise"):
        assert words in first, words
