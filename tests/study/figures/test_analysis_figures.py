"""Tests of figures.analysis: they show what the analysis found."""

import dataclasses
import functools

import numpy as np
import pytest
from grids import Slow
from numpy.testing import assert_allclose

from teleop_drake.loops.numerics.state_space import state_space
from teleop_drake.model.scenario import LoadScenario
from teleop_drake.study.analysis.operating_point import POSITION, OperatingPoints
from teleop_drake.study.analysis.stability import (
    AnalyzeStability,
)
from teleop_drake.study.analysis.stability_chart import ChartStability
from teleop_drake.study.analysis.transparency import AnalyzeTransparency
from teleop_drake.study.figures.analysis import (
    PlotBode,
    PlotFeltStiffness,
    PlotNyquist,
    PlotStabilityChart,
    PlotStableDelays,
    PlotTransparency,
)
from teleop_drake.study.figures.runs import SaveFigure
from teleop_drake.study.figures.saving import DescribeFigure

# They look at the same analyses.
pytestmark = pytest.mark.xdist_group("analyses")


@functools.cache
def Analysis(name="one_dof", kind="direct_force"):
    return AnalyzeStability(LoadScenario(name, {"controller.kind": kind}))


def Lines(ax, width):
    return [
        line
        for line in ax.get_lines()
        if line.get_linewidth() == width and len(line.get_xdata()) > 100
    ]


@pytest.mark.parametrize("plot", Slow([PlotNyquist, PlotBode, PlotStableDelays]))
def test_can_be_drawn(plot, tmp_path):
    figure = plot(Analysis())
    SaveFigure(figure, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_bode_shows_the_phase_margin():
    analysis = Analysis()
    axes = np.reshape(PlotBode(analysis).axes, (2, 3))
    for ax, point in zip(axes[1], analysis.points, strict=True):
        (thin,) = Lines(ax, 0.6)
        (thick,) = Lines(ax, 1.1)
        w = point.margin.frequency
        phase = np.interp(w, thin.get_xdata(), thin.get_ydata())
        assert phase + 180 == pytest.approx(
            np.degrees(point.margin.phase_margin), abs=1
        )
        delayed = np.interp(w, thick.get_xdata(), thick.get_ydata())
        assert phase - delayed == pytest.approx(np.degrees(w * point.delay), abs=1)


def test_nyquist_shows_the_delayed_loop():
    ax = PlotNyquist(Analysis()).axes[1]
    (thin,) = Lines(ax, 0.6)[:1]
    (thick,) = Lines(ax, 1.1)
    undelayed = np.array(thin.get_xdata()) + 1j * np.array(thin.get_ydata())
    delayed = np.array(thick.get_xdata()) + 1j * np.array(thick.get_ydata())
    assert_allclose(np.abs(delayed), np.abs(undelayed))
    free = Analysis()["free"]
    i = int(np.argmin(np.abs(np.abs(delayed) - 1)))
    turn = np.angle(undelayed[i] / delayed[i])
    assert turn == pytest.approx(free.margin.frequency * free.delay, rel=1e-2)


def test_bars_are_the_intervals():
    analysis = Analysis()
    (ax,) = PlotStableDelays(analysis).axes
    bars = [
        (patch.get_x(), patch.get_x() + patch.get_width())
        for patch in ax.patches
        if patch.get_zorder() == 2
    ]
    expected = [x for loop in analysis.Loops() for x in loop.stable_delays]
    assert_allclose(bars, expected)
    labels = [tick.get_text() for tick in ax.get_yticklabels()]
    assert labels == ["tissue", "free", "bone", "bone, force held"]


def test_bars_of_two_controllers_are_told_apart():
    both = [Analysis(), Analysis(kind="adaptive_backstepping")]
    (ax,) = PlotStableDelays(both).axes
    labels = [tick.get_text() for tick in ax.get_yticklabels()]
    assert labels[0] == "direct force, tissue" and len(set(labels)) == 8


@pytest.mark.slow
def test_chart_has_a_panel_for_each_point():
    chart = ChartStability(
        "one_dof",
        "robot.mass",
        [0.3, 1.0],
        overrides=["controller.kind=direct_force"],
    )
    figure = PlotStabilityChart(chart)
    titles = [ax.get_title() for ax in figure.axes]
    assert titles == ["tissue", "free", "bone", "bone, force held"]
    assert all(ax.get_xlabel() == "robot mass [kg]" for ax in figure.axes)
    stable = [p for p in figure.axes[1].patches if p.get_zorder() == 2]
    ends = [intervals[0][1] for intervals in chart.StableDelays("free")]
    assert_allclose([p.get_height() for p in stable], ends)


def test_chart_along_the_path_has_one_panel():
    chart = ChartStability("one_dof", POSITION, [0.002, 0.01, 0.0151])
    (ax,) = PlotStabilityChart(chart).axes
    assert ax.get_xlabel() == "tool position x [m]"
    assert ax.get_title() == "along the path, velocity commanded"
    assert len([p for p in ax.patches if p.get_zorder() == 1]) == 3


def test_nothing_to_draw(subtests):
    analysis = Analysis()
    empty = dataclasses.replace(analysis, points=[])
    for plot in (PlotBode, PlotNyquist, PlotStableDelays):
        with (
            subtests.test(plot=plot),
            pytest.raises(ValueError, match="must be"),
        ):
            plot(empty)
    chart = ChartStability("one_dof", "robot.mass", [1.0])
    with pytest.raises(ValueError, match=r"robot\.mass = .*: must be a list of two"):
        PlotStabilityChart(chart)


def test_bode_of_a_loop_that_is_nothing():
    analysis = Analysis()
    points = []
    for point in analysis.points:
        L = point.loop
        loop = state_space(L.A, 1e-30 * L.B, L.C, L.D)
        points.append(dataclasses.replace(point, loop=loop, crossings=[]))
    figure = PlotBode(dataclasses.replace(analysis, points=points))
    assert figure.axes[-1].get_ylim() == (-270, 90)


def test_felt_stiffness_of_direct_force_is_its_closed_form():
    scenarios = {
        f"{trip:g} s": LoadScenario(
            "one_dof", {"controller.kind": "direct_force", "delay": trip / 2}
        )
        for trip in (0.2, 0.5)
    }
    figure = PlotFeltStiffness(
        {"both": scenarios, "one": {"0.5 s": scenarios["0.5 s"]}}
    )
    both, one = figure.axes
    assert both.get_title() == "both" and one.get_title() == "one"
    curves = [x for ax in figure.axes for x in ax.get_lines() if len(x.get_xdata()) > 9]
    for line, trip in zip(curves, (0.2, 0.5, 0.5), strict=True):
        w = line.get_xdata()
        assert (w[0], w[-1]) == (0.1, pytest.approx(30.0))
        expected = (150 - 0.5 * w**2) * np.cos(w * trip) - 0.1 * w * np.sin(w * trip)
        assert_allclose(line.get_ydata(), expected, rtol=1e-6, atol=1e-5)
    assert curves[1].get_color() == curves[2].get_color() != curves[0].get_color()
    # The range shown is that of the environment and of what is felt up to 1 rad/s.
    assert both.get_ylim() == pytest.approx((-165.0, 165.0), rel=1e-3)
    with pytest.raises(ValueError, match=r"panels = \{\}: must be one or more"):
        PlotFeltStiffness({})


@pytest.mark.parametrize(
    ("kind", "text"),
    [("direct_force", "everywhere below 1"), ("wave_variables", None)],
)
def test_llewellyns_parameter_is_explained(kind, text):
    scenario = LoadScenario("one_dof", {"controller.kind": kind})
    point = OperatingPoints(scenario)[0]
    transparency = AnalyzeTransparency(scenario, point)
    figure = PlotTransparency([transparency])
    texts = [note.get_text() for note in figure.axes[1].texts]
    assert [note.split("\n")[0] for note in texts] == ([text] if text else [])
    assert "below 1: unstable with some passive operator" in DescribeFigure(figure)
    # Made up: it drops at 3 rad/s.
    w = transparency.frequencies
    dropped = dataclasses.replace(
        transparency,
        llewellyn=np.select([w < 3, w < 9], [1.0, 0.5], -np.inf)[:, np.newaxis],
    )
    (note,) = PlotTransparency([dropped]).axes[1].texts
    below, drop = note.get_text().split("\n")
    assert below == f"below 1 from {w[w >= 3][0]:.2g} rad/s"
    assert drop == f"gives out energy at {w[w >= 9][0]:.2g} rad/s"
