"""A delay line with a rule of its own: it delivers what the rule says, and jumps."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.channels.delay_line import DelayLine


class Slowing(DelayLine):
    """What is sent at t arrives at 1.25 t + 0.5: the delay grows with time."""

    def __init__(self, size=1, initial_value=None, interval=None):
        DelayLine.__init__(
            self,
            size=size,
            initial_value=initial_value,
            shortest_delay=0.5,
            max_sample_interval=interval,
        )

    def StoreKey(self, time):
        return time

    def FetchKey(self, time):
        return (time - 0.5) / 1.25

    def FetchTime(self, key):
        return 1.25 * key + 0.5


def test_it_delivers_by_the_rule_of_its_keys():
    breaks = [0.0, 1.0, 2.0, 3.0]
    signal = PiecewisePolynomial.CubicShapePreserving(
        breaks, np.array([[1.0, 3.0, -2.0, 0.0]]), True
    )
    builder = DiagramBuilder()
    source = builder.AddSystem(TrajectorySource(signal))
    line = builder.AddSystem(Slowing(initial_value=[7.0]))
    builder.Connect(source.get_output_port(), line.get_input_port())
    log = LogVectorOutput(line.get_output_port(), builder)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(3.0)
    data = log.FindLog(simulator.get_context())
    times, values = data.sample_times(), data.data()[0]
    before = times <= 0.5  # Of a jump at this very instant the left side.
    assert np.all(values[before] == 7.0)
    sent = (times[~before] - 0.5) / 1.25
    expected = [signal.value(t)[0, 0] for t in sent]
    # Kinks of the second derivative, between samples 0.01 s apart.
    np.testing.assert_allclose(values[~before], expected, atol=1e-4)
    assert np.ptp(values) > 5


def test_it_has_no_feedthrough_and_says_how_long_steps_may_be():
    line = Slowing(size=2)
    assert not line.HasAnyDirectFeedthrough()
    assert line.longest_step == 0.5
    assert line.GetOutputPort("delayed_signal").size() == 2
    # The first packet is sent at time 0.
    assert line.NextJumpTime(line.CreateDefaultContext()) == 0.5


@pytest.mark.parametrize("interval", [0.0, 0.6, -1.0, math.nan])
def test_bad_sample_intervals(interval):
    with pytest.raises(ValueError, match="max_sample_interval"):
        Slowing(interval=interval)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [({"size": 0}, "size"), ({"size": 2, "initial_value": [1.0]}, "initial_value")],
)
def test_bad_parameters(arguments, name):
    with pytest.raises(ValueError, match=name):
        Slowing(**arguments)
