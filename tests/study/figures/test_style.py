"""Tests of the style that figures share."""

import struct

import pytest
from matplotlib.colors import to_hex

from teleop_drake import Sweep
from teleop_drake.study.figures.labels import ShortLabels
from teleop_drake.study.figures.style import COLORS, Figure


def test_a_figure_of_ones_own_has_the_colours_and_open_axes():
    figure = Figure(figsize=(4, 2))
    for ax in figure.subplots(1, 2):
        lines = [ax.plot([0, 1], [0, i])[0] for i in range(len(COLORS))]
        assert [to_hex(x.get_color()).upper() for x in lines] == list(COLORS)
        assert not ax.spines["top"].get_visible()
        assert ax.spines["left"].get_visible()
    assert figure.get_layout_engine() is not None


def test_a_notebook_shows_a_figure_in_twice_its_dots():
    figure = Figure(figsize=(4, 2))
    figure.subplots().legend(handles=[])
    picture, size = figure._repr_png_()
    assert size == {"width": 400, "height": 200}
    assert struct.unpack(">II", picture[16:24]) == (800, 400)
    assert not figure.axes[0].get_legend().get_frame_on()


@pytest.mark.parametrize(
    ("labels", "short"),
    [
        (["delay = 0.1 s", "delay = 0.2 s"], ["delay = 0.1 s", "0.2 s"]),
        (["direct force", "adaptive"], ["direct force", "adaptive"]),
        (["a, delay = 1 s", "b, delay = 1 s"], ["a, delay = 1 s", "b, delay = 1 s"]),
        (["mass = 1 kg, G1 = 2", "mass = 2 kg, G1 = 2"],) * 2,
        ([], []),
    ],
)
def test_the_name_of_a_varied_key_stands_in_the_first_label(labels, short):
    assert ShortLabels(labels) == short


@pytest.mark.slow
def test_a_sweep_plots_itself():
    """Without metrics, the most used ones that its runs have."""
    grid = {"delay": [0.05, 0.1]}
    sweep = Sweep("one_dof", grid, overrides={"duration": 0.3}, jobs=1)
    figure = sweep.plot("start_velocity_overshoot")
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 1
    assert len(sweep.plot().axes) == len(sweep.Metrics())
