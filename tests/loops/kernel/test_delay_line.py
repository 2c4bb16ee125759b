"""Delay lines: of one's own kernel, which says T(t), and in Drake's own Simulator."""

import numpy as np
import pytest
from kernel_checks import CheckKernel
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    FirstOrderLowPassFilter,
    LogVectorOutput,
    Sine,
    TrajectorySource,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial
from sources import Step
from wired import InSeries, Wired

from teleop_drake.loops import MakeSimulator, TransportDelay, simulate
from teleop_drake.loops.framework.solver import DefaultSimulator
from teleop_drake.loops.kernel import Delay, Kernel, KernelBlock


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
    times = data.sample_times()
    values = data.data()[0]
    before = times <= 0.5  # Of a jump at this very instant the left side.
    assert np.all(values[before] == 7.0)
    sent = (times[~before] - 0.5) / 1.25
    expected = [signal.value(t)[0, 0] for t in sent]
    # Kinks of the second derivative, between samples 0.01 s apart.
    assert_allclose(values[~before], expected, atol=1e-4)
    assert np.ptp(values) > 5
    assert CheckKernel(Slowing([7.0])) == []


def test_it_has_no_feedthrough_and_says_how_long_steps_may_be():
    line = Slowing([0.0, 0.0])
    assert not line.HasAnyDirectFeedthrough()
    assert line.LongestStep(line.CreateDefaultContext()) == 0.5
    assert line.GetOutputPort("delayed_signal").size() == 2
    # The first packet is sent at time 0.
    assert line.NextJumpTime(line.CreateDefaultContext()) == pytest.approx(0.5)


def behind(source):
    """Returns a Diagram with a source in front of a delay and a filter."""
    parts = {
        "source": source,
        "delay": TransportDelay(0.35, 1),
        "filter": FirstOrderLowPassFilter(0.05, 1),
    }
    sent = f"source.{source.get_output_port(0).get_name()}"
    diagram = Wired(parts, InSeries(sent, "delay", "filter"), {"y": "filter"})
    diagram.set_name("loop")
    return diagram


def held_sine():
    """Returns a Diagram of a sine that is held for 0.1 s."""
    return Wired(
        {"sine": Sine(1.0, 6.0, 0.7, 1), "hold": ZeroOrderHold(0.1, 1)},
        {"hold": "sine.y0"},
        {"held": "hold"},
    )


def test_a_held_signal_in_drakes_own_simulator_has_a_warning():
    """Its jumps are delayed as ramps: the output is wrong by more than a tenth."""
    simulator = Simulator(behind(held_sine()))
    simulator.get_mutable_context().SetAccuracy(1e-4)
    match = r"^loop::delay: its signal jumps by a discrete update, .*MakeSimulator\("
    with pytest.warns(UserWarning, match=match) as warned:
        simulator.AdvanceTo(1.0)
    assert len(warned) == 1


@pytest.mark.parametrize(
    "make",
    [lambda: Sine(1.0, 6.0, 0.7, 1), lambda: Step(time=0.2, before=[0], after=[1])],
    ids=["smooth", "unrestricted"],
)
def test_other_signals_in_drakes_own_simulator_have_none(make):
    """Warnings are errors here."""
    Simulator(behind(make())).AdvanceTo(1.0)


def test_a_held_signal_in_the_simulator_of_the_package_has_none():
    MakeSimulator(behind(held_sine()), DefaultSimulator()).AdvanceTo(0.3)
    simulate(behind(held_sine()), duration=0.3, engine="drake")
