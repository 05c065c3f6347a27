"""Effects beside waves: what is there is found, what only answers them is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit import Fit
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import HeldOutScorer
from sim.diagnosis.in_a_sea import (
    is_in_a_sea,
    not_told_in_a_sea,
    search_beside_waves,
    under_own_colour,
)
from sim.diagnosis.ladder import EffectSearch
from sim.effects.catalogue import named
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial
from tests.sim.diagnosis.sailed import STD
from tests.sim.voyages import WAM_V, in_a_sea, trial_of

DT = 0.2  # s: that of a diagnosis
CATALOGUE = tuple(
    map(
        named,
        (
            "thruster_imbalance",
            "hull_lift",
            "cross_damping",
            "steady_current",
            "wave_motion",
            "crossing_waves",
        ),
    )
)


def shaken(port: float, seconds: float = 300.0, current: tuple[float, float] = (0.0, 0.0)) -> Trial:
    """A voyage in a sea, the port motor with that share of its thrust; physics of other code."""
    *motion, drive = in_a_sea(seconds, DT, port=port, current=current)
    noisy = np.hstack(motion) + np.random.default_rng(5).normal(0.0, STD, (len(drive), 9))
    eta, nu, nu_dot = np.split(noisy, 3, axis=1)
    return trial_of(eta, nu, nu_dot, drive, DT, np.diag(STD**2))


def base_of(trial: Trial) -> Fit:
    """The re-fitted base."""
    superset = SupersetModel.of(WAM_V, [])
    return fit_base(superset, Model.of(WAM_V), [trial], DiagnoseSettings())


@pytest.mark.parametrize(
    ("effect", "left", "period", "is_one"),
    [
        ("steady_current", 20.0, None, False),
        ("steady_current", 20.0, 3.0, True),
        ("steady_current", 0.7, 3.0, False),  # no more than noise: nothing shakes the boat
        ("wave_motion", 0.7, None, True),
    ],
)
def test_a_sea_is_told_by_a_train_or_by_what_swings(
    effect: str, left: float, period: float | None, is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.diagnosis.in_a_sea.swing_period", lambda fit: period)
    fit: Any = SimpleNamespace(
        added=(SimpleNamespace(effect=named(effect)),), noise_share=(0.7, 0.7, left)
    )
    assert is_in_a_sea(fit) is is_one


@pytest.mark.parametrize(
    ("coloured", "found", "told"),
    [(True, (), True), (False, (), False), (True, ("velocity_latency",), False)],
)
def test_late_velocities_are_not_told_in_a_sea_and_that_is_said(
    coloured: bool, found: tuple[str, ...], told: bool
) -> None:
    problem = SimpleNamespace(is_coloured=coloured)
    selection: Any = SimpleNamespace(fit=SimpleNamespace(problem=problem, names=found))
    effects = [named(name) for name in ("velocity_latency", "command_delay", "wave_motion")]
    refused = not_told_in_a_sea(selection, effects)
    assert [r.effect for r in refused] == ["velocity_latency"] * told
    assert all("calm water" in r.reason for r in refused)


def largest_correlation(residual: Floats) -> float:
    """Of what is left of u, v, r with itself, one to six means before."""
    rows = residual.reshape(-1, 3)
    every = [
        np.corrcoef(rows[k:, c], rows[:-k, c])[0, 1] for k in range(1, 7) for c in range(3)
    ]  # fmt: skip
    return float(np.abs(every).max())


def test_what_a_sea_leaves_is_white_under_its_colour_and_stays_so_under_a_new_noise() -> None:
    fit = base_of(shaken(1.0, 120.0))
    white = under_own_colour(fit)
    assert largest_correlation(fit.residual) > 0.3 > 0.2 > largest_correlation(white.residual)
    assert white.renewed_problem.is_coloured
    assert not fit.renewed_problem.is_coloured


def test_under_a_colour_a_fit_to_a_sea_is_more_likely() -> None:
    fit = base_of(shaken(1.0, 120.0))
    under = fit.problem.under_colour_of(fit.unknowns, fit.z)
    plain, coloured = (p.deviance(fit.unknowns, fit.z) for p in (fit.problem, under))
    assert coloured < plain - 100.0


@pytest.mark.slow
@pytest.mark.parametrize(("port", "expected"), [(0.9, ["thruster_imbalance"]), (1.0, [])])
def test_in_a_sea_what_is_there_is_found_and_nothing_else(port: float, expected: list[str]) -> None:
    """Over runs of six seconds thirty waves were taken for a lift of the hull."""
    trial, plain = shaken(port), Model.of(WAM_V)
    superset = SupersetModel.of(WAM_V, CATALOGUE)
    base = fit_base(superset, plain, [trial], DiagnoseSettings())
    scorer = HeldOutScorer.of([trial], plain)
    search = EffectSearch(superset, CATALOGUE, 4, lambda _: None, map, scorer)
    first, _ = search.ranked(base, [])
    found = search_beside_waves(search, base, first)
    fit, others = found.fit, [s for s in found.steps if not s.best.effect.partial]
    assert all(step.reference.problem.is_coloured for step in others)  # waves hide it before
    assert [a.effect.name for a in fit.added if not a.effect.partial] == expected
    if expected:
        values = fit.values("thruster_imbalance")
        assert values["starboard"] == 0.0
        assert values["port_gain"] == pytest.approx(0.9, abs=0.03)


@pytest.mark.slow
def test_what_takes_most_of_the_error_comes_before_the_waves() -> None:
    """Under the colour of all that a strong wind did little of it was left."""
    trial, plain = shaken(1.0, current=(1.0, -0.6)), Model.of(WAM_V)
    superset = SupersetModel.of(WAM_V, CATALOGUE)
    base = fit_base(superset, plain, [trial], DiagnoseSettings())
    scorer = HeldOutScorer.of([trial], plain)
    search = EffectSearch(superset, CATALOGUE, 4, lambda _: None, map, scorer)
    first, _ = search.ranked(base, [])
    found = search_beside_waves(search, base, first)
    assert found.steps[0].best.name == "steady_current"
    assert not found.steps[0].reference.problem.is_coloured
    assert [a.effect.name for a in found.fit.added if not a.effect.partial] == ["steady_current"]
    values = found.fit.values("steady_current")
    north, east = (values["speed"] * f(values["direction"]) for f in (np.cos, np.sin))
    assert (north, east) == pytest.approx((1.0, -0.6), abs=0.03)
    assert scorer.score_fit(found.fit).nrmse < 0.6 * scorer.score_fit(found.base).nrmse
