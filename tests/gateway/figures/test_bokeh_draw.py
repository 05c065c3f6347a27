"""Figures on screen: the same data as on paper, in the same colours, filled anew in place."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.figures import COLOUR, DARK, LIGHT, TIME, Axis, FigureData, Line, Panel, SeriesRole
from gateway.figures.bokeh_draw import BokehFigure, LinkedView
from gateway.figures.bokeh_marks import columns_of, draw_mark
from gateway.figures.comparison import comparison_figures
from gateway.figures.motion import horizon_velocities
from sim.comparison.compare import compare
from sim.model import Model
from tests.sim.voyages import WAM_V, trial_of, voyage


@pytest.fixture(scope="module")
def compared():
    """A boat in a current: one vessel knows nothing of it."""
    noise = np.square([0.05, 0.05, 0.005, 0.01, 0.01, 0.005, 0.02, 0.02, 0.01])
    trial = trial_of(*voyage(120.0, current=(0.0, 0.3)), 0.05, np.diag(noise))
    other = Model.of(replace(WAM_V, name="twin"))
    return trial, compare(trial, [Model.of(WAM_V), other])


def ratio(one: str, two: str) -> float:
    """Contrast as WCAG 2 defines it."""

    def light(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((light(one), light(two)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(
    "theme", [pytest.param(LIGHT, marks=pytest.mark.slow), DARK], ids=lambda theme: theme.name
)
def test_every_figure_of_a_comparison_is_drawn(compared, theme):
    for data in comparison_figures(*compared).values():
        drawn = BokehFigure(data, LinkedView(theme))
        assert len(drawn.figures) == len(data.panels)
        for figure, panel in zip(drawn.figures, data.panels, strict=True):
            assert (figure.xaxis[0].axis_label or "") == panel.x.text


@pytest.mark.slow
def test_the_names_of_headings_stand_apart_in_a_picture_as_narrow_as_on_a_phone(compared):
    letter_px, width_px = 7.0, 200.0
    headings = [
        figure.xaxis[0].major_label_overrides
        for data in comparison_figures(*compared).values()
        for figure in BokehFigure(data, LinkedView()).figures
        if figure.xaxis[0].axis_label == "heading [°]"
    ]
    assert headings
    for names in headings:
        assert {0, 90, 180, 270, 360} <= set(names)
        room = width_px * min(np.diff(sorted(names))) / 360.0
        assert letter_px * max(map(len, names.values())) < room


def test_time_axes_are_one_axis(compared):
    trial, found = compared
    view = LinkedView()
    drawn = [BokehFigure(horizon_velocities(trial, c), view) for c in found]
    figures = [figure for one in drawn for figure in one.figures]
    assert len({id(figure.x_range) for figure in figures}) == 1


def test_other_data_of_the_same_shape_go_into_the_same_figure(compared):
    trial, found = compared
    first, second = (horizon_velocities(trial, one) for one in found)
    drawn = BokehFigure(first)
    faster = replace(second, panels=tuple(map(_doubled, second.panels)))
    assert drawn.update(faster)
    shown = drawn.figures[0].renderers[1].data_source.data["y"]
    np.testing.assert_allclose(shown, 2.0 * first.panels[0].marks[0].y)
    assert not drawn.update(replace(second, panels=second.panels[:2]))


def _doubled(panel: Panel) -> Panel:
    return replace(panel, marks=tuple(replace(m, y=2.0 * m.y) for m in panel.marks))


def test_a_window_of_a_long_line_shows_all_its_points():
    x = np.arange(100000.0)
    data = FigureData(
        "long", (Panel(TIME, Axis("y", "m"), (Line(x, np.sin(x), SeriesRole.MEASURED),)),)
    )
    drawn = BokehFigure(data)
    source = drawn.figures[0].renderers[1].data_source
    assert len(source.data["x"]) < 5000
    drawn.resample(500.0, 900.0)
    np.testing.assert_array_equal(source.data["x"], np.arange(499.0, 902.0))


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.name)
def test_text_is_readable_and_lines_stand_out(theme):
    assert ratio(theme.ink, theme.paper) > 7.0
    assert ratio(theme.faint, theme.paper) > 4.5
    for role in SeriesRole:
        assert ratio(theme.colour(role), theme.paper) > 3.0, role
    assert theme.colour(SeriesRole.MEASURED) == COLOUR[SeriesRole.MEASURED]


def test_the_colour_scale_ends_where_it_stands_out_most():
    for theme in (LIGHT, DARK):
        contrasts = [ratio(colour, theme.paper) for colour in theme.scale(6)]
        assert contrasts == sorted(contrasts)


def test_an_unknown_mark_is_an_error():
    with pytest.raises(TypeError, match="cannot draw str"):
        draw_mark("mark", None, LIGHT)
    with pytest.raises(TypeError, match="cannot draw str"):
        columns_of("mark")
