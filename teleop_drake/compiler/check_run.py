"""Comparison of kernels with their blocks over time: transitions and delays."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.framework import PortDataType as Kind
from pydrake.systems.primitives import Sine

from teleop_drake.compiler.engine import CompiledRun

Array = NDArray[np.float64]

# How long a run is, and the steps of Drake's Simulator, in s.
_DURATION, _STEP = 1.5, 0.005

# How often the two are compared, and how near to a jump they are not, in s.
_NUM_SAMPLES, _NEAR_A_JUMP = 60, 1e-5

# Packets and samplers are likely to act at round times, s.
_NOT_ROUND = 1e-3 * math.e

# As a share of the largest element. A jump at another instant is far more.
_TOLERANCE = 1e-5


class KernelDisagrees(ValueError):
    """A kernel that does not compute what its block does."""


def CheckRun(system: System) -> list[str]:
    """Runs a block in Drake's Simulator and by its kernel, with sinusoids as inputs.

    Args:
        system: The block, which becomes part of a diagram.

    Returns:
        The transitions that did not happen, by their names in the kernel.

    Raises:
        KernelDisagrees: If an output or the state differs.
    """
    names = [
        system.get_input_port(i).get_name()
        for i in range(system.num_input_ports())
        if system.get_input_port(i).get_data_type() != Kind.kVectorValued
    ]
    if names:  # Nobody knows what to feed it with.
        return list(system.Kernel().transitions)
    diagram = _WithSinusoids(system)
    context = diagram.CreateDefaultContext()
    # Where events are located, and how exactly.
    context.SetAccuracy(1e-8)
    diagram.ExecuteInitializationEvents(context)
    run = CompiledRun(
        diagram,
        context,
        end=_DURATION,
        accuracy=1e-9,
        max_step=0.05,
        as_machine_code=False,
    )
    pieces = []
    times = np.linspace(0, _DURATION, _NUM_SAMPLES + 1)[1:] - _NOT_ROUND
    for time, own in zip(times, _InDrake(system, diagram, times), strict=True):
        pieces.append(run.Advance(time))
        jumps = pieces[-1][0][:-1][np.diff(pieces[-1][0]) == 0]
        if np.abs(time - jumps).min(initial=np.inf) > _NEAR_A_JUMP:
            _Compare(system, run, pieces[-1][1][-1], own)
    rows = np.concatenate([rows for _, rows, _ in pieces])
    return _NotHappened(system, run, rows)


def _WithSinusoids(system: System) -> Diagram:
    """Returns a diagram that feeds a block, of which no input repeats another one."""
    rng = np.random.default_rng(1)
    builder = DiagramBuilder()
    builder.AddSystem(system)
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
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
    ApplySimulatorConfig(
        SimulatorConfig(
            integration_scheme="runge_kutta5",
            max_step_size=step,
            accuracy=1e-9,
            use_error_control=True,
        ),
        simulator,
    )
    simulator.get_mutable_context().SetAccuracy(1e-8)
    simulator.Initialize()
    now = 0.0
    for time in times:
        # Without continuous state nothing else ends a step.
        for end in np.linspace(now, time, int(np.ceil((time - now) / step)) + 1)[1:]:
            simulator.AdvanceTo(end)
        now = time
        yield system.GetMyContextFromRoot(simulator.get_context())


def _Compare(system: System, run: CompiledRun, row: Array, own: Context) -> None:
    """Compares the outputs of a block and of its kernel now."""
    blocks = run.evaluator.blocks
    i = next(i for i, block in enumerate(blocks) if block.system is system)
    for output, part in run.evaluator.program.signals.items():
        if output.block != i or not system.HasOutputPort(output.port):
            continue
        port = system.GetOutputPort(output.port)
        if port.get_data_type() != Kind.kVectorValued:
            continue
        value, expected = row[part], port.Eval(own)
        scale = max(1.0, np.abs(expected).max(initial=0.0))
        if not np.allclose(value, expected, rtol=0, atol=_TOLERANCE * scale):
            raise KernelDisagrees(
                f"{blocks[i].path}: after {own.get_time():.6g} s of a run its kernel "
                f"says {output.port} = {value.tolist()}, the block "
                f"{np.array(expected).tolist()}"
            )


def _NotHappened(system: System, run: CompiledRun, rows: Array) -> list[str]:
    """Returns the transitions that did not happen."""
    names = system.Kernel().transitions if hasattr(system, "Kernel") else {}
    transitions = [
        (transition, guard)
        for transition, guard, _, _ in run.evaluator.program.transitions
    ]
    return [
        name
        for name, (transition, guard) in zip(names, transitions, strict=False)
        if (
            transition.offset > _DURATION
            if guard is None
            else not (rows[:, guard] >= 0).any()
        )
    ]
