"""LeafSystems as people write them: read as they stand, or run in Drake with a note."""

import gc
import sys

import numpy as np
import pytest
from foreign import leaves
from foreign.leaves import MISREAD, READ, REFUSED
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import (
    DiagramBuilder,
    InputPortIndex,
    LeafSystem,
    OutputPortIndex,
)
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Integrator,
    Linearize,
    MatrixGain,
    Sine,
)

from teleop_drake.loops import Compile, NamedParameters, simulate
from teleop_drake.loops.engine.check import KernelDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import UnreadableLeaf
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.kernel import Kernel


def wired(*makers):
    """Returns a diagram in which a sine feeds each block, and its start."""
    builder = DiagramBuilder()
    wave = builder.AddNamedSystem("wave", Sine([1.0, 0.7], [5.0, 8.0], [0.1, 2.0]))
    for i, make in enumerate(makers):
        block = builder.AddNamedSystem(f"block{i}", make())
        if block.HasInputPort("u") or block.num_input_ports() == 1:
            port = block.get_input_port(0)
            builder.Connect(wave.get_output_port(0), port)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    x = context.get_continuous_state_vector().CopyToVector()
    context.SetContinuousState(np.linspace(0.2, 0.4, len(x)))
    return diagram, context


def lines(make):
    """Returns how many lines of this folder's blocks run while a block is read."""
    diagram, context = wired(make)
    ran = []

    def trace(frame, event, _):
        if frame.f_code.co_filename != leaves.__file__:
            return None
        # The followed copies, which have stand-ins, are not the user's functions.
        if event == "line" and isinstance(frame.f_locals.get("self"), LeafSystem):
            ran.append((type(frame.f_locals["self"]), frame.f_lineno))
        return trace

    sys.settrace(trace)
    try:
        with pytest.raises(UnreadableLeaf):
            Evaluator(diagram, context)
    finally:
        sys.settrace(None)
    return [x for x in ran if x[0] is make]


def test_all_that_are_read_move_as_in_drake():
    """One program of all blocks, against Drake's own Simulator."""
    assert len(READ) >= 39
    diagram, context = wired(*READ)
    evaluator = Evaluator(diagram, context, as_machine_code=True)
    assert len(evaluator.read) == len(READ)
    run = CompiledRun(evaluator, context, end=1.0, accuracy=1e-12, max_step=0.005)
    simulator = Simulator(diagram, context.Clone())
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", max_step_size=0.005, accuracy=1e-12
    )
    ApplySimulatorConfig(config, simulator)
    for time in (0.0123, 0.317, 0.6432, 0.95):
        run.Sample(time)
        simulator.AdvanceTo(time)
        own = simulator.get_context()
        x = own.get_continuous_state_vector().CopyToVector()
        np.testing.assert_allclose(run.memory.x, x, rtol=0, atol=1e-9)
        groups = range(own.num_discrete_state_groups())
        m = [own.get_discrete_state(i).CopyToVector() for i in groups]
        np.testing.assert_allclose(run.memory.m, np.concatenate(m), rtol=0, atol=1e-9)


@pytest.mark.parametrize("make", READ, ids=lambda make: make.__name__)
def test_it_is_read_as_drake_calls_it(make):
    """At random states, without the package's own comparison."""
    diagram, context = wired(make)
    evaluator = Evaluator(diagram, context)
    rng = np.random.default_rng(1)
    block = diagram.GetSubsystemByName("block0")
    for time in rng.random(5):
        context.SetTime(time)
        x = rng.normal(size=context.num_continuous_states())
        if len(x):
            context.SetContinuousState(x)
        y, dx = evaluator.Evaluate(context)
        rate = diagram.EvalTimeDerivatives(context).CopyToVector()
        np.testing.assert_allclose(dx, rate, rtol=1e-12, atol=1e-12)
        for (i, name), part in evaluator.program.signals.items():
            system = evaluator.blocks[i].system
            if system is block and system.HasOutputPort(name):
                own = block.GetMyContextFromRoot(context)
                expected = block.GetOutputPort(name).Eval(own)
                np.testing.assert_allclose(y[part], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("make", REFUSED, ids=lambda make: make.__name__)
def test_what_cannot_be_followed_is_named_and_not_run(make):
    diagram, context = wired(make)
    with pytest.raises(UnreadableLeaf, match=REFUSED[make]):
        Evaluator(diagram, context)


@pytest.mark.parametrize(
    "make", [leaves.Assigns, leaves.Appends, leaves.Queues, leaves.Prints]
)
def test_no_line_runs_while_a_function_is_looked_for(make):
    assert lines(make) == []


def test_the_note_teaches():
    diagram, context = wired(leaves.Assigns)
    run = simulate(diagram, context=context, duration=0.1)
    line = leaves.Assigns.calc.__code__.co_firstlineno + 1
    assert run.notes[0] == (
        f"block0 runs in Drake: calc(), line {line}: it assigns to self.integral; "
        "declare a state instead."
    )


@pytest.mark.parametrize("make", MISREAD)
def test_what_drake_calls_otherwise_runs_in_drake(make):
    diagram, context = wired(make)
    run = simulate(diagram, context=context, duration=0.5)
    assert run.solver.engine == "drake"
    assert "block0: as read from its Python code, y = " in run.notes[0]
    later = Compile(diagram, context=context, duration=0.5).Run()
    np.testing.assert_array_equal(later["block0.y"][-1], run["block0.y"][-1])


class WithWrongKernel(leaves.Sum):
    def Kernel(self):
        return Kernel(outputs={"y": ("u", 0, 1)})


def test_a_kernel_that_a_user_wrote_is_an_error():
    diagram, context = wired(leaves.Sum, WithWrongKernel)
    with pytest.raises(KernelDisagrees, match="block1: its kernel says y"):
        simulate(diagram, context=context, duration=0.1)


def test_nothing_goes_stale():
    diagram, context = wired(leaves.WithTable, leaves.Pid, leaves.Clock)
    table, pid = (diagram.GetSubsystemByName(f"block{i}") for i in (0, 1))
    model = Compile(diagram, context=context, duration=0.3)
    first = model.Run()
    assert "block0, block1, block2: machine code" in first.notes[-1]
    pid.kp = 7.0
    second = model.Run()
    assert second["block1.y"][0] - first["block1.y"][0] == pytest.approx(
        5.0 * np.sin(0.1), rel=1e-12
    )
    table.chosen = "linear"  # Another program.
    third = model.Run()
    assert third["block0.y"][0] == 0.0
    table.calc = None
    table.laws = {"linear": lambda x: print(x)}
    with pytest.raises(ValueError, match=r"print\(\)"):
        model.Run()


def test_constants_need_no_new_code():
    diagram, context = wired(leaves.Pid)
    evaluator = Evaluator(diagram, context)
    diagram.GetSubsystemByName("block0").ki = 0.75
    other = evaluator.With(context, ())
    assert other.program.HasCodeOf(evaluator.program)
    assert not np.array_equal(other.program.p, evaluator.program.p)


def test_a_parameter_of_the_context_is_a_number():
    diagram, context = wired(leaves.Parameters)
    model = Compile(diagram, context=context, duration=0.2)
    run = model.Run(**{"block0.parameter0": [0.0, 4.0]})
    np.testing.assert_allclose(
        run["block0.y"][:, 0], 4.0 * 0.7 * np.sin(8.0 * run.time + 2.0), atol=1e-12
    )


def test_sliders_of_meshcat_are_numbers():
    meshcat = Meshcat()
    meshcat.AddSlider("gain", 0.0, 4.0, 0.5, 1.5)
    meshcat.AddSlider("unused", 0.0, 4.0, 0.5, 1.0)
    builder = DiagramBuilder()
    sliders = builder.AddNamedSystem("sliders", leaves.Sliders(meshcat, ["gain"]))
    total = builder.AddNamedSystem("total", Integrator(1))
    builder.Connect(sliders.get_output_port(), total.get_input_port())
    diagram = builder.Build()
    model = Compile(diagram, duration=2.0)
    assert model.Run()["total.y0"][-1] == pytest.approx(3.0)
    assert model.Run(**{"sliders.gain": 0.5})["total.y0"][-1] == pytest.approx(1.0)
    meshcat.SetSliderValue("gain", 4.0)
    assert model.Run()["total.y0"][-1] == pytest.approx(8.0)
    assert "sliders.gain" in NamedParameters(diagram, diagram.CreateDefaultContext())


@pytest.mark.parametrize("is_read", [True, False])
def test_a_template_with_lqr_and_an_open_input(is_read):
    builder = DiagramBuilder()
    vehicle = builder.AddNamedSystem("vehicle", leaves.Vehicle_[None](is_read))
    context = vehicle.CreateDefaultContext()
    u0 = np.full(2, 9.81 / 4)
    vehicle.get_input_port(0).FixValue(context, u0)
    model = Linearize(vehicle, context, InputPortIndex(0), OutputPortIndex(0))
    K, _ = LinearQuadraticRegulator(model.A(), model.B(), np.eye(6), np.eye(2))
    law = MatrixGain(-K)
    builder.AddNamedSystem("law", law)
    sum_ = builder.AddNamedSystem("sum", Adder(2, 2))
    rest = builder.AddNamedSystem("rest", ConstantVectorSource(u0))
    builder.Connect(vehicle.get_output_port(), law.get_input_port())
    builder.Connect(law.get_output_port(), sum_.get_input_port(0))
    builder.Connect(rest.get_output_port(), sum_.get_input_port(1))
    builder.Connect(sum_.get_output_port(), vehicle.get_input_port(0))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetContinuousState([1.0, 0.5, 0.3, 0.0, 0.0, 0.0])
    runs = [
        simulate(diagram, context=context, duration=0.8, engine=engine)
        for engine in ("compiled", "drake")
    ]
    assert [run.solver.engine for run in runs] == ["compiled", "drake"]
    ends = [run["vehicle.x"][-1] for run in runs]
    assert np.abs(ends[0]).max() > 0.1
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_sinks_are_left_out_and_named():
    diagram, context = wired(leaves.Sum, leaves.Logger, leaves.Drawing, leaves.Picture)
    run = simulate(diagram, context=context, duration=0.2)
    assert run.solver.engine == "compiled"
    assert run.notes[0].startswith(
        "block1, block2, block3: left out of the compiled run"
    )
    assert diagram.GetSubsystemByName("block1").log == []


def test_a_sink_that_ends_the_run_runs_in_drake():
    diagram, context = wired(leaves.Sum, leaves.Monitor)
    run = simulate(diagram, context=context, duration=1.0)
    assert run.time[-1] < 0.5
    assert "publish()" in run.notes[0]


def test_the_class_and_the_profiler_are_as_before():
    before = dict(vars(leaves.Inherited))
    calls = []
    sys.setprofile(lambda *call: calls.append(call))
    try:
        profiler = sys.getprofile()
        diagram, context = wired(leaves.Inherited)
        Evaluator(diagram, context)
        assert sys.getprofile() is profiler
    finally:
        sys.setprofile(None)
    assert dict(vars(leaves.Inherited)) == before
    assert gc.isenabled()
