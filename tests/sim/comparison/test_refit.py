"""What is of one day is estimated on time that it is not judged by, and nothing else moves."""

from dataclasses import replace

import numpy as np
import pytest

from sim.comparison.refit import TooShortError, TwoFolds, compare_refitted, cross_fit
from sim.effects.catalogue import named
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import sailed_with
from tests.sim.voyages import WAM_V, trial_of, voyage

NOISE = np.array([0.02, 0.02, 0.003, 0.01, 0.01, 0.003, 0.03, 0.03, 0.01])
CURRENT = named("steady_current")
OTHER_DAY = WAM_V.with_effects(AddedEffect(CURRENT, {"speed": 0.2, "direction": -2.0}))


@pytest.fixture(scope="module")
def trial():
    """A current of 0.3 m/s to the east, by physics of its own."""
    *motion, drive = voyage(160.0, 0.1, current=(0.0, 0.3))
    rng = np.random.default_rng(2)
    noisy = [m + rng.normal(size=m.shape) * NOISE[3 * i : 3 * i + 3] for i, m in enumerate(motion)]
    return trial_of(*noisy, drive, 0.1, np.diag(NOISE**2))


def test_halves_share_no_time_and_keep_their_distance(trial):
    folds = TwoFolds.of(trial)
    one, two = (trial.time[folds.only(k).usable] for k in (0, 1))
    assert len(one) > 500
    assert len(two) > 500
    assert np.abs(one[:, None] - two[None]).min() >= 5.0
    np.testing.assert_array_equal(np.sort([*one, *two]), trial.time[folds.trial.usable])


def test_too_short_a_trial_says_what_is_needed(trial):
    short = replace(trial, usable=trial.time < 60.0)
    with pytest.raises(TooShortError, match="time for 2 of the 4 blocks of 25 s"):
        TwoFolds.of(short)


def test_the_current_of_the_day_is_found_on_either_half(trial):
    fit = cross_fit(TwoFolds.of(trial), OTHER_DAY)
    for values in fit.values:
        assert values["steady_current.speed"] == pytest.approx(0.3, abs=0.03)
        assert values["steady_current.direction"] == pytest.approx(np.pi / 2, abs=0.1)
    for model in fit.models:
        assert model.vessel.dynamics == WAM_V.dynamics


@pytest.mark.slow
def test_what_is_judged_was_not_seen(trial):
    """Spoil one half: the numbers that the other half is judged with change, its own do not."""
    folds = TwoFolds.of(trial)
    spoilt = replace(trial, nu=np.where((folds.fold == 0)[:, None], trial.nu + 0.2, trial.nu))
    before, after = (cross_fit(TwoFolds.of(t), OTHER_DAY).values for t in (trial, spoilt))
    assert before[0] == pytest.approx(after[0], abs=1e-6)
    speed = "steady_current.speed"
    assert abs(before[1][speed] - after[1][speed]) > 0.02


@pytest.mark.slow
def test_a_vessel_of_another_day_gets_its_chance_and_a_plain_one_stays_as_it_is(trial):
    plain, other = compare_refitted(
        trial, [Model.of(WAM_V), Model.of(replace(OTHER_DAY, name="other"))]
    )
    assert other.nrmse < 1.3 * other.noise_floor_nrmse
    assert plain.nrmse > 3.0 * other.nrmse
    assert plain.refit == ()
    assert "refit" not in plain.to_dict()
    assert len(other.to_dict()["refit"]) == 2


@pytest.mark.slow
def test_a_moment_is_found_though_nothing_leads_to_it(trial):
    """On the half that saw it; the other half knows no more than the gap that it fell into."""
    fault = named("thruster_fault")
    truth = {"thruster": 2.0, "gain": 0.4, "time": 80.0}
    drive = (trial.pwm - 1500.0) / 400.0
    sailed = Model.of(WAM_V.with_effects(AddedEffect(fault, truth))).simulate(drive, 0.1)[1]
    motion = sailed[0, : len(drive)]
    broken = trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, 0.1, np.diag(NOISE**2))
    other = WAM_V.with_effects(AddedEffect(fault, {"thruster": 1.0, "gain": 0.6, "time": 130.0}))
    blind, saw = cross_fit(TwoFolds.of(broken), other).values
    for values in (blind, saw):
        assert values["thruster_fault.thruster"] == 2.0
        assert values["thruster_fault.gain"] == pytest.approx(0.4, abs=0.05)
    assert saw["thruster_fault.time"] == pytest.approx(80.0, abs=2.0)
    assert 61.0 <= blind["thruster_fault.time"] <= 99.0


@pytest.mark.slow
def test_a_rhythm_of_another_day_is_found_anew():
    """A motor stops for 2.5 s in each 9.1, four seconds out of step with the vessel's rhythm."""

    def thrust(F, drive, flow, p):
        return F * (1.0 - p.per_mps * (drive.number == 1.0) * ((flow.time + 4.0) % 9.1 < 2.5))

    stutter = replace(named("advance_loss"), name="stutter", thrust=thrust)
    today = sailed_with(WAM_V.with_effects(AddedEffect(stutter, {"per_mps": 1.0})), 300.0, seed=5)
    then = {
        "acts": 2.0, "thruster": 2.0, "since": 0.0, "until": 291.2, "times": 32.0, "lasts": 2.5,
        "width": 0.3, "size": -1.0, "direction": 0.0, "full": 72.0,
    }  # fmt: skip
    rhythm = AddedEffect(named("learned_rhythm"), then)
    plain, found = compare_refitted(
        today, [Model.of(WAM_V), Model.of(WAM_V.with_effects(rhythm))]
    )  # fmt: skip
    assert found.nrmse < 0.2 * plain.nrmse
    for half in found.refit:
        since, until, times = (half[f"learned_rhythm.{k}"] for k in ("since", "until", "times"))
        assert (until - since) / times == pytest.approx(9.1, rel=1e-3)
        assert (since + 4.0 + 0.5) % 9.1 == pytest.approx(0.5, abs=0.4)
