import functools
from xml.etree import ElementTree

import numpy as np
import pytest
from grids import Slow
from matplotlib.figure import Figure
from numpy.testing import assert_array_equal
from pydrake.systems.framework import Diagram

from teleop_drake.thesis.figures import FIGURES, WritePicture
from teleop_drake.thesis.runs import ADAPTIVE, DIRECT, ThesisRuns

pytestmark = pytest.mark.xdist_group("thesis")

NUMBERS = [
    *("2.1", "2.4"),
    *(f"3.{i}" for i in range(2, 6)),
    *(f"4.{i}" for i in range(1, 7)),
    *(f"5.{i}" for i in range(1, 21)),
]
COMPARISONS = ["4.1", "5.9", "4.2", "4.3", "5.1", "5.2", "5.3", "5.7", "5.8", "5.10"]
COMPARISONS += ["5.14", "5.15", "5.16", "5.17"]
TIME_ONLY = ["5.9", "5.16"]
# One of each kind.
KINDS = ["2.4", "3.2", "4.1", "4.6", "5.5", "5.9"]


def Curves(ax):
    """The lines of a panel that are data: neither borders nor the zero line."""
    return [line for line in ax.get_lines() if len(line.get_xdata()) > 2]


@functools.cache
def Made(number, runs):
    """A figure of the thesis, at which several tests look."""
    return FIGURES[number].make(runs)


def Legend(figure):
    return [text.get_text() for box in figure.legends for text in box.get_texts()]


def test_every_figure_of_the_thesis_is_there(subtests):
    assert list(FIGURES) == NUMBERS
    for number, figure in FIGURES.items():
        with subtests.test(number=number):
            assert figure.number == number
            assert figure.title and figure.caption.endswith(".")


@pytest.mark.parametrize(
    "number",
    Slow(NUMBERS[1:], but=[NUMBERS.index(number) - 1 for number in KINDS]),
)
def test_axes_have_data_labels_and_units(thesis_runs, number):
    figure = Made(number, thesis_runs)
    assert isinstance(figure, Figure)
    axes = [ax for ax in figure.axes if ax.get_visible()]
    assert axes
    for ax in axes:
        assert ax.get_lines()
        for line in Curves(ax):
            assert np.isfinite(line.get_xydata()).all()
        assert any(
            np.ptp(line.get_xdata()) > 0 or np.ptp(line.get_ydata()) > 0
            for line in ax.get_lines()
        )
        # A panel that shares an axis shares its label too.
        cell = ax.get_subplotspec()
        if cell.is_last_row():
            assert ax.get_xlabel().endswith("]") or "[mm]" in ax.get_xlabel()
        if cell.is_first_col():
            assert "[" in ax.get_ylabel() and ax.get_ylabel().endswith("]")


@pytest.mark.parametrize("number", Slow(COMPARISONS, but=[0, 1]))
def test_comparisons_show_both_controllers(thesis_runs, number):
    figure = Made(number, thesis_runs)
    legend = Legend(figure)
    assert legend[0].startswith("direct force") and legend[1].startswith("adaptive")
    for ax in figure.axes:
        assert len(Curves(ax)) >= 2
    columns = 1 if number in TIME_ONLY else 2
    num_axes = 1 if number.startswith("4") else 2
    assert len(figure.axes) == num_axes * columns
    labels = {ax.get_xlabel() for ax in figure.axes} - {""}
    assert "time [s]" in labels
    assert len(labels) == columns


def test_curves_are_those_of_the_runs(thesis_runs):
    recording = thesis_runs("one_dof", ADAPTIVE).recording
    (ax,) = Made("4.6", thesis_runs).axes
    curves = Curves(ax)
    assert len(curves) == recording["weights_3"].shape[1]
    for k, curve in enumerate(curves):
        assert_array_equal(curve.get_xdata(), recording.time)
        assert_array_equal(curve.get_ydata(), recording["weights_3"][:, k])
    position, _ = Made("5.9", thesis_runs).axes
    recording = thesis_runs("two_dof_collision", DIRECT).recording
    x = Curves(position)[0].get_ydata()
    assert x.max() == pytest.approx(recording["tool_position"][:, 0].max(), rel=1e-4)


def test_weights_of_the_planar_arm_are_told_apart_by_axis_and_centre(thesis_runs):
    recording = thesis_runs("two_dof_combined", ADAPTIVE).recording
    num_functions = recording["weights_1"].shape[1] // 2
    for k, ax in enumerate(Made("5.18", thesis_runs).axes):
        for i, curve in enumerate(Curves(ax)):
            assert_array_equal(
                curve.get_ydata(), recording["weights_1"][:, k * num_functions + i]
            )


def test_stiffness_profile():
    tissue, bone = FIGURES["2.4"].make(ThesisRuns()).axes
    # k x at the end of the tissue: 0.01 N/m times 7.5 mm.
    assert Curves(tissue)[0].get_ydata().max() == pytest.approx(0.075)
    x, force = Curves(bone)[0].get_xydata()[-1]
    assert force == pytest.approx(150 * (x - 15))


@pytest.mark.slow
@pytest.mark.parametrize("number", Slow(["2.1", "4.5"], but=[1]))
def test_files_are_reproducible(thesis_runs, reproduced, tmp_path, number):
    picture = FIGURES[number].make(thesis_runs)
    png, svg = WritePicture(picture, tmp_path / FIGURES[number].stem)
    stem = f"figure_{number.replace('.', '_')}"
    assert (png.name, svg.name) == (f"{stem}.png", f"{stem}.svg")
    for path in (png, svg):
        assert path.read_bytes() == (reproduced.folder / path.name).read_bytes()
    text = "".join(ElementTree.parse(svg).getroot().itertext())
    assert isinstance(picture, Diagram) == ("forward_channel" in text) == (number < "3")
