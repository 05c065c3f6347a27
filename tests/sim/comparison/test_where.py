"""Where the error is: shares add up, and a current shows against the heading."""

import numpy as np
import pytest

from sim.comparison import ErrorMap, along_trial, bin_of, place_sentence, round_edges, worst_place
from sim.comparison.compare import compare
from sim.model import Model
from sim.prediction import missing_force
from tests.sim.voyages import WAM_V, simulated, trial_of, voyage

STD = np.array([0.05, 0.05, 0.005, 0.01, 0.01, 0.005, 0.02, 0.02, 0.01])


@pytest.fixture(scope="module")
def in_current():
    """A boat in a current of 0.3 m/s towards the east, compared with still water."""
    eta, nu, nu_dot, drive = voyage(400.0, seed=4, current=(0.0, 0.3))
    trial = trial_of(eta, nu, nu_dot, drive, 0.05, np.diag(STD**2))
    return trial, compare(trial, [Model.of(WAM_V)])[0]


def test_a_current_moves_the_boat_east_on_every_heading(in_current):
    _, found = in_current
    sectors = [b for b in found.where if b.by == "heading" and b.time_share > 0.03]
    assert len(sectors) >= 6
    for sector in sectors:
        middle = 0.5 * (sector.start + sector.end)
        east = sector.mean[0] * np.sin(middle) + sector.mean[1] * np.cos(middle)
        assert 0.1 < east < 0.35


def test_the_sentence_names_place_share_and_direction(in_current):
    _, found = in_current
    north = next(b for b in found.where if b.by == "heading" and b.start == 0.0)
    assert north.sentence.startswith("heading between north and north-east (0–45°): ")
    assert "m/s faster to starboard than the model" in north.sentence
    assert f"{100 * north.share:.0f} % of the squared error" in north.sentence


def test_shares_of_every_variable_add_up(in_current):
    trial, found = in_current
    for by in ("speed", "turn_rate", "heading", "throttle", "reverse", "time", "north", "east"):
        bins = [b for b in found.where if b.by == by]
        assert sum(b.share for b in bins) == pytest.approx(1.0)
        assert sum(b.time_share for b in bins) == pytest.approx(1.0)
        assert sum(b.seconds for b in bins) == pytest.approx(len(trial) * trial.dt, rel=0.02)
    assert found.error_map.share.sum() == pytest.approx(1.0)
    assert not [b for b in found.where if b.by == "voltage"]  # never measured
    excess = [b.excess for b in found.where]
    assert excess == sorted(excess, reverse=True)


def test_error_along_the_trial_agrees_with_nrmse(in_current):
    trial, found = in_current
    along = along_trial(found.prediction, found.ruler.scales, len(trial))
    assert np.nanmean(along**2) == pytest.approx(found.nrmse**2, rel=0.1)


def test_missing_force_of_the_right_model_is_nothing_and_of_a_pulled_boat_the_pull():
    trial, model = simulated(WAM_V, 60.0), Model.of(WAM_V)
    exact = missing_force(trial, model)
    assert np.median(np.abs(exact.force)) < 1e-6
    pulled = trial_of(
        trial.eta, trial.nu, trial.nu_dot + np.array([10.0 / 126.0, 0.0, 0.0]),
        (trial.pwm - 1500.0) / 400.0, trial.dt, np.diag(STD**2),
    )  # fmt: skip
    found = missing_force(pulled, model)
    assert np.median(found.force[:, 0]) == pytest.approx(10.0, rel=0.01)


def test_the_spread_of_the_missing_force_is_that_of_noisy_motion():
    """Against 300 draws of the noise itself."""
    trial, model = simulated(WAM_V, 40.0), Model.of(WAM_V)
    trial = trial_of(
        trial.eta, trial.nu, trial.nu_dot, (trial.pwm - 1500.0) / 400.0, trial.dt, np.diag(STD**2)
    )
    said = missing_force(trial, model)
    row, rng = 300, np.random.default_rng(2)
    motion = np.hstack([trial.eta, trial.nu, trial.nu_dot])[row] + STD * rng.normal(size=(300, 9))
    drive = np.tile((trial.pwm[row] - 1500.0) / 400.0, (300, 1))
    drawn, _ = model.missing_force(motion, np.zeros(300), drive, drive)
    np.testing.assert_allclose(said.std[row], drawn.std(axis=0), rtol=0.15)


def test_edges_are_round_and_hold_everything():
    values = np.random.default_rng(1).normal(1.3, 0.4, 5000)
    edges = round_edges(values, 8)
    assert edges[0] <= values.min()
    assert edges[-1] >= values.max()
    np.testing.assert_allclose(edges / 0.25, np.round(edges / 0.25))
    assert len(edges) <= 12
    assert (bin_of(values, edges) >= 0).all()
    assert bin_of(np.array([np.nan, -99.0]), edges).tolist() == [-1, -1]
    assert len(round_edges(np.full(5, 12.6), 6)) == 2


def grid(share: np.ndarray) -> ErrorMap:
    cells = np.array([(n, e) for n in range(10) for e in range(10)], float)
    return ErrorMap(5.0, 5.0 * cells - 20.0, share, np.full(100, 0.01), np.zeros((100, 3)))


def test_a_spot_with_the_error_is_the_place() -> None:
    share = np.full(100, 0.005)
    share[72] = 0.505
    place = worst_place(grid(share))
    assert place is not None
    assert abs(place.north - (5.0 * 7 - 17.5)) <= 5.0
    assert abs(place.east - (5.0 * 2 - 17.5)) <= 5.0
    assert place.share > 0.5
    assert place.time_share <= 0.09 + 1e-9


def test_an_even_error_has_no_place() -> None:
    assert worst_place(grid(np.full(100, 0.01))) is None


def test_a_track_of_one_cell_has_no_place() -> None:
    one = ErrorMap(5.0, np.zeros((1, 2)), np.ones(1), np.ones(1), np.zeros((1, 3)))
    assert worst_place(one) is None


def test_it_is_told_from_the_origin() -> None:
    says = place_sentence(-42.4, 10.0, 15.0, 0.5, 0.09)
    assert says == (
        "around 42 m south, 10 m east of the origin (15 m square): "
        "50 % of the squared error in 9 % of the time"
    )
