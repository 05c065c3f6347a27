"""Figures of a comparison: what they show is data, and drawing them leaves whole files or none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gateway.errors import BadInput, ShadowError
from gateway.figures import (
    COLOUR,
    COLOUR_SCALE,
    ColouredPoints,
    FigureData,
    Line,
    SeriesRole,
    Strip,
)
from gateway.figures.comparison import comparison_figures, error_shares, error_strips
from gateway.figures.matplotlib_draw import draw_figure, draw_mark, save_figure
from gateway.figures.motion import free_run_velocities, horizon_velocities
from sim.comparison.compare import compare
from sim.model import Model
from tests.sim.voyages import WAM_V, simulated, trial_of, voyage


@pytest.fixture(scope="module")
def compared():
    """A boat in a current: one vessel knows nothing of it."""
    noise = np.square([0.05, 0.05, 0.005, 0.01, 0.01, 0.005, 0.02, 0.02, 0.01])
    motion = voyage(120.0, current=(0.0, 0.3))
    trial = trial_of(*motion, 0.05, np.diag(noise))
    other = Model.of(replace(WAM_V, name="twin"))
    return trial, compare(trial, [Model.of(WAM_V), other])


def marks_of(figure: FigureData, kind: type):
    return [mark for panel in figure.panels for mark in panel.marks if isinstance(mark, kind)]


@pytest.mark.slow
def test_every_figure_draws(compared, tmp_path):
    for name, figure in comparison_figures(*compared).items():
        file = save_figure(figure, tmp_path / f"{name}.png")
        with Image.open(file) as image:
            assert image.width > 1000


def test_every_axis_of_a_quantity_has_its_unit(compared):
    figures = comparison_figures(*compared)
    assert len(figures) == 15
    for figure in figures.values():
        for panel in figure.panels:
            for axis in (panel.x, panel.y):
                assert axis.unit or panel.names or not axis.label


def test_measured_and_model_show_the_numbers_of_the_comparison(compared):
    trial, (one, _) = compared
    measured, model = marks_of(free_run_velocities(trial, one), Line)[:2]
    assert (measured.role, model.role) == (SeriesRole.MEASURED, SeriesRole.MODEL)
    np.testing.assert_array_equal(measured.y, trial.nu[:, 0])
    rmse = np.sqrt(np.mean((measured.y - model.y) ** 2))
    assert rmse == pytest.approx(one.free_run.scores.rmse["u"])


def test_runs_of_a_horizon_follow_one_another_without_overlap(compared):
    trial, (one, _) = compared
    runs = marks_of(horizon_velocities(trial, one), Line)[1]
    assert (np.diff(runs.x) >= 0).all()
    gaps = np.count_nonzero(np.isnan(runs.y))
    assert gaps == 11  # 120 s in runs of 10 s, the last of them without room


def test_shares_are_per_cent_and_strips_hold_every_bin(compared):
    _, (one, _) = compared
    heading = error_shares(one, ("heading",)).panels[0].marks
    assert heading[0].height.sum() == pytest.approx(100.0)
    assert heading[0].end.max() <= 360.0
    strip = marks_of(error_strips(one), Strip)[0]
    assert strip.value.shape == (3, len(strip.start))
    assert strip.highest >= strip.value.max()


def test_the_track_is_coloured_by_error_only_where_a_model_ran(compared):
    trial, (one, _) = compared
    error = marks_of(comparison_figures(trial, [one])["plain track"], ColouredPoints)[0]
    assert np.isfinite(error.value).all()
    assert len(error.value) < len(trial)
    assert error.value.max() > one.nrmse > error.value.min()


def test_roles_have_colours_of_their_own_and_scales_darken():
    lines = [
        SeriesRole.MEASURED,
        SeriesRole.MODEL,
        SeriesRole.SHADOW,
        SeriesRole.ERROR,
        SeriesRole.CONTEXT,
    ]
    assert len({COLOUR[role] for role in lines}) == len(lines)
    light = [sum(int(c[i : i + 2], 16) * w for i, w in ((1, 0.3), (3, 0.6), (5, 0.1)))
             for c in COLOUR_SCALE]  # fmt: skip
    assert light == sorted(light, reverse=True)


@pytest.mark.slow
def test_the_same_data_give_the_same_bytes(compared, tmp_path):
    figure = error_shares(compared[1][0])
    for suffix in (".svg", ".png"):
        one, two = (save_figure(figure, tmp_path / f"{n}{suffix}").read_bytes() for n in "ab")
        assert one == two
        if suffix == ".png":
            with Image.open(tmp_path / "a.png") as image:
                assert image.width > 1000


@pytest.mark.slow
def test_a_figure_is_whole_or_not_there(compared, tmp_path, monkeypatch):
    figure = error_shares(compared[1][0])
    with pytest.raises(BadInput, match=r"\.png or \.svg"):
        save_figure(figure, tmp_path / "a.bmp")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ShadowError, match="cannot write the picture"):
        save_figure(figure, tmp_path / "file" / "a.png")

    def full(part: Path, content: bytes) -> None:
        with part.open("wb") as file:
            file.write(content[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ShadowError, match="No space left"):
        save_figure(figure, tmp_path / "b.png")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_free_run_that_diverged_says_so():
    away = replace(WAM_V.dynamics, X_u=200.0, X_uu=400.0)
    vessel = replace(WAM_V, dynamics=away)
    trial = simulated(WAM_V, 40.0)
    found = compare(trial, [Model.of(WAM_V), Model.of(vessel)])[1]
    model = marks_of(free_run_velocities(trial, found), Line)[1]
    assert model.label.endswith("(diverges)")
    assert np.isfinite(model.y).all()
    draw_figure(horizon_velocities(trial, found))


def test_an_unknown_mark_is_an_error():
    with pytest.raises(TypeError, match="cannot draw str"):
        draw_mark("mark", None)
