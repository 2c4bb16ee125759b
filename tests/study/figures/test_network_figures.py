"""Tests of teleop_drake.study.figures.network."""

import numpy as np
import pytest
from runs import Run

from teleop_drake.study.figures.network import Networks, PlotNetwork
from teleop_drake.study.figures.saving import DescribeFigure

NETWORK = (
    "forward_channel={kind: network, delay: 0.05, sample_period: 0.02, "
    "jitter: {kind: gamma, std: 0.02}, loss: {kind: burst, probability: 0.3, "
    "burst_length: 4}}"
)


def test_it_shows_what_the_statistics_say():
    run = Run(
        "one_dof", "direct_force", NETWORK, "duration=2", "simulator.accuracy=1e-4"
    )
    statistics = run.channels["forward_channel"]
    figure = PlotNetwork(run)
    delay, age, loss = figure.axes
    points, lost = delay.get_lines()[:2]
    # The rest were still under way.
    assert statistics.received <= len(points.get_xdata())
    assert len(points.get_xdata()) + len(lost.get_xdata()) == statistics.sent
    assert len(lost.get_xdata()) == statistics.lost
    assert max(points.get_ydata()) >= 1e3 * statistics.delay_maximum
    times, ages = age.get_lines()[0].get_data()
    mean = np.trapezoid(ages, times) / (times[-1] - times[0])
    assert mean == pytest.approx(1e3 * statistics.age_mean)
    assert max(ages) == pytest.approx(1e3 * statistics.age_maximum)
    (total,) = (x for x in loss.get_lines() if x.get_linestyle() == "--")
    assert total.get_ydata()[0] == pytest.approx(100 * statistics.loss_rate)
    text = DescribeFigure(figure)
    assert (
        "age of information [ms]" in text and "Legend: lost packet, lost in all" in text
    )


def test_a_run_without_packets_has_no_such_figure():
    run = Run("one_dof", "direct_force", "duration=0.05", "simulator.accuracy=1e-4")
    assert not Networks(run)
    with pytest.raises(ValueError, match=r"must be a run with a channel of packets"):
        PlotNetwork(run)
