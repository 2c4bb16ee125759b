"""Outputs read from the memory of a Context, against OutputPort.Eval()."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import PidController
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    AffineSystem,
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    Integrator,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    PassThrough,
    SparseMatrixGain,
    ZeroOrderHold,
)
from scipy.sparse import csc_matrix

from teleop_drake.loops.framework.signals import SignalsOf
from teleop_drake.loops.run.moving import Motion
from teleop_drake.loops.run.readings import MemoryOf, Readings

ONE = np.eye(1)


class Ignoring(LeafSystem):
    """An output in Python that may depend on the input, and does not read it."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareVectorInputPort("u", 1)
        self.DeclareVectorOutputPort("y", 1, lambda _, y: y.SetFromVector([1.0]))


# What is computed from a number, and whether it evaluates the number's output.
READERS = {
    "Adder": (lambda: Adder(1, 1), True),
    "AffineSystem": (lambda: AffineSystem(D=2 * ONE, y0=[1.0]), True),
    "AffineSystem that integrates": (lambda: AffineSystem(A=ONE, B=ONE, C=ONE), False),
    "Demultiplexer": (lambda: Demultiplexer(1), True),
    "Gain": (lambda: Gain(2.0, 1), True),
    "Ignoring": (Ignoring, False),
    "Integrator": (lambda: Integrator(1), False),
    "LinearSystem": (lambda: LinearSystem(D=3 * ONE), True),
    "LinearSystem with D = 0": (
        lambda: LinearSystem(A=ONE, B=ONE, C=ONE, D=0 * ONE),
        False,
    ),
    "MatrixGain": (lambda: MatrixGain(D=4 * ONE), True),
    "Multiplexer": (lambda: Multiplexer(1), True),
    "PassThrough": (lambda: PassThrough(1), True),
    "SparseMatrixGain": (lambda: SparseMatrixGain(csc_matrix(5 * ONE)), True),
    "ZeroOrderHold": (lambda: ZeroOrderHold(0.1, 1), False),
}


def behind_a_number(block):
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("number", ConstantVectorSource([1.0]))
    builder.AddNamedSystem("block", block)
    builder.Connect(source.get_output_port(), block.get_input_port(0))
    return builder.Build()


@pytest.mark.parametrize("name", READERS)
def test_an_output_is_evaluated_with_those_that_are_computed_from_it(name):
    make, reads = READERS[name]
    diagram = behind_a_number(make())
    context = diagram.CreateDefaultContext()
    ports = list(SignalsOf(diagram).values())
    motion = Motion(diagram, context)
    assert motion.Readers(ports) == ([1] if reads else [0, 1])
    readings = motion.ReadingsOf(ports)
    source = diagram.GetSubsystemByName("number")
    own = source.GetMyContextFromRoot(motion.context)
    for number in (1.0, 2.5, -3.0):
        source.get_mutable_source_value(own).set_value([number])
        found = np.frombuffer(readings.Read())
        assert found[0] == number
        fresh = motion.context.Clone()
        fresh.SetAllCacheEntriesOutOfDate()
        values = [p.Eval(p.get_system().GetMyContextFromRoot(fresh)) for p in ports]
        assert_array_equal(found, np.concatenate(values))


def test_a_controller_evaluates_both_of_its_inputs():
    builder = DiagramBuilder()
    sources = [builder.AddSystem(ConstantVectorSource([k, 0.0])) for k in (1.0, 3.0)]
    control = builder.AddSystem(PidController([2.0], [0.0], [1.0]))
    for source, port in zip(sources, ("estimated", "desired"), strict=True):
        target = control.GetInputPort(f"{port}_state")
        builder.Connect(source.get_output_port(), target)
    diagram = builder.Build()
    motion = Motion(diagram, diagram.CreateDefaultContext())
    ports = [x.get_output_port(0) for x in (*sources, control)]
    assert motion.Readers(ports) == [2]
    readings = motion.ReadingsOf(ports)
    for k in (5.0, 7.0):
        for source in sources:
            own = source.GetMyContextFromRoot(motion.context)
            source.get_mutable_source_value(own)[0] = k * (source is sources[0])
        assert_array_equal(np.frombuffer(readings.Read()), [k, 0, 0, 0, -2 * k])


class WithoutElements(LeafSystem):
    """A discrete state that has no elements."""

    def __init__(self):
        LeafSystem.__init__(self)
        self.DeclareDiscreteState(0)


def test_discrete_states_keep_their_memory_in_a_run():
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([1.0, 2.0]))
    x = builder.AddSystem(Integrator(2))
    hold = builder.AddSystem(ZeroOrderHold(0.1, 2))
    builder.AddSystem(WithoutElements())
    builder.Connect(source.get_output_port(), x.get_input_port())
    builder.Connect(x.get_output_port(), hold.get_input_port())
    simulator = Simulator(builder.Build())
    context = simulator.get_context()
    memory = [MemoryOf(context.get_discrete_state(i)) for i in (0, 1)]
    simulator.AdvanceTo(1.05)
    assert np.frombuffer(memory[0]) == pytest.approx([1.0, 2.0])
    assert memory[1] == b""


def test_no_port_is_read_without_a_port():
    system = Integrator(1)
    assert Readings((), system.CreateDefaultContext()).Read() == b""
