"""A delay of one's own: a kernel that says T(t), and nothing else."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from teleop_drake.kernel import Delay, Kernel, KernelBlock


class Slowing(KernelBlock):
    """What is sent at t arrives at 1.25 t + 0.5: the delay grows with time."""

    def __init__(self, initial_value):
        KernelBlock.__init__(self)
        self._initial_value = initial_value
        self.DeclareVectorInputPort("signal", len(initial_value))
        self.DeclareOutputs(delayed_signal=len(initial_value))

    def Kernel(self):
        delay = Delay(
            signal="signal",
            output="delayed_signal",
            initial_value=self._initial_value,
            time=lambda t: 0.2 * t + 0.4,
            shortest=0.5,
        )
        return Kernel(delays=[delay])


def test_it_delivers_by_the_rule_of_its_keys():
    breaks = [0.0, 1.0, 2.0, 3.0]
    signal = PiecewisePolynomial.CubicShapePreserving(
        breaks, np.array([[1.0, 3.0, -2.0, 0.0]]), True
    )
    builder = DiagramBuilder()
    source = builder.AddSystem(TrajectorySource(signal))
    line = builder.AddSystem(Slowing([7.0]))
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
    assert CheckKernel(Slowing([7.0])) == []


def test_it_has_no_feedthrough_and_says_how_long_steps_may_be():
    line = Slowing([0.0, 0.0])
    assert not line.HasAnyDirectFeedthrough()
    assert line.LongestStep(line.CreateDefaultContext()) == 0.5
    assert line.GetOutputPort("delayed_signal").size() == 2
    # The first packet is sent at time 0.
    assert line.NextJumpTime(line.CreateDefaultContext()) == pytest.approx(0.5)
