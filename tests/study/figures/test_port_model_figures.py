"""Bode and Nyquist plots of a Diagram's loop show the margins at their places."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, LinearSystem, ZeroOrderHold
from scipy.optimize import brentq

from teleop_drake import PlotBode, PlotNyquist, SaveFigure
from teleop_drake.loops import LinearizePorts
from teleop_drake.loops.delays.transport import TransportDelay
from teleop_drake.model.scenario import ScenarioError

# 2 / (s (s + 1) (s + 2))
THIRD = ([[0.0, 1, 0], [0, 0, 1], [0, -2, -3]], [[0.0], [0], [2]], [[1.0, 0, 0]])
# 3 / (s - 1)
UNSTABLE_PLANT = ([[1.0]], [[3.0]], [[1.0]])
# 1 / s and 2 / s
TWO_INTEGRATORS = (np.zeros((2, 2)), np.eye(2), np.diag([1.0, 2.0]))


def MakeModel(plant, delay=0.0, period=0.0, output=None):
    """Returns the model of a plant under negative feedback, cut at the feedback.

    Args:
        plant: A, B and C of the plant.
        delay: The delay in s in the feedback.
        period: The period of a hold in the feedback, s.
        output: The name of the system whose output is observed; None: the loop.
    """
    builder = DiagramBuilder()
    A, B, C = map(np.asarray, plant)
    size = len(C)
    system = LinearSystem(A, B, C, np.zeros((size, size)))
    chain = [builder.AddNamedSystem("plant", system)]
    chain.append(builder.AddNamedSystem("back", Gain(-1.0, size)))
    if period:
        chain.append(builder.AddNamedSystem("hold", ZeroOrderHold(period, size)))
    if delay:
        chain.append(builder.AddNamedSystem("late", TransportDelay(delay, size)))
    for source, target in zip(chain, [*chain[1:], chain[0]], strict=True):
        builder.Connect(source.get_output_port(), target.get_input_port())
    diagram = builder.Build()
    entry = diagram.GetSubsystemByName("hold" if period else "back")
    seen = output and diagram.GetSubsystemByName(output).get_output_port()
    return LinearizePorts(
        diagram,
        diagram.CreateDefaultContext(),
        entry.get_input_port(),
        seen,
        is_opened=True,
        is_settled=True,
    )


def Marks(ax, marker):
    """Returns the points with a marker in a panel (k, 2)."""
    lines = [line for line in ax.get_lines() if line.get_marker() == marker]
    return np.array([line.get_xydata()[0] for line in lines])


def Labels(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.mostly_slow
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_a_bode_plot_has_the_margins_of_a_third_order_loop(delay, tmp_path):
    """Without delay the gain margin is 3, at the frequency sqrt 2 where L = -1/3."""
    figure = PlotBode(MakeModel(THIRD, delay=delay))
    top, bottom = figure.axes
    w = 0.7493682758222622  # |L| = 1: w^2 (w^2 + 1) (w^2 + 4) = 4
    assert w**2 * (w**2 + 1) * (w**2 + 4) == pytest.approx(4, rel=1e-12)
    lag = 90 + math.degrees(math.atan(w) + math.atan(w / 2) + delay * w)
    assert_allclose(Marks(top, "o"), [[w, 1.0]], rtol=1e-6)
    assert_allclose(Marks(bottom, "o"), [[w, -lag]], rtol=1e-6)
    assert_allclose(Marks(bottom, "^"), [[w, -lag]], rtol=1e-6)
    ((w_pi, size),) = Marks(top, "s")
    assert_allclose(Marks(bottom, "s"), [[w_pi, -180.0]], rtol=1e-6)
    lags = 90 + math.degrees(math.atan(w_pi) + math.atan(w_pi / 2) + delay * w_pi)
    assert lags == pytest.approx(180.0, rel=1e-7)
    if delay == 0:
        assert (w_pi, size) == pytest.approx((math.sqrt(2), 1 / 3), rel=1e-7)
        assert Labels(figure) == [
            "gain margin 3 (9.5 dB) at 1.41 rad/s",
            "phase margin 32.6° at 0.749 rad/s",
            "delay margin 0.7596 s at 0.749 rad/s",
        ]
    SaveFigure(figure, tmp_path / "bode.png")
    assert (tmp_path / "bode.png").stat().st_size > 10_000


def test_the_curves_are_the_response_with_a_continuous_phase():
    top, bottom = PlotBode(MakeModel(THIRD, delay=3.0)).axes
    w, size = top.get_lines()[0].get_data()
    s = 1j * np.asarray(w)
    assert_allclose(size, np.abs(2 / (s * (s + 1) * (s + 2))), rtol=1e-12)
    phase = np.radians(bottom.get_lines()[0].get_ydata())
    expected = -math.pi / 2 - np.arctan(w) - np.arctan(w / 2) - 3.0 * w
    assert_allclose(phase, expected, atol=1e-9)
    w_pi = brentq(lambda w: math.pi / 2 - math.atan(w) - math.atan(w / 2) - 3 * w, 0, 1)
    size = 2 / (w_pi * math.hypot(1, w_pi) * math.hypot(2, w_pi))
    words = f"unstable; stable with less than {1 / size:.4g}\ntimes the gain"
    assert Labels(top.figure) == [f"the closed loop is {words}"]


def test_a_nyquist_plot_has_the_margins_of_an_unstable_plant():
    """The gain may fall to 1/3, where the locus begins, at L(0) = -3."""
    figure = PlotNyquist(MakeModel(UNSTABLE_PLANT))
    (ax,) = figure.axes
    assert_allclose(Marks(ax, "s"), [[-3.0, 0.0]], rtol=1e-8)
    w = math.sqrt(8)
    L = 3 / (1j * w - 1)
    assert_allclose(Marks(ax, "o"), [[L.real, L.imag]], rtol=1e-6)
    assert Labels(figure) == [
        "-1",
        "gain margin 0.333 (-9.5 dB) at 0 rad/s",
        "phase margin 70.5° at 2.83 rad/s",
        f"delay margin {math.acos(1 / 3) / w:.4g} s at 2.83 rad/s",
    ]
    (arc,) = [patch for patch in ax.patches if hasattr(patch, "theta1")]
    assert (arc.theta1, arc.theta2) == pytest.approx((180.0, 180 + 70.5288), abs=1e-3)
    curve = ax.get_lines()[0].get_xydata()[0]
    assert curve == pytest.approx([-3.0, 0.0], abs=0.01)
    assert PlotBode(MakeModel(UNSTABLE_PLANT)).axes[0].get_lines()


def test_a_loop_of_two_signals_has_two_loci():
    """The loop with 2 / s has the smaller delay margin, pi / 4 s."""
    figure = PlotBode(MakeModel(TWO_INTEGRATORS))
    assert_allclose(Marks(figure.axes[0], "^"), [[2.0, 1.0]], rtol=1e-6)
    assert "delay margin 0.7854 s at 2 rad/s" in Labels(figure)
    assert Labels(figure)[-2:] == ["locus 1", "locus 2"]


def test_a_sampled_loop_is_drawn_up_to_the_nyquist_frequency():
    model = MakeModel(THIRD, period=0.05)
    figure = PlotBode(model)
    gain, phase, delay, nyquist = Labels(figure)
    assert gain.startswith("gain margin 2.79 (8.9 dB)")
    assert phase.startswith("phase margin 31.5°")
    assert delay == f"delay margin {model.margins().delay:.4g} s"
    assert nyquist == "Nyquist frequency"
    ((w, size),) = Marks(figure.axes[0], "s")
    (value,) = model.Response([w])[:, 0, 0]
    assert value == pytest.approx(-size, rel=1e-6)
    assert PlotNyquist(model).axes


def test_a_response_that_is_no_loop_has_no_margins():
    model = MakeModel(TWO_INTEGRATORS, output="plant")
    figure = PlotBode(model)
    assert Labels(figure)[0] == "output 0 by input 0"
    with pytest.raises(ScenarioError, match="must be a loop"):
        PlotNyquist(model)


def test_a_loop_that_every_delay_leaves_stable_says_so():
    """0.5 / (s + 1) never reaches a magnitude of 1."""
    figure = PlotBode(MakeModel(([[-1.0]], [[0.5]], [[1.0]])))
    assert Labels(figure) == ["stable with every delay"]
