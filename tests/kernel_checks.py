"""Comparison of kernels with their blocks, at random states and in a run."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    InputPort,
    PortDataType,
    System,
)
from pydrake.systems.primitives import Sine

from teleop_drake.loops.engine.check import Compare, KernelDisagrees
from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.numerics.instants import SAME

# The largest difference after a while, as a share of the largest element. A jump at
# another instant makes a far larger one.
_TOLERANCE_OF_RUN = 1e-5

# How long a run is, and the steps of Drake's Simulator, in s.
_DURATION = 1.5
_STEP = 0.005

# How often the two are compared, and how near to a jump they are not, in s.
_NUM_SAMPLES = 60
_NEAR_A_JUMP = 1e-5

# Packets and samplers are likely to act at round times, s.
_NOT_ROUND = 1e-3 * math.e


def CheckKernel(system: System, *, num_states: int = 10) -> list[str]:
    """Checks the kernel of a block, or those of all blocks in a diagram.

    Outputs and time derivatives are compared at random inputs, states and times. A
    block by itself is compiled, too. If it has
    transitions or delays it is run as well, with sinusoids at its inputs, in Drake's
    Simulator and by its kernel: this shows whether its modes change when and as they
    should, and compares its outputs in these modes. For that it becomes part of a
    diagram, and cannot be part of another one.

    Returns:
        The transitions, by the names in the kernel, that did not happen in the run and
        were therefore not compared with the block; see Transition.

    Raises:
        UnsupportedSystem: If a block offers no kernel, or one that cannot be compiled.
        KernelDisagrees: If a kernel is wrong; it names the block and what differs.
    """
    context = _DefaultContext(system)
    is_block = not isinstance(system, Diagram)
    evaluators = [Evaluator(system, context)]
    rng = np.random.default_rng(0)
    for _ in range(num_states):
        for port in _VectorInputs(system):
            port.FixValue(context, rng.normal(size=port.size()))
        context.SetTime(rng.uniform(0, 1))
        x = context.get_continuous_state_vector().CopyToVector()
        x += 0.1 * (1 + np.abs(x)) * rng.normal(size=x.size)
        context.SetContinuousState(x)
        if is_block and len(evaluators) == 1:
            evaluators.append(Evaluator(system, context, as_machine_code=True))
        for each in evaluators:
            Compare(each, system, context)
    program = evaluators[0].program
    if not is_block or not (program.transitions or program.delays):
        return []
    return _CheckRun(system)


def _DefaultContext(system: System) -> Context:
    context = system.CreateDefaultContext()
    # Events are located if there is an accuracy, and some blocks then have modes.
    context.SetAccuracy(1e-4)
    for port in _VectorInputs(system):
        port.FixValue(context, np.zeros(port.size()))
    system.ExecuteInitializationEvents(context)
    return context


def _VectorInputs(system: System) -> list[InputPort]:
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    return [
        port for port in ports if port.get_data_type() == PortDataType.kVectorValued
    ]


def _CheckRun(system: System) -> list[str]:
    """Runs a block in Drake's Simulator and by its kernel, with sinusoids as inputs.

    Returns:
        The transitions that did not happen, by their names in the kernel.
    """
    if len(_VectorInputs(system)) < system.num_input_ports():
        return list(system.Kernel().transitions)  # Nobody knows what to feed it with.
    diagram = _WithSinusoids(system)
    context = diagram.CreateDefaultContext()
    # Where events are located, and how exactly.
    context.SetAccuracy(1e-8)
    diagram.ExecuteInitializationEvents(context)
    evaluator = Evaluator(diagram, context)
    run = CompiledRun(evaluator, context, end=_DURATION, accuracy=1e-9, max_step=0.05)
    times = np.linspace(0, _DURATION, _NUM_SAMPLES + 1)[1:] - _NOT_ROUND
    for time, own in zip(times, _InDrake(system, diagram, times), strict=True):
        while run.time < time - SAME:
            run.Advance(time)
        instants, rows = run.Rows()
        jumps = instants[:-1][np.diff(instants) == 0]
        if np.abs(time - jumps).min(initial=np.inf) > _NEAR_A_JUMP:
            _CompareRow(evaluator, system, own, rows[-1])
    names = system.Kernel().transitions if hasattr(system, "Kernel") else {}
    return [
        name
        for name, (transition, guard, _, _) in zip(
            names, evaluator.program.transitions, strict=False
        )
        if (
            transition.offset > _DURATION
            if guard is None
            else not (run.Rows()[1][:, guard] >= 0).any()
        )
    ]


def _CompareRow(evaluator: Evaluator, system: System, context: Context, y) -> None:
    """Compares the outputs of a block in a run, at the time of its Context in Drake."""
    for output, part in evaluator.program.signals.items():
        is_own = evaluator.blocks[output.block].system is system
        if not (is_own and system.HasOutputPort(output.port)):
            continue
        port = system.GetOutputPort(output.port)
        if port.get_data_type() != PortDataType.kVectorValued:
            continue
        expected = port.Eval(context)
        scale = max(1.0, np.abs(expected).max(initial=0.0))
        if not np.allclose(y[part], expected, rtol=0, atol=_TOLERANCE_OF_RUN * scale):
            raise KernelDisagrees(
                f"after {context.get_time():.6g} s of a run: its kernel says "
                f"{output.port} = {y[part].tolist()}, the block {expected.tolist()}"
            )


def _WithSinusoids(system: System) -> Diagram:
    """Returns a diagram that feeds a block, of which no input repeats another one."""
    rng = np.random.default_rng(1)
    builder = DiagramBuilder()
    builder.AddSystem(system)
    for i, port in enumerate(_VectorInputs(system)):
        amplitude, frequency, phase = rng.uniform(
            [[1.0], [3.0], [0.0]], [[3.0], [9.0], [6.0]], size=(3, port.size())
        )
        source = builder.AddNamedSystem(
            f"probe_{i}", Sine(amplitude, frequency, phase, True)
        )
        builder.Connect(source.get_output_port(0), port)
    return builder.Build()


def _InDrake(
    system: System, diagram: Diagram, times: Iterable[float]
) -> Iterator[Context]:
    """Yields the context of a block at times, as Drake's Simulator gets there."""
    simulator = Simulator(diagram)
    step = min(_STEP, getattr(system, "longest_step", np.inf))
    config = SimulatorConfig(
        integration_scheme="runge_kutta5", max_step_size=step, accuracy=1e-9
    )
    ApplySimulatorConfig(config, simulator)
    simulator.get_mutable_context().SetAccuracy(1e-8)
    simulator.Initialize()
    now = 0.0
    for time in times:
        # Without continuous state nothing else ends a step.
        for end in np.linspace(now, time, int(np.ceil((time - now) / step)) + 1)[1:]:
            simulator.AdvanceTo(end)
        now = time
        yield system.GetMyContextFromRoot(simulator.get_context())
