"""Tests of the guard against Drake's stale results after a rejected step."""

import gc
import weakref
from itertools import pairwise

import numpy as np
import pytest
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import DiagramBuilder, EventStatus, LeafSystem

from teleop_drake.loops.kernel import Kernel
from teleop_drake.loops.kernel.block import FixedBlock
from teleop_drake.loops.run.simulator import CountsOf, MakeSimulator

START = [1.0, 0.0]


class Memory(LeafSystem):
    """An integrator whose output depends on the state only."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.rate = self.DeclareVectorInputPort("rate", 2)
        self.DeclareStateOutputPort("state", self.DeclareContinuousState(2))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector(self.rate.Eval(context))


class VanDerPol(LeafSystem):
    """A function of [x; v]: its rate for x'' - 5 (1 - x^2) x' + x = 0."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.state = self.DeclareVectorInputPort("state", 2)
        self.DeclareVectorOutputPort(
            "rate",
            2,
            self.CalcRate,
            prerequisites_of_calc={self.state.ticket()},
        )

    def CalcRate(self, context, output):
        x, v = self.state.Eval(context)
        output.SetFromVector([v, 5 * (1 - x * x) * v - x])


def make_oscillator(watcher=None):
    """Returns an oscillator, with a block of the package in first or last place."""
    builder = DiagramBuilder()
    if watcher == "first":
        builder.AddSystem(make_watcher())
    memory = builder.AddNamedSystem("memory", Memory())
    oscillator = builder.AddNamedSystem("oscillator", VanDerPol())
    builder.Connect(memory.get_output_port(), oscillator.get_input_port())
    builder.Connect(oscillator.get_output_port(), memory.get_input_port())
    if watcher == "last":
        builder.AddSystem(make_watcher())
    return builder.Build()


def make_watcher():
    kernel = Kernel(outputs={"time": "time"})
    return FixedBlock("watcher", kernel, inputs={}, outputs={"time": 1})


def steps(simulator, scheme, **config):
    """Yields each step's length, its first and last state, whether it was repeated."""
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme=scheme, **config), simulator
    )
    simulator.get_mutable_context().SetContinuousState(START)
    rows = []

    def monitor(context):
        rows.append(
            (
                context.get_time(),
                context.get_continuous_state_vector().CopyToVector(),
                num_repeated(simulator),
            )
        )
        return EventStatus.DidNothing()

    simulator.set_monitor(monitor)
    simulator.Initialize()
    simulator.AdvanceTo(6.0)
    simulator.clear_monitor()
    for (t0, x0, n0), (t1, x1, n1) in pairwise(rows):
        yield t1 - t0, x0, x1, n1 > n0


def num_repeated(simulator):
    """Returns the number of steps that were repeated since the start."""
    return CountsOf(simulator).rejected


def largest_difference(simulator, scheme, *, repeated):
    """Returns the largest difference between steps with and without error control."""
    config = {"accuracy": 1e-4, "max_step_size": 0.3, "use_error_control": True}
    differences = []
    for h, x0, x1, was_repeated in steps(simulator, scheme, **config):
        if was_repeated != repeated:
            continue
        other = Simulator(make_oscillator())
        ApplySimulatorConfig(
            SimulatorConfig(
                integration_scheme=scheme, max_step_size=1.0, use_error_control=False
            ),
            other,
        )
        other.get_mutable_context().SetContinuousState(x0)
        other.AdvanceTo(h)
        end = other.get_context().get_continuous_state_vector().CopyToVector()
        differences.append(np.abs(x1 - end).max())
    assert len(differences) > 5
    return max(differences)


@pytest.mark.parametrize("watcher", ["first", "last"])
@pytest.mark.parametrize("scheme", ["runge_kutta5", "runge_kutta3"])
def test_a_repeated_step_is_as_good_as_the_first(scheme, watcher):
    diagram = make_oscillator(watcher)
    # Each Simulator of the diagram has its own guard.
    for simulator in [MakeSimulator(diagram, SimulatorConfig()) for _ in range(2)]:
        assert largest_difference(simulator, scheme, repeated=True) < 1e-12


def test_drake_alone_still_needs_the_guard():
    """If this test fails, Drake has been repaired and the guard can be removed."""
    for repeated in (False, True):
        simulator = Simulator(make_oscillator())
        difference = largest_difference(simulator, "runge_kutta5", repeated=repeated)
        assert (difference > 1e-6) == repeated


def test_a_diagram_can_be_simulated_again():
    diagram = make_oscillator("first")
    ends = []
    for _ in range(2):
        simulator = MakeSimulator(diagram, SimulatorConfig())
        context = diagram.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        context.SetContinuousState(START)
        simulator.AdvanceTo(1.0)
        ends.append(context.get_continuous_state_vector().CopyToVector().tolist())
    assert ends[0] == ends[1] != START
    # Other Simulators of the diagram are not affected.
    alone = Simulator(diagram)
    alone.get_mutable_context().SetContinuousState(START)
    alone.AdvanceTo(1.0)
    assert diagram.CreateDefaultContext().num_continuous_states() == 2


def test_the_guard_lets_go_of_the_simulator():
    gc.disable()  # All objects stay in generation 0, which is collected below.
    simulator = MakeSimulator(make_oscillator("first"), SimulatorConfig())
    simulator.AdvanceTo(0.1)
    reference = weakref.ref(simulator)
    del simulator
    gc.collect(0)
    gc.enable()
    assert reference() is None
