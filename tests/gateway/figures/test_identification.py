"""Figures of an identification show its numbers."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from gateway.figures import Dots, Line, SeriesRole
from gateway.figures.matplotlib_draw import save_figure
from gateway.figures.motion import identification_figures, parameter_changes
from sim.identification.intervals import Estimate
from sim.model import Model
from sim.prediction.free_runs import Ruler, predict
from tests.sim.voyages import WAM_V, simulated


@pytest.fixture(scope="module")
def drawn():
    trial = simulated(WAM_V, 60.0)
    off = Model.of(replace(WAM_V, dynamics=replace(WAM_V.dynamics, X_u=-60.0)))
    true = Model.of(WAM_V)
    ruler = Ruler.of(trial, off)
    was, now = predict(trial, off, ruler), predict(trial, true, ruler)
    return trial, identification_figures(trial, was, now, ruler.longest_run(trial.dt))


def test_after_lies_on_what_was_measured_and_before_does_not(drawn):
    _, figures = drawn
    surge = {m.role: m for m in figures["velocities"].panels[0].marks if isinstance(m, Line)}
    measured = surge[SeriesRole.MEASURED]
    for role, right in ((SeriesRole.MODEL, True), (SeriesRole.CONTEXT, False)):
        model = surge[role]
        known = np.isfinite(model.y)
        error = model.y[known] - np.interp(model.x[known], measured.x, measured.y)
        assert (np.abs(error).max() < 1e-3) == right


def test_whiskers_are_the_intervals_in_per_cent():
    estimates = (
        Estimate("m11", "kg", 100.0, 110.0, (105.0, 115.0), True),
        Estimate("X_u", "N s/m", -20.0, -10.0, (-12.0, -8.0), True),
        Estimate("Y_vv", "N s²/m²", -50.0, -50.0, (-1e9, 1e9), False),
    )
    (panel,) = parameter_changes("boat", estimates).panels
    (dots,) = (m for m in panel.marks if isinstance(m, Dots))
    np.testing.assert_allclose(dots.y, [10.0, 50.0, 0.0])
    np.testing.assert_allclose(dots.low[:2], [5.0, 40.0])
    np.testing.assert_allclose(dots.high[:2], [15.0, 60.0])
    assert np.abs([dots.low[2], dots.high[2]]).max() < 1e3  # does not flatten the others
    assert panel.names[2] == "Y_vv ?"


def test_they_draw(drawn, tmp_path):
    for name, figure in drawn[1].items():
        with Image.open(save_figure(figure, tmp_path / f"{name}.png")) as image:
            assert image.width > 1000
