"""The noise floor against truth that other physics made, with estimate errors of known size."""

from dataclasses import replace

import numpy as np
import pytest

from sim.comparison.compare import Judgement, compare, judge
from sim.model import Model
from sim.prediction.free_runs import LEAST_SHOWN_FLOOR, Ruler, nrmse, predict, shown_floor
from sim.prediction.segments import CompareSettings
from tests.sim.voyages import UNSTABLE, WAM_V, legs, trial_of, voyage

SLUGGISH = replace(WAM_V, name="sluggish", dynamics=replace(WAM_V.dynamics, X_u=-34.0))
STD = np.array([0.05, 0.05, 0.01, 0.03, 0.03, 0.01])  # of eta, nu
DT = 0.05


def smooth_errors(seconds, lasting, rng):
    """Gaussian errors (T, 6) of size STD and their rates, correlated as exp(−t²/2 lasting²)."""
    t = np.arange(round(seconds / DT)) * DT
    omega = rng.normal(size=(200, 6)) / lasting  # the spectrum of such a correlation
    phase = rng.uniform(0.0, 2.0 * np.pi, (200, 6))
    at = omega[None] * t[:, None, None] + phase
    scale = STD * np.sqrt(2.0 / 200)
    return scale * np.cos(at).sum(axis=1), (-scale * omega * np.sin(at)).sum(axis=1)


def noisy(motion, lasting, seed):
    """A trial whose estimate errs as its covariance says; `lasting` [s], 0 for white errors."""
    eta, nu, nu_dot, drive = motion
    rng = np.random.default_rng(seed)
    if lasting:
        error, rate = smooth_errors(len(eta) * DT, lasting, rng)
        rate_std = STD / lasting
    else:
        error, rate = rng.normal(size=(len(eta), 6)) * STD, np.zeros((len(eta), 6))
        rate_std = np.full(6, 1e6)
    covariance = np.diag(np.concatenate([STD, rate_std[3:]]) ** 2)
    return trial_of(
        eta + error[:, :3], nu + error[:, 3:], nu_dot + rate[:, 3:], drive, DT, covariance
    )


@pytest.mark.parametrize(("lasting", "horizon"), [
    (0.0, 10.0), pytest.param(1.0, 10.0, marks=pytest.mark.slow), (3.0, 2.0),
])  # fmt: skip
def test_a_perfect_model_is_at_the_floor_and_a_wrong_one_above(lasting, horizon):
    """Errors that last longer than the horizon hardly show in it, and the floor knows."""
    trial = noisy(voyage(300.0, DT, seed=3), lasting, seed=5)
    wrong = replace(WAM_V, dynamics=replace(WAM_V.dynamics, X_uu=-10.0, N_r=-50.0))
    ruler = Ruler.of(trial, Model.of(WAM_V), CompareSettings(horizon=horizon))
    shown = [nrmse(predict(trial, Model.of(v), ruler).predicted_rows()[2], ruler.scales)
             for v in (WAM_V, wrong)]  # fmt: skip
    assert shown[0] == pytest.approx(ruler.noise_floor, rel=0.2)
    assert shown[1] > 2.0 * ruler.noise_floor


def test_an_unstable_hull_has_its_true_model_at_the_floor_too():
    """Without the limit on the horizon the true model looks far worse than any noise."""
    trial, model = noisy(legs(UNSTABLE, 300.0), 0.0, seed=5), Model.of(UNSTABLE)
    ruler = Ruler.of(trial, model)
    shown = nrmse(predict(trial, model, ruler).predicted_rows()[2], ruler.scales)
    assert ruler.cut_short > 0.5
    assert shown == pytest.approx(ruler.noise_floor, rel=0.2)
    endless = Ruler.of(trial, model, CompareSettings(spread_limit=1e9))
    assert nrmse(predict(trial, model, endless).predicted_rows()[2], ruler.scales) > 2.0 * shown


def test_noise_is_no_more_than_the_smallest_error_that_a_model_showed():
    """Of a trial whose stated noise is twice too much the floor would lie above the true model."""
    trial = noisy(voyage(300.0, DT, seed=3), 0.0, seed=5)
    loud = replace(trial, covariance=4.0 * trial.covariance)
    found = compare(loud, [Model.of(v) for v in (WAM_V, SLUGGISH)])
    assert found[0].ruler.noise_floor > 1.6 * found[0].nrmse
    assert [one.noise_floor_nrmse for one in found] == [found[0].nrmse] * 2
    assert found[1].judgement is Judgement.WRONG  # though it errs by less than was stated as noise
    assert found[1].nrmse < found[0].ruler.noise_floor
    (alone,) = compare(trial, [Model.of(SLUGGISH)])
    assert alone.noise_floor_nrmse == alone.ruler.noise_floor < alone.nrmse


def test_a_floor_is_told_as_stated_where_every_model_errs_more():
    assert shown_floor(0.2, [0.3, 0.9]) == 0.2
    assert shown_floor(0.2, [0.15, 0.9]) == 0.15
    assert shown_floor(0.2, []) == 0.2
    # noise that hides the motion judges nothing, however small an error looks
    assert shown_floor(12.4, [0.3]) == 12.4
    assert judge(0.3, shown_floor(12.4, [0.3])) is Judgement.UNJUDGED
    # of motion without noise: nobody wants to know which of two is nearer by less
    assert shown_floor(0.2, [1e-5]) == LEAST_SHOWN_FLOOR
    assert shown_floor(0.004, [1e-5]) == 0.004
