"""Fills the logs of a diagram, Drake's VectorLogSinks, from a compiled run."""

import math
from collections.abc import Iterator

import numpy as np
from pydrake.systems.analysis import (
    ApplySimulatorConfig,
    InitializeParams,
    Simulator,
    SimulatorConfig,
)
from pydrake.systems.framework import Context
from pydrake.systems.primitives import VectorLogSink

from teleop_drake.loops.engine.evaluator import Evaluator
from teleop_drake.loops.engine.flatten import Block
from teleop_drake.loops.engine.run import CompiledRun
from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.contexts import ContextsIn
from teleop_drake.loops.numerics.step_polynomials import interpolate

# A step of a log by itself ends so long after its start, where no sample is due, s.
_BESIDE = math.pi * 1e-10


def LogsIn(evaluator: Evaluator) -> Iterator[Block]:
    """Yields the logs that a program has left out and whose input it computes."""
    for block in evaluator.blocks:
        is_log = type(block.system) is VectorLogSink
        if is_log and set(block.inputs.values()) & evaluator.program.signals.keys():
            yield block


def WriteLogs(run: CompiledRun, evaluator: Evaluator, context: Context) -> None:
    """Adds the samples of a run to the logs, as Drake's Simulator does.

    A sample has the signal before the updates of its instant. A log of every step has
    the ends of the run's own steps.

    Args:
        context: The Context of the diagram at the end of the run.
    """
    times, rows = run.Rows()
    steps = run.Steps()
    contexts = ContextsIn(evaluator.system, context)
    for block in LogsIn(evaluator):
        log = block.system.GetMutableLog(contexts[block.system])
        (source,) = block.inputs.values()
        signal = rows[:, evaluator.program.signals[source]]
        due = _TimesOf(block.system, times[0], times[-1])
        if due is None:
            due = np.unique([times[0], *times[steps[:, -1]]])
        values = interpolate(times, signal, steps, due)
        # The first row precedes the updates at the start.
        values[due == times[0]] = signal[0]
        for time, value in zip(due, values, strict=True):
            log.AddData(time, value)


def _TimesOf(log: VectorLogSink, start: float, end: float) -> Array | None:
    """Returns the times in s at which a log takes samples; None: at every step.

    Drake does not tell the period: the log is run by itself.
    """
    context = log.CreateDefaultContext()
    port = log.get_input_port()
    port.FixValue(context, np.zeros(port.size()))
    simulator = Simulator(log, context)
    config = SimulatorConfig(max_step_size=1e9, start_time=start)
    ApplySimulatorConfig(config, simulator)
    simulator.Initialize(InitializeParams(suppress_initialization_events=True))
    beside = start + max(_BESIDE, 4 * math.ulp(start))
    if beside < end:
        simulator.AdvanceTo(beside)
        if beside in log.GetLog(context).sample_times():
            return None
        simulator.AdvanceTo(end)
    return np.array(log.GetLog(context).sample_times())
