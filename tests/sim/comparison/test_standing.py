"""What an error beside the noise says of a model, of each channel too."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.comparison import telling_channel
from sim.comparison.compare import (
    Comparison,
    Judgement,
    Standing,
    compare,
    louder_channels,
)
from sim.comparison.improvement import improvements
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import Vessel
from tests.sim.voyages import WAM_V, commands, trial_of, voyage

STD = np.array([0.02, 0.02, 0.005, 0.03, 0.03, 0.002, 0.02, 0.02, 0.01])


def weaker(share: float) -> Vessel:
    """The boat with so much of its thrust."""
    thrusters = [
        replace(t, thrust=(share * t.thrust[0], share * t.thrust[1])) for t in WAM_V.thrusters
    ]
    return replace(WAM_V, name=f"{share:g}", thrusters=tuple(thrusters))


def sailed(std: Floats) -> Trial:
    """Two minutes of the boat as it is, with noise of that standard deviation (9,)."""
    told = commands(120.0, 0.1)
    eta, nu, nu_dot, _ = voyage(120.0, 0.1)
    motion = np.concatenate([eta, nu, nu_dot], 1)
    motion = motion + np.random.default_rng(4).normal(0.0, std, motion.shape)
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], told, 0.1, np.diag(std**2))


def ruler(noise: tuple[float, ...], scales: tuple[float, ...]) -> Any:
    return SimpleNamespace(noise=np.array(noise), scales=np.array(scales))


def test_a_channel_that_is_noise_hides_no_other() -> None:
    """A sway that hardly moves lifts the floor of all three; the speed is three times its noise."""
    noise, scales = (0.03, 0.03, 0.002), (0.5, 0.05, 0.2)
    floor = float(np.sqrt(np.mean((np.array(noise) / scales) ** 2)))
    rmse = np.array([0.09, 0.028, 0.003])
    error = float(np.sqrt(np.mean((rmse / scales) ** 2)))
    louder = louder_channels(ruler(noise, scales), rmse)
    assert louder == {"surge": pytest.approx(3.0)}
    assert Standing(error, floor).judgement is Judgement.ADEQUATE  # all channels together
    assert Standing(error, floor, louder).judgement is Judgement.WRONG


def test_a_turn_rate_is_loud_only_where_it_matters() -> None:
    """A gyro states a noise that no model reaches."""
    still = ruler((0.03, 0.03, 0.002), (0.5, 0.2, 0.2))
    assert louder_channels(still, np.array([0.03, 0.03, 0.016])) == {}  # 8 times, 8 % of the turns
    assert set(louder_channels(still, np.array([0.03, 0.03, 0.024]))) == {"turning"}


def test_where_noise_hides_the_motion_nothing_is_wrong_with_a_channel() -> None:
    assert Standing(0.7, 0.8, {"surge": 2.0}).judgement is Judgement.UNJUDGED


def test_a_complete_model_is_no_more_than_noise_and_a_weaker_one_is() -> None:
    trial = sailed(STD)
    right, weak = (compare(trial, [Model.of(v)])[0] for v in (WAM_V, weaker(0.8)))
    assert right.standing.louder == {}
    assert right.judgement is Judgement.ADEQUATE
    assert "surge" in weak.standing.louder
    assert weak.judgement is Judgement.WRONG


def test_of_two_that_are_no_more_than_noise_together_the_louder_one_is_worse() -> None:
    found = [
        replace(one, nrmse=0.3, noise_floor_nrmse=0.3)
        for one in compare(sailed(STD), [Model.of(v) for v in (WAM_V, weaker(0.8))])
    ]
    (said,) = improvements(found)
    assert "both err by no more than noise" not in said.sentence


def test_a_vessel_that_runs_away_from_every_start_is_not_hidden_by_noise() -> None:
    """A mass in grams: the model, not the recording, makes the floor so high."""
    found = Standing(1.0, 39.3, runs_away=True)
    assert found.judgement is Judgement.UNJUDGED
    ill: Any = SimpleNamespace(
        scores=SimpleNamespace(rmse={"u": 0.4, "v": 0.1, "r": 0.2}), nrmse=1.0,
        ruler=ruler((1.0, 1.0, 1.0), (0.5, 0.1, 0.2)), noise_floor_nrmse=39.3, measured_noise=0.14,
    )  # fmt: skip
    standing = Comparison.standing.fget  # type: ignore[attr-defined]
    assert standing(ill).runs_away
    assert not standing(SimpleNamespace(**{**vars(ill), "measured_noise": 0.6})).runs_away
    assert not standing(SimpleNamespace(**{**vars(ill), "noise_floor_nrmse": 0.2})).runs_away


@pytest.mark.parametrize(
    ("mean", "rmse", "told"),
    [
        ((3.99, -0.08, 0.0), (4.03, 0.215, 0.01), 0),  # a sway of noise beside a speed far off
        ((3.99, -0.12, 0.0), (4.03, 0.215, 0.01), 0),  # … of a slip that is there
        ((0.02, -0.13, 0.0), (0.03, 0.14, 0.01), 1),  # a slip, and hardly anything ahead
        ((0.10, 0.01, 0.0), (0.104, 0.042, 0.003), 0),
        ((0.0, 0.0, 0.1), (0.03, 0.03, 0.12), 2),
        ((0.0, 0.0, 0.0), (0.03, 0.2, 0.01), 1),  # either way, and the only one beyond noise
        ((0.04, 0.0, 0.0), (0.06, 0.5, 0.01), 1),  # … and far beyond what errs one way
    ],
)
def test_what_is_told_of_a_bin_is_the_channel_that_is_off(
    mean: tuple[float, ...], rmse: tuple[float, ...], told: int
) -> None:
    scales, noise = np.array([1.5, 0.05, 0.2]), np.array([0.03, 0.04, 0.002])
    assert telling_channel(np.array(mean), np.array(rmse), scales, noise) == told
